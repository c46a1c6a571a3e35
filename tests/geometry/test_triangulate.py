"""Points from rays."""

import numpy as np
import pytest

from savmap.geometry.triangulate import midway, nearest_points


def test_midway_between_two_lines_is_nearest_to_both() -> None:
    rng = np.random.default_rng(3)
    origins, rays = rng.normal(size=(2, 5, 3)), rng.normal(size=(2, 5, 4, 3))
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    found = midway(origins[0][:, None], rays[0], origins[1][:, None], rays[1])
    for pair in range(5):
        expected = nearest_points(origins[:, pair], np.moveaxis(rays[:, pair], 0, 1))
        assert found[pair] == pytest.approx(expected, abs=1e-6)
