"""Which face each pixel sees: a z-buffer over each face's region."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.geometry.pinhole import focal_px, rig_from_view
from savmap.lab.sim.paint.faces import MOST_CORNERS, Faces, Singles
from savmap.types import Bools, Floats

NEAR_M = 0.08
NOTHING = -1

_SHIFT = 4
_FARTHEST_PX = 2.0e6
_LEAST_PX = 0.8
"""Faces whose region is smaller are not drawn."""


@dataclass(frozen=True)
class Camera:
    """A pinhole camera. View frame: x right, y down, z forward; pixel centres at integers."""

    origin: Floats  # (3,) world
    world_from_view: Floats  # (3, 3)
    hfov_deg: float

    def pixels(self, width: int, height: int) -> tuple[float, float, float]:
        """Focal length and principal point of a picture of this size."""
        return focal_px(self.hfov_deg, width), (width - 1) / 2, (height - 1) / 2


def camera_at(origin: Floats, yaw_deg: float, pitch_deg: float, roll_deg: float, hfov_deg: float) -> Camera:
    """A camera that looks along -z of the world, turned to the right by yaw, raised by pitch, turned clockwise by
    roll."""
    return Camera(origin, np.diag([1.0, -1.0, -1.0]) @ rig_from_view(yaw_deg, pitch_deg, roll_deg), hfov_deg)


@dataclass(frozen=True)
class Seen:
    """What a picture's pixels see."""

    faces: NDArray[np.int32]  # (h, w) index, NOTHING where there is none
    nearness: Singles  # (h, w) one over the distance along the optical axis
    planes: Floats  # (N, 3, 3): (a / z, b / z, 1 / z) of each face are affine in the pixel: rows of x, y and 1
    camera: Camera


def facing(faces: Faces, camera: Camera) -> Bools:
    """Faces that turn their front to the camera, or have two."""
    normal = np.cross(faces.u, faces.v)
    front: Bools = np.einsum("ni,ni->n", normal, camera.origin - faces.origin) > 0
    return front | faces.two_sided


def plane_maps(faces: Faces, camera: Camera, size: tuple[int, int]) -> Floats:
    """(N, 3, 3): rows (a / z, b / z, 1 / z), columns the factors of x, y and 1 in pixels."""
    focal, cx, cy = camera.pixels(*size)
    basis = np.stack([faces.u, faces.v, faces.origin - camera.origin], axis=2)
    view = np.einsum("ji,njk->nik", camera.world_from_view, basis)
    determinant = np.linalg.det(view)
    flat = np.abs(determinant) < 1e-12
    view[flat] = np.eye(3)
    # view @ (a, b, 1) = z * ray, so (a, b, 1) / z = inverse(view) @ ray, and the third row is 1 / z
    ray = np.array([[1 / focal, 0, -cx / focal], [0, 1 / focal, -cy / focal], [0, 0, 1]])
    maps: Floats = np.linalg.inv(view) @ ray
    maps[flat] = 0
    return maps


def rasterise(faces: Faces, camera: Camera, size: tuple[int, int]) -> Seen:
    """The nearest face at each pixel of a picture of this size (width, height). Translucent faces are left out."""
    width, height = size
    buffers = _Buffers(
        np.full((height, width), NOTHING, np.int32),
        np.zeros((height, width), np.float32),
        np.arange(width, dtype=np.float32),
        np.arange(height, dtype=np.float32)[:, None],
    )
    maps = plane_maps(faces, camera, size)
    numbers = maps.astype(np.float32)
    meshed = faces.mesh[:, 2] > 0
    for outline in outlines_in_view(faces, camera, size, facing(faces, camera) & (faces.veil == 0)):
        index = outline.face
        buffers.draw(outline, numbers[index], faces.mesh[index] if meshed[index] else None)
    return Seen(buffers.faces, buffers.nearness, maps, camera)


@dataclass(frozen=True)
class Outline:
    """A face's outline in the picture, and its region: left, top, right and bottom (exclusive)."""

    face: int
    points: NDArray[np.int32]  # (K, 2) in sixteenths of pixels
    box: tuple[int, int, int, int]


def outlines_in_view(faces: Faces, camera: Camera, size: tuple[int, int], wanted: Bools) -> list[Outline]:
    """Outlines of the wanted faces that meet the picture, nearest first."""
    chosen = np.flatnonzero(wanted)
    if not len(chosen):
        return []
    part = faces.chosen(wanted)
    view = _view_points(part, camera)
    used = np.where(np.arange(MOST_CORNERS) < part.corners[:, None], np.arange(MOST_CORNERS), 0)
    view = np.take_along_axis(view, used[..., None], axis=1)
    nearest, farthest = view[..., 2].min(axis=1), view[..., 2].max(axis=1)
    pixels = _projected(view, camera, size)
    boxes = _regions(pixels, size)
    points = np.round(pixels * (1 << _SHIFT)).astype(np.int32)
    meets = (boxes[:, 2:] > boxes[:, :2]).all(axis=1) & (np.ptp(pixels, axis=1).prod(axis=1) > _LEAST_PX)
    outlines = []
    order = np.argsort(nearest)
    for k in order[farthest[order] > NEAR_M].tolist():
        if nearest[k] >= NEAR_M:
            if meets[k]:
                outlines.append(Outline(int(chosen[k]), points[k, : part.corners[k]], tuple(boxes[k].tolist())))
            continue
        clipped = _projected(beyond(view[k, : part.corners[k]], NEAR_M), camera, size)
        box = _regions(clipped[None], size)[0]
        if np.all(box[2:] > box[:2]):
            rounded = np.round(clipped * (1 << _SHIFT)).astype(np.int32)
            outlines.append(Outline(int(chosen[k]), rounded, tuple(box.tolist())))
    return outlines


def _regions(pixels: Floats, size: tuple[int, int]) -> NDArray[np.int64]:
    """Left, top, right and bottom (exclusive) (N, 4) of outlines (N, K, 2)."""
    low = np.clip(np.floor(pixels.min(axis=1)), 0, None)
    high = np.minimum(np.floor(pixels.max(axis=1)) + 2, size)
    return np.concatenate([low, high], axis=1).astype(np.int64)


def _projected(view: Floats, camera: Camera, size: tuple[int, int]) -> Floats:
    """Pixels (..., 2) of points (..., 3) in the view frame, kept within what whole numbers hold."""
    focal, cx, cy = camera.pixels(*size)
    depth = np.maximum(view[..., 2:], NEAR_M * (1 - 1e-9))
    flat: Floats = np.clip(view[..., :2] / depth * focal + (cx, cy), -_FARTHEST_PX, _FARTHEST_PX)
    return flat


def _view_points(faces: Faces, camera: Camera) -> Floats:
    """Outlines in the view frame (N, MOST_CORNERS, 3)."""
    world = (
        faces.origin[:, None] + faces.outline[..., :1] * faces.u[:, None] + faces.outline[..., 1:] * faces.v[:, None]
    )
    view: Floats = (world - camera.origin) @ camera.world_from_view
    return view


def beyond(points: Floats, near: float) -> Floats:
    """The part (m, 3) of a convex polygon (n, 3) that is at least so far in front of a camera, z."""
    kept: list[Floats] = []
    for here, following in zip(points, np.roll(points, -1, axis=0), strict=True):
        if here[2] >= near:
            kept.append(here)
        if (here[2] >= near) != (following[2] >= near):
            kept.append(here + (near - here[2]) / (following[2] - here[2]) * (following - here))
    return np.array(kept)


def filled(outline: Outline) -> NDArray[np.bool_]:
    """Pixels (h, w) of an outline's region that lie in it."""
    left, top, right, bottom = outline.box
    inside = np.zeros((bottom - top, right - left), np.uint8)
    cv2.fillConvexPoly(
        inside, outline.points - np.array((left << _SHIFT, top << _SHIFT), np.int32), 1, cv2.LINE_8, _SHIFT
    )
    return inside.view(bool)


@dataclass
class _Buffers:
    faces: NDArray[np.int32]
    nearness: Singles
    x: Singles
    y: Singles

    def draw(self, outline: Outline, maps: Singles, mesh: Floats | None) -> None:
        """Draws a face where it is nearer than what is there."""
        left, top, right, bottom = outline.box
        here = slice(top, bottom), slice(left, right)
        before = self.nearness[here]
        nearness = maps[2, 0] * self.x[left:right] + (maps[2, 1] * self.y[top:bottom] + maps[2, 2])
        seen = nearness > before
        if not seen.any():
            return
        seen &= filled(outline)
        if mesh is not None:
            seen &= _wires(maps, mesh, self.x[left:right], self.y[top:bottom], nearness)
        np.copyto(before, nearness, where=seen)
        np.copyto(self.faces[here], outline.face, where=seen)


def _wires(maps: Singles, mesh: Floats, x: Singles, y: Singles, nearness: Singles) -> NDArray[np.bool_]:
    """Pixels of a region that fall onto a mesh's wires."""
    distance = 1 / np.maximum(nearness, 1e-9)
    wire = np.zeros(nearness.shape, bool)
    for axis in (0, 1):
        if mesh[axis] > 0:
            place = (maps[axis, 0] * x + (maps[axis, 1] * y + maps[axis, 2])) * distance * mesh[axis]
            wire |= place - np.floor(place) < mesh[2]
    return wire
