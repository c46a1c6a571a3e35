"""Edges and corners of clean masks."""

import numpy as np
import pytest
from extracted import CAMERAS, FACING, LEVELS, counts, everything, found, of, worst
from rack_pictures import HEIGHT, WIDTH, Camera, Picture, Rack

from savmap_shelves.boundaries import extract_features


@pytest.mark.slow
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
