import numpy as np
import pytest

from savmap.vision.masks import Runs, border_points, enveloped, runs_of, separated, union_of_longest


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
    runs, region = separated(np.zeros((20, 30), dtype=np.uint8), 5, 3.0)
    assert len(runs.column) == len(region) == 0


def bars(*boxes: tuple[int, int, int, int], shape: tuple[int, int] = (60, 80)) -> np.ndarray:
    mask = np.zeros(shape, dtype=np.bool_)
    for top, bottom, left, right in boxes:
        mask[top:bottom, left:right] = True
    return mask


def test_bridge_between_two_bars_is_removed() -> None:
    mask = bars((10, 15, 0, 80), (40, 45, 0, 80), (10, 45, 30, 45))
    runs, region = separated(mask.view(np.uint8), 5, 3.0)
    assert runs.thickness.max() == 5
    assert not set(region[runs.first < 20]) & set(region[runs.first >= 20])
    assert not ((runs.column >= 30) & (runs.column < 45)).any()


def test_specks_and_narrow_posts_are_left_out() -> None:
    mask = bars((10, 15, 0, 80), (30, 50, 20, 24), (55, 57, 60, 64))
    runs, region = separated(mask.view(np.uint8), 5, 3.0)
    assert len(np.unique(region)) == 1
    assert (runs.last < 15).all()


@pytest.mark.parametrize("dimension", [0, 1])
def test_of_overlapping_masks_the_longest_stays(dimension: int) -> None:
    long, short, apart = bars((10, 15, 0, 70)), bars((12, 19, 20, 60)), bars((30, 35, 0, 40))
    masks = [mask.T if dimension else mask for mask in (short, apart, long)]
    union = union_of_longest(masks, 0.25, dimension)
    expected = long | apart
    np.testing.assert_array_equal(union.T if dimension else union, expected)


def test_masks_that_hardly_overlap_are_joined() -> None:
    halves = [bars((10, 15, 0, 42)), bars((10, 15, 38, 80))]
    np.testing.assert_array_equal(union_of_longest(halves, 0.25, 0), halves[0] | halves[1])


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
