"""How far lamps reach in a picture of the ceiling, whatever part of them the network is sure of."""

import numpy as np

from savmap.geometry.pinhole import project
from savmap.types import Feature, Floats
from savmap_lights.features import extract_features

from . import drawn_ceiling as drawn

POSE = drawn.path().world_from_rig[12]
X = float(POSE[0, 3])


def pixel(x: float) -> Floats:
    point = np.array([[x, drawn.HEIGHT_M, drawn.LINE_Z_M]])
    return project((point - POSE[:3, 3]) @ POSE[:3, :3] @ drawn.CEILING.rig_from_view, drawn.CEILING.camera)[0]


def found(lamps: list[Floats], beams: tuple[float, ...] = (), faded: bool = True) -> list[Feature]:
    grey = drawn.picture(lamps, POSE, beams)
    return extract_features(drawn.view_of(grey), drawn.seen(grey, faded))


def ends_of(features: list[Feature]) -> Floats:
    """Ends (n, 2) px, from the left."""
    ends = np.array([f.pixels[0] for f in features if f.part.startswith("end")]).reshape(-1, 2)
    return ends[np.argsort(ends[:, 0])]


def test_a_strip_whose_mask_fades_ends_where_it_does() -> None:
    ends = ends_of(found([drawn.strip(X - 1.2, X + 1.4)]))
    assert len(ends) == 2
    assert np.abs(ends - [pixel(X - 1.2), pixel(X + 1.4)]).max() < 0.6


def test_a_line_of_light_has_ends_at_its_joints() -> None:
    lamps = [drawn.strip(X - 2.0, X - 0.42), drawn.strip(X - 0.36, X + 1.2)]
    ends = ends_of(found(lamps))
    wanted = np.array([pixel(x) for x in (X - 2.0, X - 0.42, X - 0.36, X + 1.2)])
    assert np.abs(ends - wanted).max() < 0.8


def test_what_a_beam_hides_of_a_strip_is_no_end() -> None:
    ends = ends_of(found([drawn.strip(X - 1.5, X + 1.5)], beams=(X,)))
    assert np.abs(ends - [pixel(X - 1.5), pixel(X + 1.5)]).max() < 0.6


def places_of(features: list[Feature]) -> list[str]:
    return [feature.part for feature in features if feature.part != "side"]


def test_a_compact_lamp_half_hidden_has_no_centre() -> None:
    lamp = drawn.strip(X - 0.1, X + 0.1)
    assert places_of(found([lamp], faded=False)) == ["centre"]
    assert places_of(found([lamp], beams=(X + 0.02,), faded=False)) == ["glimpse"]


def test_a_compact_lamps_centre_is_in_the_middle_of_what_shines() -> None:
    centre = found([drawn.strip(X - 0.1, X + 0.1)], faded=False)[0]
    assert np.abs(centre.pixels[0] - pixel(X)).max() < 0.3
