from dataclasses import replace

import numpy as np
import pytest
from rack_pictures import HEIGHT, WIDTH, Camera, Image, Picture, Rack, painted, soften

from savmap.stages.segment import regions
from savmap.types import Detection, Feature
from savmap_shelves.boundaries import extract_features
from savmap_shelves.boundary_settings import BoundarySettings

FACING = Camera(x=1.3, y=2.1, z=1.6, hfov=118.0)
CAMERAS = {
    "facing": FACING,
    "wide": Camera(x=0.6, y=2.0, z=1.0, hfov=150.0),
    "narrow": Camera(x=1.3, y=2.1, z=3.4, hfov=80.0),
    "turned": Camera(x=1.5, y=2.2, z=1.5, hfov=122.0, yaw=5.0, pitch=-3.0, roll=3.0),
    "steep": Camera(x=1.0, y=2.0, z=0.75, hfov=155.0, yaw=-4.0, pitch=2.0, roll=-2.0),
}
LEVELS = {
    "few": Rack(),
    "many": Rack(beams=[(0.1 + 0.37 * i, 0.18 + 0.37 * i) for i in range(11)]),
}


def found(picture: Picture, upright: Image | None = None, beam: Image | None = None) -> list[Feature]:
    upright = picture.uprights if upright is None else upright
    beam = picture.beams if beam is None else beam
    features = everything(picture, upright, beam)
    return [feature for feature in features if feature.part != "foot"]


def everything(picture: Picture, upright: Image, beam: Image) -> list[Feature]:
    return extract_features(picture.view, [*regions("upright", upright, 0.5, 30), *regions("beam", beam, 0.5, 30)])


def of(features: list[Feature], label: str, part: str) -> list[Feature]:
    return [feature for feature in features if (feature.label, feature.part) == (label, part)]


def worst(picture: Picture, features: list[Feature]) -> float:
    assert features
    return max(picture.edge_error(feature) for feature in features)


def counts(features: list[Feature]) -> tuple[int, int, int]:
    """Uprights, beams, corners."""
    corners = sum(len(feature.pixels) == 1 for feature in features)
    return len(of(features, "upright", "left")), len(of(features, "beam", "lower")), corners


@pytest.mark.parametrize("levels", LEVELS)
@pytest.mark.parametrize("camera", CAMERAS)
def test_clean_masks_give_every_edge_within_a_third_of_a_pixel(camera: str, levels: str) -> None:
    picture = Picture(LEVELS[levels], CAMERAS[camera])
    features = found(picture)
    assert counts(features)[0] == sum(picture.measurable(x) for x in picture.rack.uprights) >= 2
    corners = np.concatenate([feature.pixels for feature in features if len(feature.pixels) == 1])
    distances = np.linalg.norm(picture.corners[:, None] - corners, axis=-1)
    assert len(picture.corners) >= 40
    assert distances.min(axis=1).max() < 0.3, "none is missing"
    assert worst(picture, features) < 0.3, "none is false"


def test_feet_are_where_uprights_end_inside_the_frame() -> None:
    picture = Picture(Rack(), Camera(x=2.0, y=2.0, z=2.2, hfov=120.0))
    feet = of(everything(picture, picture.uprights, picture.beams), "upright", "foot")
    truth = np.array([picture.camera.pixels((a + b) / 2, 0.0) for a, b in picture.rack.uprights])
    for foot in feet:
        assert np.linalg.norm(truth - foot.pixels[0], axis=1).min() < 1.0
    assert len(feet) >= 2


def test_a_beam_that_its_mask_hardly_covers_scores_low() -> None:
    picture = Picture()
    hidden = picture.beams.copy()
    for left, right in picture.rack.sections:
        ends = [picture.camera.pixels(x, 2.0)[0] for x in (left + 0.3 * (right - left), right)]
        first, last = np.clip(np.nan_to_num(ends), 0, hidden.shape[1]).astype(int)
        hidden[:, first:last] = 0
    whole = {f.instance: f.score for f in of(found(picture), "beam", "lower")}
    part = [f.score for f in of(found(picture, beam=hidden), "beam", "lower")]
    assert min(whole.values()) > 0.8
    assert min(part) < 0.6


def test_features_are_labelled_as_agreed() -> None:
    picture = Picture(camera=FACING)
    features = found(picture)
    lefts, rights = of(features, "upright", "left"), of(features, "upright", "right")
    assert [f.instance for f in lefts] == [f.instance for f in rights] == list(range(len(lefts)))
    assert all(a.pixels[0, 0] < b.pixels[0, 0] for a, b in zip(lefts, rights, strict=True))
    assert all(np.allclose(f.pixels[:, 1], [-0.5, HEIGHT - 0.5]) and f.axis == "y" for f in lefts + rights)
    corner = of(features, "beam", "upper left")[0]
    assert corner.axis is None
    inner = rights[corner.neighbours["left"]]
    assert abs(corner.pixels[0, 0] - np.interp(corner.pixels[0, 1], inner.pixels[:, 1], inner.pixels[:, 0])) < 1e-6
    edge = next(f for f in of(features, "beam", "upper") if f.instance == corner.instance)
    assert edge.axis == "x"
    np.testing.assert_allclose(edge.pixels[0], corner.pixels[0])
    assert {f.frame for f in features} == {7}
    assert {f.view for f in features} == {"face"}


def test_lower_edges_are_below_upper_ones_and_beams_end_at_detected_uprights_only() -> None:
    picture = Picture(camera=FACING)
    features = found(picture)
    for lower, upper in zip(of(features, "beam", "lower"), of(features, "beam", "upper"), strict=True):
        assert lower.instance == upper.instance
        assert (lower.pixels[:, 1] > upper.pixels[:, 1]).all()
        corners = {f.part for f in features if f.instance == lower.instance and len(f.pixels) == 1}
        assert corners == {f"{level} {role}" for level in ("lower", "upper") for role in lower.neighbours}


def test_covariances_are_long_along_edges_and_never_too_good_across() -> None:
    features = found(Picture(camera=FACING))
    for feature in features:
        values = np.linalg.eigvalsh(feature.covariance)
        assert (values[:, 0] >= 0.3**2 - 1e-9).all()
        assert (values[:, 1] >= 200**2 - 1).all() if len(feature.pixels) == 2 else (values[:, 1] < 1).all()


def test_nothing_detected_gives_nothing() -> None:
    assert extract_features(Picture().view, []) == []


def test_beams_without_uprights_have_edges_but_no_corners() -> None:
    picture = Picture(camera=FACING)
    features = found(picture, upright=np.zeros((HEIGHT, WIDTH), dtype=np.float32))
    assert counts(features)[0] == counts(features)[2] == 0
    assert worst(picture, of(features, "beam", "upper")) < 0.3


def without(image: Image, rows: slice, columns: slice) -> Image:
    changed = image.copy()
    changed[rows, columns] = 0
    return changed


def columns_of(picture: Picture, x: tuple[float, float], margin: int = 3) -> slice:
    low, high = sorted(int(picture.camera.pixels(at, 2.0)[0]) for at in x)
    return slice(max(low - margin, 0), high + margin + 1)


def test_a_missed_beam_changes_nothing_else() -> None:
    picture = Picture(camera=FACING)
    box = np.round(picture.camera.quad(picture.rack.sections[3], picture.rack.beams[2])).astype(int)
    beam = without(picture.beams, slice(box[0, 1] - 3, box[2, 1] + 4), slice(box[0, 0] - 3, box[1, 0] + 4))
    features, complete = found(picture, beam=beam), found(picture)
    assert counts(features)[1] == counts(complete)[1] - 1
    assert counts(features)[2] == counts(complete)[2] - 4
    assert worst(picture, features) < 0.3


def test_a_missed_upright_takes_only_its_own_corners() -> None:
    picture = Picture(camera=CAMERAS["wide"])
    complete = found(picture)
    gone = picture.rack.uprights[3]
    features = found(picture, upright=without(picture.uprights, slice(None), columns_of(picture, gone)))
    assert counts(features)[0] == counts(complete)[0] - 1
    assert worst(picture, [f for f in features if len(f.pixels) == 2]) < 0.3


@pytest.mark.parametrize("shift", [(0, 0), (3, 0), (0, 4), (-6, 5)])
def test_of_duplicated_masks_the_longest_is_kept(shift: tuple[int, int]) -> None:
    picture = Picture(camera=FACING)
    detections = picture.detections()
    extra = [_shortened(_moved(detection, shift)) for detection in detections]
    features = [f for f in extract_features(picture.view, [*extra, *detections]) if f.part != "foot"]
    assert counts(features) == counts(found(picture))
    assert worst(picture, features) < 0.3


def _moved(detection: Detection, shift: tuple[int, int]) -> Detection:
    return replace(detection, mask=np.roll(detection.mask, shift, axis=(1, 0)))


def _shortened(detection: Detection) -> Detection:
    mask = detection.mask.copy()
    rows, columns = np.nonzero(mask)
    if detection.label == "beam":
        mask[:, int(np.quantile(columns, 0.8)) :] = False
    else:
        mask[int(np.quantile(rows, 0.8)) :] = False
    return replace(detection, mask=mask)


def test_beams_incomplete_in_length_are_extended_to_the_uprights() -> None:
    picture = Picture(camera=FACING)
    columns = columns_of(picture, picture.rack.sections[3])
    third = (columns.stop - columns.start) // 3
    features = found(picture, beam=without(picture.beams, slice(None), slice(columns.start, columns.start + third)))
    assert counts(features) == counts(found(picture))
    assert worst(picture, features) < 0.4


def test_uprights_incomplete_in_length_are_kept_down_to_five_eighths_and_extended() -> None:
    picture = Picture(camera=FACING)
    rows = np.flatnonzero(picture.uprights.max(axis=1) > 0.5)
    kept = found(picture, upright=without(picture.uprights, slice(0, rows[-1] - 5 * HEIGHT // 8 - 4), slice(None)))
    assert counts(kept) == counts(found(picture))
    assert worst(picture, kept) < 0.3
    left = slice(0, WIDTH // 2)
    half = found(picture, upright=without(picture.uprights, slice(0, rows[-1] - 5 * HEIGHT // 8 + 8), left))
    assert 0 < counts(half)[0] < counts(kept)[0]
    assert {feature.pixels[0, 0] < WIDTH // 2 for feature in of(half, "upright", "left")} == {False}
    assert counts(half)[1] == counts(found(picture))[1], "short uprights still separate sections"


def test_five_eighths_are_of_the_rack_where_the_view_is_wider_than_its_height_needs() -> None:
    """The whole rack is lower in the picture than 5/8 of it: its uprights count, half-high ones beside them do not."""
    picture = Picture(camera=FACING)
    rows = np.flatnonzero(picture.uprights.max(axis=1) > 0.5)
    cut = slice(0, rows[-1] - HEIGHT // 2)
    low = without(picture.uprights, cut, slice(None))
    assert counts(found(picture, upright=low))[0] == counts(found(picture))[0]
    lower = without(low, slice(0, rows[-1] - HEIGHT // 4), slice(0, WIDTH // 2))
    assert 0 < counts(found(picture, upright=lower))[0] < counts(found(picture))[0]


@pytest.mark.parametrize("level", ["lower", "upper"])
def test_masks_too_wide_in_a_part_of_their_length_do_not_move_edges(level: str) -> None:
    picture = Picture(camera=FACING)
    beam = picture.beams.copy()
    x = picture.rack.sections[3]
    for bottom, top in picture.rack.beams:
        wide = (bottom - 0.05, top) if level == "lower" else (bottom, top + 0.05)
        painted(beam, picture.camera.quad((x[0], x[0] + 0.35 * (x[1] - x[0])), wide))
    features = found(picture, beam=beam)
    assert counts(features) == counts(found(picture))
    assert worst(picture, features) < 0.5


def test_masks_too_wide_in_all_their_length_move_one_edge_by_no_more_than_that() -> None:
    picture = Picture(camera=FACING)
    beam = picture.beams.copy()
    bottom, top = picture.rack.beams[2]
    painted(beam, picture.camera.quad(picture.rack.sections[3], (bottom - 0.03, top)))
    features = found(picture, beam=beam)
    excess = 0.03 / 0.1 * _height_px(picture)
    assert counts(features) == counts(found(picture))
    assert worst(picture, [f for f in features if "upper" in f.part]) < 0.3
    assert worst(picture, [f for f in features if "lower" in f.part]) < excess + 0.3


def _height_px(picture: Picture) -> float:
    quad = picture.camera.quad(picture.rack.sections[3], picture.rack.beams[2])
    return float(quad[3, 1] - quad[0, 1])


def test_goods_that_split_and_notch_beams_leave_one_beam_with_the_same_edges() -> None:
    picture = Picture(camera=FACING)
    beam = picture.beams.copy()
    columns = columns_of(picture, picture.rack.sections[3], 0)
    width = columns.stop - columns.start
    split = soften(np.ones(beam.shape, dtype=np.bool_))
    split[:, columns.start + width // 3 : columns.start + width // 2] = 0
    for bottom, top in picture.rack.beams:
        row = int(picture.camera.pixels(1.3, (bottom + top) / 2)[1])
        split[row - 30 : row, columns.start + 6 * width // 10 : columns.start + 8 * width // 10] = 0
    features = found(picture, beam=beam * soften(split > 0.5))
    assert counts(features) == counts(found(picture))
    assert worst(picture, features) < 0.4


def test_an_upright_hidden_in_its_middle_stays_one() -> None:
    picture = Picture(camera=FACING)
    features = found(picture, upright=without(picture.uprights, slice(200, 260), slice(None)))
    assert counts(features) == counts(found(picture))
    assert worst(picture, features) < 0.3


def test_beams_that_run_on_over_uprights_are_cut_there() -> None:
    picture = Picture(camera=FACING)
    beam = np.zeros_like(picture.beams)
    for y in picture.rack.beams:
        painted(beam, picture.camera.quad((picture.rack.uprights[0][0], picture.rack.uprights[-1][1]), y))
    features = found(picture, beam=beam)
    assert counts(features) == counts(found(picture))
    assert worst(picture, features) < 0.3


def test_masks_of_two_beams_joined_by_a_false_bridge_are_taken_apart() -> None:
    picture = Picture(camera=FACING)
    beam = picture.beams.copy()
    painted(beam, picture.camera.quad((1.2, 1.5), (picture.rack.beams[1][0], picture.rack.beams[3][1])))
    features = found(picture, beam=beam)
    assert counts(features) == counts(found(picture))
    assert worst(picture, features) < 0.4


def wedge(image: Image, left: tuple[float, float], right: tuple[float, float], x: tuple[float, float]) -> Image:
    changed = image.copy()
    painted(changed, np.array([[x[0], left[0]], [x[1], right[0]], [x[1], right[1]], [x[0], left[1]]]))
    return changed


def test_askew_beams_are_dropped() -> None:
    picture = Picture(Rack(beams=[(0.1, 0.2), (0.8, 0.9), (2.4, 2.5), (3.4, 3.5)]), FACING)
    columns = columns_of(picture, picture.rack.sections[3], -6)
    row = float(picture.camera.pixels(1.3, 1.7)[1])
    beam = wedge(picture.beams, (row - 12, row + 12), (row - 3, row + 3), (columns.start, columns.stop))
    assert counts(found(picture, beam=beam)) == counts(found(picture))
    masks = [*regions("upright", picture.uprights, 0.5, 30), *regions("beam", beam, 0.5, 30)]
    published = BoundarySettings(perspective_tolerance=1.0)
    lenient = BoundarySettings(perspective_tolerance=1.0, askew_sigmas=1e6)
    assert counts(extract_features(picture.view, masks, published)) == counts(found(picture))
    assert counts(extract_features(picture.view, masks, lenient))[1] == counts(found(picture))[1] + 1


def test_askew_uprights_are_dropped() -> None:
    picture = Picture(camera=FACING)
    middle = float(picture.camera.pixels(1.3, 2.0)[0])
    quad = np.array([[middle - 15, 20], [middle + 15, 20], [middle + 1, 460], [middle - 1, 460]])
    upright = picture.uprights.copy()
    painted(upright, quad)
    assert counts(found(picture, upright=upright))[0] == counts(found(picture))[0]


def test_what_converges_as_the_whole_face_does_is_not_askew() -> None:
    picture = Picture(camera=Camera(x=1.0, y=2.1, z=0.9, hfov=152.0, yaw=15.0))
    assert worst(picture, found(picture)) < 0.3
    vanishing = picture.camera.spec.camera[0, 0] / np.tan(np.radians(15))
    assert vanishing < 0.6 * WIDTH, "the beams do meet within the enlarged picture"
    assert counts(found(picture))[1] >= 18


def test_a_picture_cut_upright_is_not_measured() -> None:
    camera = replace(FACING, x=1.3)
    left = float(camera.pixels(camera.x, 2.0)[0])
    scale = float(camera.pixels(camera.x + 1, 2.0)[0]) - left
    at = camera.x - left / scale
    picture = Picture(Rack(uprights=[(at - 0.05, at + 0.05), (at + 2.0, at + 2.1), (at + 4.0, at + 4.1)]), camera)
    features = found(picture)
    assert counts(features)[0] == sum(picture.measurable(x) for x in picture.rack.uprights)
    assert worst(picture, features) < 0.3


def test_covariances_are_honest_for_rough_masks() -> None:
    rng = np.random.default_rng(5)
    squares = []
    for _ in range(6):
        picture = Picture(camera=replace(FACING, x=float(rng.uniform(0.5, 2.0))))
        settings = BoundarySettings(least_sigma_px=0.02)
        rough = [_rough(image, rng) for image in (picture.uprights, picture.beams)]
        masks = [*regions("upright", rough[0], 0.5, 30), *regions("beam", rough[1], 0.5, 30)]
        for feature in extract_features(picture.view, masks, settings):
            if len(feature.pixels) == 1 and feature.part != "foot":
                offset = picture.corner_offset(feature)
                squares.append(offset @ np.linalg.inv(feature.covariance[0]) @ offset / 2)
    assert len(squares) > 150
    assert 0.5 < np.median(squares) / 0.69 < 2.0, "chi-square with two degrees of freedom, halved: its median is 0.69"


def _rough(image: Image, rng: np.random.Generator) -> Image:
    noise = soften(rng.normal(0, 1, image.shape) > 0) - 0.5
    clipped = np.clip(image, 1e-4, 1 - 1e-4)
    return np.asarray(1 / (1 + np.exp(-np.log(clipped / (1 - clipped)) - 4 * noise)), dtype=np.float32)
