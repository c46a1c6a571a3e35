"""Where second readings of beams' edges are looked for: nowhere beside the camera, or behind it."""

import numpy as np
from savmap_shelves.boundaries.second import Rays, places_of

from savmap.geometry import pinhole
from savmap.geometry.lines import Lines
from savmap.types import ViewSpec
from savmap_shelves.boundaries.strips import Strips

SPEC = ViewSpec("face", 0.0, hfov_deg=150.0)


def level(rows: list[float]) -> Lines:
    none = np.zeros(len(rows))
    return Lines(none + 320, none, np.array(rows), none, none, none + 5, none + 635, none + 50)


def beams(upper: list[float], lower: list[float]) -> Strips:
    """Level strips right across the view."""
    none = np.zeros(len(upper))
    return Strips(level(upper), level(lower), np.arange(len(upper)), none + 5, none + 635, none + 630, none + 1.0)


def test_a_beam_unlike_the_others_is_looked_at_again_where_they_would_have_it() -> None:
    found = places_of(beams([100.0, 200.0, 300.0], [106.0, 206.0, 312.0]), Rays(SPEC, np.eye(3)))
    assert found is not None
    assert found.beam.tolist() == [2, 2]
    assert np.allclose(found.like.at(320.0), [306.0, 306.0])


def test_nothing_is_looked_for_behind_the_camera() -> None:
    """A camera in somebody's hand: the face is so far turned that the left part of the view looks away from it."""
    turned = Rays(SPEC, pinhole.rig_from_view(40.0, 0.0, 0.0))
    strips = beams([100.0, 200.0, 300.0], [106.0, 206.0, 312.0])
    assert np.isnan(turned.on_face(np.array([5.0]), np.array([100.0]))).all()
    assert places_of(strips, turned) is None
