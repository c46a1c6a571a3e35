"""Edges of racks measured in panoramas along the outlines of what was found."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from rack_pictures import Camera, Picture

from savmap.geometry import pinhole, sphere
from savmap.types import Feature, Floats, FoundObject, Panorama
from savmap.vision.subpixel import RADIANCE
from savmap_shelves.edges import measure

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


def pose_of(camera: Camera) -> Floats:
    """world_from_rig (4, 4) of a rig that looks straight at the face, where the camera is turned in it."""
    pose = np.eye(4)
    turn = pinhole.rig_from_view(camera.yaw, camera.pitch, camera.roll)
    pose[:3, :3] = np.diag([1.0, -1.0, -1.0]) @ turn @ camera.spec.rig_from_view.T
    pose[:3, 3] = camera.x, camera.y, camera.z
    return pose


def found(picture: Picture, off: float = 0.0) -> list[FoundObject]:
    """The rack's members, their outlines so far (m) outside of their edges."""

    def item(name: str, label: str, x: tuple[float, float], y: tuple[float, float]) -> FoundObject:
        corners = np.array([[x[0], y[0], 0], [x[1], y[0], 0], [x[1], y[1], 0], [x[0], y[1], 0]])
        return FoundObject(name, label, corners, 1.0)

    rack = picture.rack
    objects = [
        item(f"upright {number}", "upright", (x[0] - off, x[1] + off), (0.0, rack.height))
        for number, x in enumerate(rack.uprights, 1)
    ]
    return objects + [
        item(f"bay {bay} / beam {number}", "beam", x, (y[0] - off, y[1] + off))
        for bay, x in enumerate(rack.sections, 1)
        for number, y in enumerate(rack.beams, 1)
    ]


def measured(picture: Picture, objects: list[FoundObject], parts: bool = False, seen: float = 1.0) -> list[Feature]:
    scores = seen * np.stack([picture.uprights, picture.beams])[:, ::2, ::2]
    pose, panorama = pose_of(picture.camera), panorama_of(picture)
    return measure(objects, picture.camera.spec, 7, pose, scores.astype(np.float32), panorama, parts)


def edges(features: list[Feature]) -> list[Feature]:
    return [feature for feature in features if len(feature.pixels) == 2]


def corners(features: list[Feature]) -> list[Feature]:
    return [feature for feature in features if feature.label == "beam" and len(feature.pixels) == 1]


@pytest.mark.parametrize("picture", [FACING, TURNED], ids=["facing", "turned"])
@pytest.mark.parametrize("off", [0.0, 0.006])
def test_edges_are_right_where_outlines_are_a_little_off(picture: Picture, off: float) -> None:
    features = measured(picture, found(picture, off))
    errors = np.array([picture.edge_error(feature) for feature in edges(features)])
    assert len(errors) > 30
    assert np.median(errors) < 0.15
    assert {feature.axis for feature in edges(features)} == {"x", "y"}
    away = np.array([picture.edge_error(feature) for feature in corners(features)])
    assert len(away) > 40
    assert np.median(away) < 0.3
    sigma = np.array([np.sqrt(np.diag(corner.covariance[0])) for corner in corners(features)])
    assert 0 < np.median(sigma) < 0.25


def test_what_the_network_does_not_see_in_a_frame_is_not_measured_in_it() -> None:
    assert measured(FACING, found(FACING), seen=0.04) == []
    assert (
        measured(FACING, [replace(item, outline=item.outline + np.array([0, 0, 5.0])) for item in found(FACING)]) == []
    )
    assert measured(FACING, []) == []


def test_an_edge_that_the_picture_does_not_show_is_left_out() -> None:
    """A beam where there is none: its corners are nowhere."""
    objects = [item for item in found(FACING) if item.label == "upright"]
    none = next(item for item in found(FACING) if item.id == "bay 4 / beam 2")
    objects.append(replace(none, outline=none.outline + np.array([0.0, 0.25, 0.0])))
    assert corners(measured(FACING, objects)) == []


def test_two_edges_at_one_line_are_not_both_that_line() -> None:
    """A beam that is taken for half as thick as it is has one of its edges only."""
    objects = [item for item in found(FACING) if item.label == "upright"]
    beam = next(item for item in found(FACING) if item.id == "bay 4 / beam 2")
    outline = beam.outline.copy()
    outline[:2, 1] = outline[2:, 1] - 0.015
    parts = {feature.part.split()[0] for feature in measured(FACING, [*objects, replace(beam, outline=outline)])}
    assert "upper" in parts
    assert "lower" not in parts


def test_feet_are_where_outlines_end_inside_the_view() -> None:
    low = Picture(camera=Camera(x=1.3, y=1.6, z=1.6, hfov=118.0))
    features = measured(low, found(low))
    feet = [feature for feature in features if feature.part == "foot"]
    assert {foot.object for foot in feet} >= {"upright 4", "upright 5"}
    for foot in feet:
        x = low.rack.uprights[int(foot.object.split()[1]) - 1]
        assert foot.pixels[0] == pytest.approx(low.camera.pixels(sum(x) / 2, 0.0), abs=0.01)


def test_parts_of_edges_lie_on_them_and_change_nothing_else() -> None:
    whole, every = measured(FACING, found(FACING)), measured(FACING, found(FACING), parts=True)
    for before, after in zip(whole, every, strict=False):
        assert (before.part, before.object) == (after.part, after.object)
        assert np.array_equal(before.pixels, after.pixels)
    of_edge = {(edge.object, edge.part): edge.pixels for edge in edges(whole)}
    off = []
    for part in every[len(whole) :]:
        name = part.object, part.part.removesuffix(" part")
        if name in of_edge:
            first, last = of_edge[name]
            across = np.array([first[1] - last[1], last[0] - first[0]]) / np.linalg.norm(last - first)
            off.append(float(across @ (part.pixels[0] - first)))
    assert {part.score for part in every[len(whole) :]} == {0.0}
    assert len(off) > 80
    assert np.median(np.abs(off)) < 0.1
