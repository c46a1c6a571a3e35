"""What two rows have of one rack."""

import numpy as np

from savmap.types import Structure
from savmap_shelves.mapping import DEEPEST_RACK_M, FRAME_SIGMA_M, cross_row_landmarks


def thing(label: str, left: float) -> Structure:
    corners = np.array([[left, 0.0, 0], [left + 0.1, 0, 0], [left, 6, 0], [left + 0.1, 6, 0]])
    sigmas = np.array([1e-4, 0.012, 1e-4, 0.012])
    covariances = sigmas[:, None, None] ** 2 * np.eye(3)
    return Structure(f"{label} 1", label, corners, covariances, tuple("abcd"), np.zeros((0, 2), np.int64))


def test_uprights_are_shared_along_the_rack_with_its_other_face() -> None:
    (found,) = cross_row_landmarks([thing("upright", 3.6), thing("beam", 0.0)])
    assert (found.id, found.kind, found.axes, found.behind_m) == ("upright 1", "upright", ("x",), DEEPEST_RACK_M)
    assert np.isclose(found.place[0], 3.65)
    assert np.isclose(found.covariance[0, 0], 0.012**2 / 2 + 0.5e-8 + FRAME_SIGMA_M**2)
