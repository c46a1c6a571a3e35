"""Edges of racks measured in panoramas: masks that are too wide no longer matter."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from rack_pictures import Camera, Picture

from savmap.geometry import pinhole, sphere
from savmap.types import Detection, Feature, Floats, Panorama, ViewSpec
from savmap.vision.networks.segmenter import regions
from savmap.vision.subpixel import RADIANCE
from savmap_shelves.boundaries import extract_features
from savmap_shelves.boundaries.features import Extraction, _beams, _separators
from savmap_shelves.boundaries.measuring import _face_axes, _with_edges
from savmap_shelves.boundaries.settings import BoundarySettings
from savmap_shelves.plugin import Shelves
from savmap_shelves.settings import ShelvesSettings

FACING = Picture(camera=Camera(x=1.3, y=2.1, z=1.6, hfov=118.0))
TURNED = Picture(camera=Camera(x=1.2, y=2.2, z=1.5, hfov=122.0, yaw=4.0, pitch=-3.0, roll=2.0))


def panorama_of(picture: Picture, height: int = 1024) -> Panorama:
    """What a camera would see: uprights and beams, each of one brightness, before a dark hall."""
    seen = 0.02 + 0.5 * picture.uprights + 0.2 * np.minimum(picture.beams, 1 - picture.uprights)
    v, u = np.mgrid[0:height, 0 : 2 * height].astype(np.float64)
    rays = sphere.rays_from_panorama_pixels(np.stack([u, v], axis=-1), height) @ picture.camera.spec.rig_from_view
    pixels = (
        np.nan_to_num(pinhole.project(rays, picture.camera.spec.camera), nan=-99.0).clip(-99, 2000).astype(np.float32)
    )
    seen = cv2.remap(seen, pixels[..., 0], pixels[..., 1], cv2.INTER_LINEAR, borderValue=0.02)
    grey = np.round(np.interp(seen, RADIANCE, np.arange(256))).astype(np.uint8)
    return Panorama(7, 0.5, np.repeat(grey[..., None], 3, axis=2))


def too_wide(picture: Picture) -> list[Detection]:
    """Masks that go a pixel beyond every edge."""
    kernel = np.ones((3, 3), np.uint8)
    return [
        detection
        for label, image in (("upright", picture.uprights), ("beam", picture.beams))
        for detection in regions(label, np.asarray(cv2.dilate(image, kernel), np.float32), 0.5, 30)
    ]


def errors(picture: Picture, features: list[Feature]) -> Floats:
    """Of edges, at their ends."""
    return np.array([picture.edge_error(feature) for feature in features if len(feature.pixels) == 2])


@pytest.mark.parametrize("picture", [FACING, TURNED], ids=["facing", "turned"])
def test_measured_edges_are_right_where_masks_are_too_wide(picture: Picture) -> None:
    detections = too_wide(picture)
    masked = extract_features(picture.view, detections)
    measured = extract_features(picture.view, detections, panorama=panorama_of(picture))
    assert len(masked) >= len(measured) > 60  # an edge that no piece shows is none
    assert np.median(errors(picture, masked)) > 0.7
    assert np.median(errors(picture, measured)) < 0.15


def test_corners_have_the_covariance_of_what_was_measured() -> None:
    measured = extract_features(FACING.view, FACING.detections(), panorama=panorama_of(FACING))
    corners = [feature for feature in measured if feature.label == "beam" and len(feature.pixels) == 1]
    sigma = np.array([np.sqrt(np.diag(corner.covariance[0])) for corner in corners])
    assert (sigma > 0).all()
    assert np.median(sigma) < 0.25


def test_parts_of_edges_lie_on_them_and_change_nothing_else() -> None:
    detections, panorama = FACING.detections(), panorama_of(FACING)
    whole = extract_features(FACING.view, detections, panorama=panorama)
    every = extract_features(FACING.view, detections, panorama=panorama, parts=True)
    parts = every[len(whole) :]
    for before, after in zip(whole, every, strict=False):
        assert (before.part, before.instance) == (after.part, after.instance)
        assert np.array_equal(before.pixels, after.pixels)
    edges = {(edge.label, edge.instance, edge.part): edge.pixels for edge in whole if len(edge.pixels) == 2}
    off = []
    for part in parts:
        first, last = edges[part.label, part.instance, part.part.removesuffix(" part")]
        across = np.array([first[1] - last[1], last[0] - first[0]]) / np.linalg.norm(last - first)
        off.append(float(across @ (part.pixels[0] - first)))
    assert {part.score for part in parts} == {0.0}
    assert len(parts) > 100
    assert np.median(np.abs(off)) < 0.1


def test_it_can_be_switched_off() -> None:
    detections, panorama = too_wide(FACING), panorama_of(FACING)
    on, off = (
        Shelves(ShelvesSettings(subpixel=on)).extract_features(FACING.view, detections, panorama)
        for on in (True, False)
    )
    plain = extract_features(FACING.view, detections)
    assert all(np.array_equal(a.pixels, b.pixels) for a, b in zip(off, plain, strict=True))
    assert not all(np.array_equal(a.pixels, b.pixels) for a, b in zip(on, plain, strict=True))


def test_the_faces_axes_follow_from_the_edges() -> None:
    extraction = Extraction(TURNED.view, BoundarySettings(), 0.3)
    separators = _separators(extraction, TURNED.detections())
    uprights = separators.strips[separators.kept]
    camera = TURNED.camera
    truth = pinhole.rig_from_view(camera.yaw, camera.pitch, camera.roll).T
    spec: ViewSpec = camera.spec
    axes = _face_axes(spec, uprights, _beams(extraction, TURNED.detections(), separators, True))
    assert np.abs(axes - truth).max() < 0.01
    none = uprights[np.zeros(len(uprights), dtype=np.bool_)]
    assert np.allclose(_face_axes(spec, none, none), np.eye(3))


def test_two_edges_that_are_measured_at_one_line_are_not_both_that_line() -> None:
    extraction = Extraction(FACING.view, BoundarySettings(), 0.3)
    beams = _beams(extraction, FACING.detections(), _separators(extraction, FACING.detections()), True)
    for line, both in ((beams.lower, "lower"), (beams.upper, "upper")):
        found = _with_edges(beams, line.joined(line))
        assert found.thickness == pytest.approx(beams.thickness), both
    separate = _with_edges(beams, beams.upper.joined(replace(beams.lower, offset=beams.lower.offset - 1.0)))
    assert separate.thickness == pytest.approx(beams.thickness - 1.0)


def test_a_beam_that_goods_hide_in_part_has_the_one_line_that_is_seen() -> None:
    extraction = Extraction(FACING.view, BoundarySettings(), 0.3)
    beams = _beams(extraction, FACING.detections(), _separators(extraction, FACING.detections()), True)
    hidden = np.arange(len(beams)) == 0
    shift = np.where(hidden, 0.7 * beams.thickness, 0.0)
    masks = replace(beams, upper=replace(beams.upper, offset=beams.upper.offset + shift))
    found = _with_edges(masks, beams.lower.joined(beams.lower))
    assert found.thickness[0] == pytest.approx(0.0, abs=0.01)
    assert (found.thickness[1:] > 1).all()
