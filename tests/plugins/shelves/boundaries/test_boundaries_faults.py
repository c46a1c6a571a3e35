"""Edges and corners where masks are missed, doubled, cut, too wide, joined or askew (paper, section III.C)."""

from dataclasses import replace

import numpy as np
import pytest
from extracted import CAMERAS, FACING, columns_of, counts, found, of, without, worst
from rack_pictures import HEIGHT, WIDTH, Image, Picture, Rack, painted, soften

from savmap.types import Detection
from savmap.vision.networks.segmenter import regions
from savmap_shelves.boundaries import extract_features
from savmap_shelves.boundaries.settings import BoundarySettings


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


def test_uprights_incomplete_in_length_are_kept_down_to_a_half_and_extended() -> None:
    picture = Picture(camera=FACING)
    rows = np.flatnonzero(picture.uprights.max(axis=1) > 0.5)
    kept = found(picture, upright=without(picture.uprights, slice(0, rows[-1] - HEIGHT // 2 - 4), slice(None)))
    assert counts(kept) == counts(found(picture))
    assert worst(picture, kept) < 0.3
    left = slice(0, WIDTH // 2)
    half = found(picture, upright=without(picture.uprights, slice(0, rows[-1] - HEIGHT // 2 + 8), left))
    assert 0 < counts(half)[0] < counts(kept)[0]
    assert {feature.pixels[0, 0] < WIDTH // 2 for feature in of(half, "upright", "left")} == {False}
    assert counts(half)[1] == counts(found(picture))[1], "short uprights still separate bays"


def test_a_half_is_of_the_rack_where_the_view_is_wider_than_its_height_needs() -> None:
    """The whole rack is lower in the picture than half of it: its uprights count, half-high ones beside them do not."""
    picture = Picture(camera=FACING)
    rows = np.flatnonzero(picture.uprights.max(axis=1) > 0.5)
    cut = slice(0, rows[-1] - 2 * HEIGHT // 5)
    low = without(picture.uprights, cut, slice(None))
    assert counts(found(picture, upright=low))[0] == counts(found(picture))[0]
    lower = without(low, slice(0, rows[-1] - HEIGHT // 6), slice(0, WIDTH // 2))
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


def test_a_mask_that_goods_split_is_one_strip() -> None:
    picture = Picture(camera=FACING)
    columns = columns_of(picture, picture.rack.sections[3], 0)
    third = (columns.stop - columns.start) // 3
    shown = np.ones((2, *picture.beams.shape), np.bool_)
    shown[0, :, columns.start + third : columns.start + third + 20] = False
    shown[1, 200:260] = False
    detections = [replace(one, mask=one.mask & shown[int(one.label == "upright")]) for one in picture.detections()]
    features = [feature for feature in extract_features(picture.view, detections) if feature.part != "foot"]
    assert counts(features) == counts(found(picture))
    assert worst(picture, features) < 0.4


def test_beams_that_run_on_over_uprights_are_cut_there() -> None:
    picture = Picture(camera=FACING)
    beam = np.zeros_like(picture.beams)
    for y in picture.rack.beams:
        painted(beam, picture.camera.quad((picture.rack.uprights[0][0], picture.rack.uprights[-1][1]), y))
    features = found(picture, beam=beam)
    assert counts(features) == counts(found(picture))
    assert worst(picture, features) < 0.3


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
