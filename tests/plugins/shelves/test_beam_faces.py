"""Where marks on beams are looked for."""

import numpy as np
import pytest

from savmap.types import Floats
from savmap_shelves.evidence import beam_faces


def grid_points(z: float = -0.01) -> dict[str, Floats]:
    """Landmarks of two posts 10 cm wide, 2 m apart, and of two beams 10 cm high between them."""
    points = {
        f"upright {n} / {side} / front": np.array([x + 0.1 * (side == "right"), 1.0, 0.0])
        for n, x in ((1, 0.0), (2, 2.0))
        for side in ("left", "right")
    }
    for beam, low in ((1, 0.2), (2, 1.5)):
        for edge, y in (("lower", low), ("upper", low + 0.1)):
            for side, x in (("left", 0.1), ("right", 2.0)):
                points[f"bay 1 / beam {beam} / {edge} {side}"] = np.array([x, y, z])
    return points


def test_beams_faces_lie_within_their_edges_and_ends() -> None:
    (flat,) = beam_faces(grid_points())
    assert (flat.landmark, flat.axis) == ("bay 1 / beam 1 / lower left", "z")
    assert [part.name for part in flat.parts] == ["bay 1 / beam 1", "bay 1 / beam 2"]
    for part, low in zip(flat.parts, (0.2, 1.5), strict=True):
        assert part.origin == pytest.approx([0.175, low + 0.012, -0.01])
        assert part.size == pytest.approx([1.75, 0.076])
        assert np.cross(part.right, part.up) == pytest.approx([0, 0, 1])


def test_what_is_stuck_on_a_beam_stands_out_from_it() -> None:
    (flat,) = beam_faces(grid_points())
    assert (flat.proud_m, flat.proud_sigma_m) == (0.001, 0.001)


def test_without_whole_beams_there_are_no_faces() -> None:
    posts = {name: at for name, at in grid_points().items() if name.startswith("upright")}
    assert beam_faces(posts) == []
    lower = {name: at for name, at in grid_points().items() if "upper" not in name}
    assert beam_faces(lower) == []
