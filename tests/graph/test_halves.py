"""Either half of the frames: both show what every view shows."""

import numpy as np
import pytest

from savmap.graph.solver.checks import odd_frames


@pytest.mark.parametrize("every", [1, 2, 4])
def test_each_view_has_frames_in_either_half(every: int) -> None:
    used = np.arange(3, 203)
    odd = odd_frames(used, every)
    for view_every in (1, every):
        of_view = odd[used % view_every == 0]
        assert abs(of_view.mean() - 0.5) < 0.03
    assert (np.diff(odd[used % every == 0].astype(int)) != 0).all()


def test_frames_of_one_rate_alternate_whatever_their_numbers() -> None:
    assert odd_frames(np.array([0, 2, 4, 8, 10]), 1).tolist() == [False, True, False, True, False]
