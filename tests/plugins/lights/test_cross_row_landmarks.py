"""What two rows have of the lamps over an aisle."""

import numpy as np

from savmap.types import Structure
from savmap_lights.plugin import Lights, Settings


def test_lamps_are_shared_by_their_centres() -> None:
    ends = np.array([[1.0, 8, 1.5], [2.2, 8, 1.5]])
    covariances = np.array([0.01 * np.eye(3), 0.03 * np.eye(3)])
    lamp = Structure("light 2", "light", ends, covariances, ("end 0", "end 1"), np.array([[0, 1]]))
    (found,) = Lights(Settings()).cross_row_landmarks([lamp])
    assert (found.id, found.axes, found.behind_m) == ("light 2", ("x", "y", "z"), None)
    assert found.place.tolist() == [1.6, 8.0, 1.5]
    assert np.allclose(found.covariance, 0.02 * np.eye(3))
