"""How far lamps reach in a picture of the ceiling, whatever part of them the network is sure of."""

import numpy as np
import pytest

from savmap.geometry.pinhole import project
from savmap.types import Bools, Detection, Feature, Floats
from savmap_lights.features import extract_features, is_by_mask
from savmap_lights.picture.bars import parts_of

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


def test_a_purlin_behind_a_lamps_housing_hides_no_end() -> None:
    grey = drawn.picture([], POSE)
    purlin = np.array([[X + 1.41, 6, -4], [X + 1.49, 6, -4], [X + 1.49, 6, 6], [X + 1.41, 6, 6]])
    for corners, value in (
        (purlin, 130),
        (drawn.strip(X - 1.4, X + 1.7), 165),
        (drawn.strip(X - 1.2, X + 1.4), drawn.BRIGHT),
    ):
        drawn.fill(grey, corners, POSE, value)
    ends = ends_of(extract_features(drawn.view_of(grey), drawn.seen(grey)))
    assert len(ends) == 2
    assert np.abs(ends - [pixel(X - 1.2), pixel(X + 1.4)]).max() < 1.0


def places_of(features: list[Feature]) -> list[str]:
    return [feature.part for feature in features if feature.part != "side"]


def test_a_compact_lamp_half_hidden_has_no_centre() -> None:
    lamp = drawn.strip(X - 0.1, X + 0.1)
    assert places_of(found([lamp], faded=False)) == ["centre"]
    assert places_of(found([lamp], beams=(X + 0.02,), faded=False)) == ["glimpse"]


def test_a_compact_lamps_centre_is_in_the_middle_of_what_shines() -> None:
    centre = found([drawn.strip(X - 0.1, X + 0.1)], faded=False)[0]
    assert np.abs(centre.pixels[0] - pixel(X)).max() < 0.3


@pytest.mark.parametrize(("case_m", "outlined"), [(0.07, True), (2.0, False)])
def test_a_lamp_in_a_lit_case_is_told_from_a_part_of_a_skylight(case_m: float, outlined: bool) -> None:
    # The case is so narrow that the brightness falls on from it to the ceiling: no fall at the lamp is most of that.
    grey = drawn.picture([], POSE)
    lamp = drawn.strip(X - 0.1, X + 0.1)
    case = drawn.strip(X - 0.1 - case_m, X + 0.1 + case_m)
    case[:, 2] += np.array([-case_m, -case_m, case_m, case_m])
    drawn.fill(grey, case, POSE, 170 if outlined else drawn.BRIGHT)
    drawn.fill(grey, lamp, POSE, drawn.BRIGHT)
    detections = drawn.seen(drawn.picture([lamp], POSE), faded=False)
    features = extract_features(drawn.view_of(grey), detections)
    assert [feature.part for feature in features if feature.part != "side"] == ["centre"]
    assert [is_by_mask(feature) for feature in features if feature.part == "centre"] == [not outlined]


def beside_a_bar(places: list[float], breadth_m: float = 0.06) -> tuple[list[Feature], Floats]:
    """The centres found, and the true ones (n, 2) px, of compact lamps along which a purlin runs, nearly as bright as they are."""
    lamps = [drawn.strip(x - 0.1, x + 0.1) for x in places]
    grey = drawn.picture(lamps, POSE)
    edge = drawn.LINE_Z_M + drawn.WIDTH_M / 2
    corners = np.array([[-9, drawn.HEIGHT_M, edge], [9, drawn.HEIGHT_M, edge]])
    corners = np.concatenate([corners, corners[::-1] + np.array([0, 0, breadth_m])])
    pixels = project((corners - POSE[:3, 3]) @ POSE[:3, :3] @ drawn.CEILING.rig_from_view, drawn.CEILING.camera)
    first, last = np.sort(np.round(pixels[[0, 2], 1]).astype(int))
    grey[first:last] = np.maximum(grey[first:last], 248)
    features = extract_features(drawn.view_of(grey), drawn.seen(grey, faded=False))
    centres = sorted((f for f in features if f.part == "centre"), key=lambda f: float(f.pixels[0, 0]))
    return centres, np.array([pixel(x) for x in places])


def test_compact_lamps_that_a_bright_bar_joins_are_found_one_by_one() -> None:
    centres, true = beside_a_bar([X - 1.2, X - 0.1, X + 0.9])
    assert len(centres) == 3
    assert np.abs(np.array([f.pixels[0] for f in centres]) - true).max() < 1.0


def test_a_bar_beside_a_compact_lamp_is_no_part_of_it() -> None:
    centres, true = beside_a_bar([X + 0.3])
    assert len(centres) == 1
    assert np.abs(centres[0].pixels[0] - true[0]).max() < 1.0


def detection_of(mask: Bools) -> Detection:
    return Detection("light", 0.9, mask, mask.astype(np.float32))


def test_only_masks_with_thin_parts_are_parted() -> None:
    mask = np.zeros((60, 200), np.bool_)
    mask[20:40, 10:190] = True
    assert parts_of(detection_of(mask)) == []
    mask[:] = False
    mask[20:40, 10:30] = mask[20:40, 150:170] = mask[36:40, 10:170] = True
    first, second = (part.mask for part in parts_of(detection_of(mask)))
    assert first.sum() == second.sum() == 400
    assert not (first & second).any()
