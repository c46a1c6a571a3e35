"""Masks: connected regions, numbered in scan order, hysteresis, and the borders of long thin objects."""

import numpy as np
import pytest
from scipy.ndimage import label

from savmap.types import Thresholds
from savmap.vision.masks import (
    NEAR_PX,
    Runs,
    border_points,
    connected_regions,
    enveloped,
    hysteresis,
    numbered_runs,
    numbers_of_longest,
    region_labels,
    runs_of,
)

HYSTERESIS = Thresholds(0.5, 0.3, 0.75)


def picture(*rows: str) -> np.ndarray:
    return np.array([[character == "#" for character in row] for row in rows], dtype=np.uint8)


def listed(runs: Runs) -> list[tuple[int, int, int]]:
    return list(zip(runs.column.tolist(), runs.first.tolist(), runs.last.tolist(), strict=True))


def test_runs_are_listed_by_column_and_row_up_to_the_borders() -> None:
    runs = runs_of(picture("#.#", "#..", "..#", "#.#"))
    assert listed(runs) == [(0, 0, 1), (0, 3, 3), (2, 0, 0), (2, 2, 3)]
    assert runs.thickness.tolist() == [2, 1, 1, 2]
    assert runs.middle.tolist() == [0.5, 3.0, 0.0, 2.5]


def test_an_empty_mask_has_no_runs() -> None:
    runs, number = numbered_runs(np.zeros((20, 30), np.uint16), 5, 3.0)
    assert len(runs.column) == len(number) == 0


def bars(*boxes: tuple[int, int, int, int], shape: tuple[int, int] = (60, 80)) -> np.ndarray:
    mask = np.zeros(shape, dtype=np.bool_)
    for top, bottom, left, right in boxes:
        mask[top:bottom, left:right] = True
    return mask


def test_what_is_far_thicker_than_its_mask_usually_is_is_left_out() -> None:
    mask = bars((10, 15, 0, 80), (10, 45, 30, 45))
    runs, number = numbered_runs(mask.astype(np.uint16), 5, 3.0)
    assert runs.thickness.max() == 5
    assert set(number.tolist()) == {1}
    assert not ((runs.column >= 30) & (runs.column < 45)).any()


def test_specks_and_narrow_posts_are_left_out() -> None:
    mask = bars((10, 15, 0, 80), (30, 50, 20, 24), (55, 57, 60, 64))
    runs, _ = numbered_runs(mask.astype(np.uint16), 5, 3.0)
    assert (runs.last < 15).all()


@pytest.mark.parametrize("dimension", [0, 1])
def test_of_overlapping_masks_the_longest_stays(dimension: int) -> None:
    long, short, distant = bars((10, 15, 0, 70)), bars((12, 19, 20, 60)), bars((30, 35, 0, 40))
    masks = [mask.T if dimension else mask for mask in (short, distant, long)]
    numbers = numbers_of_longest(masks, 0.25, dimension)
    np.testing.assert_array_equal(numbers.T if dimension else numbers, 3 * long + 2 * distant)


def test_masks_that_hardly_overlap_both_stay() -> None:
    halves = [bars((10, 15, 0, 42)), bars((10, 15, 38, 80))]
    numbers = numbers_of_longest(halves, 0.25, 0)
    np.testing.assert_array_equal(numbers > 0, halves[0] | halves[1])
    assert set(numbers.ravel().tolist()) == {0, 1, 2}


def test_holes_are_bridged_part_by_part() -> None:
    runs = Runs(np.array([0, 0, 0, 1]), np.array([2, 8, 20, 2]), np.array([4, 9, 22, 9]))
    whole, part = enveloped(runs, np.array([0, 0, 1, 0]))
    assert listed(whole) == [(0, 2, 9), (1, 2, 9), (0, 20, 22)]
    assert part.tolist() == [0, 0, 1]


def test_borders_are_where_the_probability_is_a_half() -> None:
    rows = np.arange(40)[:, None]
    upper, lower = 10.3 + 0.05 * np.arange(50), 17.8 + 0.05 * np.arange(50)
    probability = np.clip(np.minimum(rows - upper, lower - rows) * 0.4 + 0.5, 0, 1).astype(np.float32)
    for threshold in (0.3, 0.5, 0.8):
        seen_upper, seen_lower = border_points(runs_of((probability > threshold).view(np.uint8)), probability)
        np.testing.assert_allclose(seen_upper, upper, atol=1e-5)
        np.testing.assert_allclose(seen_lower, lower, atol=1e-5)


def test_borders_at_the_pictures_border_are_unknown() -> None:
    mask = bars((0, 6, 0, 5), (30, 40, 10, 20), shape=(40, 20))
    upper, lower = border_points(runs_of(mask.view(np.uint8)), mask.astype(np.float32))
    np.testing.assert_allclose(upper, [np.nan] * 5 + [29.5] * 10)
    np.testing.assert_allclose(lower, [5.5] * 5 + [np.nan] * 10)
    upper, lower = border_points(runs_of(mask.view(np.uint8)), np.full(mask.shape, 0.2, dtype=np.float32))
    np.testing.assert_allclose(upper, [np.nan] * 5 + [29.5] * 10)
    np.testing.assert_allclose(lower, [5.5] * 5 + [np.nan] * 10)


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
