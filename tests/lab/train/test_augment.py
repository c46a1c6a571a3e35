import time
from itertools import islice
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from savmap.errors import OutputError
from savmap.lab.train.data.augment import (
    ANY_PLACE,
    ONE_SITE,
    VARIATIONS,
    BatchSource,
    Crop,
    alike,
    augment,
    dim,
    prefetched,
    random_homography,
    recolour,
    warp,
)
from savmap.lab.train.data.dataset import IGNORE

from .conftest import bars

CROP = Crop(width=320, height=256)


def test_a_variant_follows_from_its_seed_and_has_the_crops_size_and_known_labels() -> None:
    image, mask = bars(np.random.default_rng(0))
    for seed in range(4):
        (varied, labels), again = (augment(np.random.default_rng(seed), image, mask, CROP, 2) for _ in range(2))
        assert np.array_equal(varied, again[0])
        assert np.array_equal(labels, again[1])
        assert (varied.shape, varied.dtype, labels.shape) == ((256, 320, 3), np.uint8, (256, 320))
        assert set(np.unique(labels)) <= {0, 1, 2, IGNORE}


def test_labels_follow_the_picture() -> None:
    """A picture painted by its labels keeps its colours within a pixel of every edge, whatever the warp."""
    mask = bars(np.random.default_rng(0))[1]
    palette = np.array([[0, 0, 0], [255, 0, 0], [0, 255, 0]], np.uint8)
    for seed in range(5):
        homography = random_homography(np.random.default_rng(seed), CROP, 640, 480)
        varied, labels = warp(palette[mask], mask, homography, CROP, 2)
        known = labels != IGNORE
        brightest = np.argmax(np.dstack([np.full(labels.shape, 0.5), varied[:, :, 0], varied[:, :, 1]]), axis=2)
        assert np.mean(brightest[known] == labels[known]) > 0.995


def test_outside_the_picture_is_not_judged() -> None:
    image, mask = bars(np.random.default_rng(0))
    far_right = np.array([[1, 0, -500], [0, 1, 0], [0, 0, 1.0]])
    _, labels = warp(image, mask, far_right, CROP, 2)
    assert np.all(labels[:, 142:] == IGNORE)
    assert np.all(labels[:190, :138] == 0)


def test_recolour_changes_each_class_on_its_own() -> None:
    image, mask = bars(np.random.default_rng(0))
    start = image.astype(np.float32) / 255
    changed = recolour(np.random.default_rng(1), start, mask, 2)
    shifts = [np.abs(changed - start)[mask == k].mean() for k in range(3)]
    assert max(shifts) > 0.05
    assert len({round(float(s), 4) for s in shifts}) > 1


def test_paint_does_not_show_where_labels_end() -> None:
    image, mask = bars(np.random.default_rng(0))
    start = image.astype(np.float32) / 255
    mask[mask == 0] = IGNORE
    for seed in range(4):
        assert np.allclose(recolour(np.random.default_rng(seed), start, mask, 2), start)


@pytest.mark.parametrize("change", [change for _, change in VARIATIONS[ANY_PLACE].changes], ids=lambda c: c.__name__)
def test_every_change_keeps_shape_and_type(change) -> None:  # type: ignore[no-untyped-def]
    image = np.random.default_rng(0).random((64, 96, 3)).astype(np.float32)
    for seed in range(4):
        changed = change(np.random.default_rng(seed), image)
        assert changed.shape == image.shape
        assert changed.dtype.kind == "f"
        assert np.isfinite(changed).all()


def test_one_site_keeps_its_colours() -> None:
    """Of two hundred variants of a red picture, few are of another hue where a network is for one site."""
    image = np.zeros((60, 80, 3), np.uint8)
    image[..., 0] = 160
    mask = np.zeros((60, 80), np.uint8)
    share = {}
    for name in (ANY_PLACE, ONE_SITE):
        rng = np.random.default_rng(1)
        means = [augment(rng, image, mask, Crop(32, 32), 1, VARIATIONS[name])[0].mean(axis=(0, 1)) for _ in range(200)]
        share[name] = np.mean([mean.argmax() == 0 for mean in means])
    assert share[ONE_SITE] > 0.9 > share[ANY_PLACE]


class Numbered:
    """A source whose batches are their numbers; that of 13 fails."""

    start = 10

    def __init__(self) -> None:
        self.made: list[int] = []

    def batch(self, number: int) -> int:
        self.made.append(number)
        if number == 13:
            raise OutputError("picture 13 cannot be read")
        time.sleep(0.02 if number % 2 == 0 else 0.0)
        return number


@pytest.mark.parametrize("threads", [1, 3])
def test_batches_come_in_order_from_any_number_of_threads(threads: int) -> None:
    source = Numbered()
    batches = prefetched(source, threads)  # type: ignore[arg-type]
    assert list(islice(batches, 3)) == [10, 11, 12]
    with pytest.raises(OutputError, match="picture 13"):
        next(batches)
    assert len(source.made) < 20


def test_a_run_that_goes_on_sees_the_batches_that_were_to_come() -> None:
    image, mask = bars(np.random.default_rng(0))
    sample = SimpleNamespace(load=lambda: (image, mask))
    first, later = (BatchSource([sample], np.ones(1), 2, 2, 5, Crop(64, 64), start) for start in (0, 2))  # type: ignore[list-item]
    third = list(islice(prefetched(first), 3))[2]
    assert all(np.array_equal(a, b) for a, b in zip(third, next(prefetched(later)), strict=True))
    assert not np.array_equal(third[0], first.batch(0)[0])


def test_members_take_the_colour_of_what_is_beside_them() -> None:
    image, mask = bars(np.random.default_rng(0))
    start = image.astype(np.float32) / 255
    changed = alike(np.random.default_rng(0), start, mask)
    beside = np.zeros_like(mask)
    beside[300:400, 95:100] = beside[300:400, 110:115] = 1
    middle = (slice(300, 400), slice(103, 107))

    def differs(picture: np.ndarray) -> float:
        return float(np.abs(picture[middle].mean(axis=(0, 1)) - picture[beside == 1].mean(axis=0)).max())

    assert differs(changed) < 0.6 * differs(start)
    far = cv2.dilate(mask, np.ones((3, 3), np.uint8)) == 0  # a pixel's border blends
    assert np.allclose(changed[far], start[far], atol=1e-6)


def test_little_light_is_noisy() -> None:
    start = np.full((64, 64, 3), 0.5, np.float32)
    dark = dim(np.random.default_rng(1), start)
    assert 0.07 < dark.mean() < 0.25
    assert 0.009 < dark.std() < 0.05
