import numpy as np
import pytest

from savmap.lab.train.data.dataset import IGNORE
from savmap.lab.train.measure import edge_offsets, intersection_and_union


def bar_mask(left: int = 100, right: int = 110) -> np.ndarray:
    mask = np.zeros((200, 300), np.uint8)
    mask[:, left:right] = 1
    return mask


def soft_bar(left: float, right: float) -> np.ndarray:
    """Probability one half at columns `left` and `right`, rising over about two pixels."""
    x = np.arange(300)
    profile = 1 / (1 + np.exp(-3 * (x - left))) - 1 / (1 + np.exp(-3 * (x - right)))
    return np.tile(profile.astype(np.float32), (200, 1))


def test_intersection_and_union_leave_ignored_pixels_out() -> None:
    truth = bar_mask()
    truth[:100] = IGNORE
    counts = intersection_and_union(bar_mask(100, 105), truth, 1)
    assert counts.tolist() == [[500, 1000]]


@pytest.mark.parametrize("shift", [-1.3, -0.4, 0.0, 0.7])
def test_a_wider_mask_has_a_positive_offset_on_both_sides(shift: float) -> None:
    summary = edge_offsets(soft_bar(99.5 - shift, 109.5 + shift), bar_mask(), 1).summary()
    assert summary["left_px"] == pytest.approx(shift, abs=0.1)
    assert summary["right_px"] == pytest.approx(shift, abs=0.1)
    assert "top_px" not in summary
    assert summary["spread_px"] < 0.1


def test_a_shifted_mask_has_opposite_offsets() -> None:
    summary = edge_offsets(soft_bar(100.5, 110.5), bar_mask(), 1).summary()
    assert summary["left_px"] == pytest.approx(-1, abs=0.1)
    assert summary["right_px"] == pytest.approx(1, abs=0.1)


def test_nothing_to_compare() -> None:
    assert edge_offsets(soft_bar(50, 60), np.zeros((200, 300), np.uint8), 1).summary() == {}
