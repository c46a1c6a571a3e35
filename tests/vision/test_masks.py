"""Masks: connected regions, numbered in scan order, and hysteresis."""

import numpy as np
from scipy.ndimage import label

from savmap.types import Thresholds
from savmap.vision.masks import NEAR_PX, connected_regions, hysteresis, region_labels

HYSTERESIS = Thresholds(0.5, 0.3, 0.75)


def blobs() -> np.ndarray:
    mask = np.zeros((12, 20), np.uint8)
    mask[6:9, 1:4] = 1
    mask[1:3, 10:14] = 255
    mask[3, 14] = 1
    return mask


def test_regions_have_labels_boxes_and_areas() -> None:
    regions = connected_regions(blobs())
    assert regions.labels[1, 10] == regions.labels[3, 14] == 1
    assert regions.labels[6, 1] == 2
    assert regions.boxes[1:].tolist() == [[10, 1, 5, 3], [1, 6, 3, 3]]
    assert regions.areas.tolist() == [240 - 18, 9, 9]


def test_labels_alone_are_the_same() -> None:
    mask = (np.random.default_rng(3).random((90, 70)) > 0.6).astype(np.uint8)
    labels = region_labels(mask)
    np.testing.assert_array_equal(labels, connected_regions(mask).labels)
    assert labels.max() == label(mask, np.ones((3, 3)))[1]


def bar(*heights: float) -> np.ndarray:
    """A level bar, its parts of these probabilities one after another, with flanks that fall off to both sides."""
    profile = np.array([0.1, 0.3, 0.65, 1.0, 1.0, 1.0, 0.65, 0.3, 0.1])
    parts = [np.outer(profile, np.full(3 * NEAR_PX, height)) for height in heights]
    return np.pad(np.concatenate(parts, axis=1), 2).astype(np.float32)


def rows_of(mask: np.ndarray, part: int) -> int:
    """How many rows of the middle of a part belong to a mask."""
    return int(mask[:, 2 + 3 * NEAR_PX * part + 3 * NEAR_PX // 2].sum())


def test_a_faint_part_is_as_thick_as_a_plain_one() -> None:
    mask = hysteresis(bar(0.99, 0.6, 0.49), HYSTERESIS)
    assert [rows_of(mask, part) for part in range(3)] == [5, 5, 5]
    assert [rows_of(bar(0.99, 0.6, 0.49) > 0.5, part) for part in range(3)] == [5, 3, 0]


def test_what_is_sure_nowhere_is_passed_over() -> None:
    assert not hysteresis(bar(0.7), HYSTERESIS).any()
    assert hysteresis(bar(0.8), HYSTERESIS).any()
    assert not rows_of(hysteresis(bar(0.99, 0.28), HYSTERESIS), 1)
    values = np.random.default_rng(5).random((50, 40)).astype(np.float32)
    np.testing.assert_array_equal(hysteresis(values, Thresholds.of(0.5)), values > 0.5)
    assert Thresholds.of(0.4, 0.6, 0.2) == (0.4, 0.4, 0.4)
    assert Thresholds.of(0.5, 0.3, 0.75) == HYSTERESIS
