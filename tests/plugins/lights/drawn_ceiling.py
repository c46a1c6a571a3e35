"""A ceiling with lamps, drawn as a camera that drives along an aisle sees it, and what a network makes of it."""

from collections.abc import Sequence
from itertools import product

import cv2
import numpy as np

from savmap.geometry.pinhole import angles_from_rotation, project
from savmap.types import Detection, Feature, Floats, FrameTable, RowFacts, Trajectory, View, ViewSpec
from savmap.vision.networks.adapter import regions
from savmap_lights.features import extract_features

HEIGHT_M, LINE_Z_M, WIDTH_M = 6.0, 1.2, 0.2
WORLD_FROM_VIEW = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
CEILING = ViewSpec("pass 1 / ceiling", *angles_from_rotation(np.diag([1.0, -1.0, -1.0]) @ WORLD_FROM_VIEW), hfov_deg=90)
DIM, BRIGHT = 90, 250
FADES_PX = 25


def path(count: int = 24, length: float = 6.0) -> Trajectory:
    """A straight drive along x, 2.5 m high, the rig's axes along the world's."""
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, :3] = np.diag([1.0, -1.0, -1.0])
    poses[:, :3, 3] = np.stack([np.linspace(0, length, count), np.full(count, 2.5), np.full(count, 1.4)], axis=1)
    return Trajectory(np.arange(count), poses)


def facts(count: int = 24) -> RowFacts:
    return RowFacts("A", FrameTable(np.arange(count) / 5, ("pass 1",) * count), {CEILING.name: CEILING}, {"pass 1": 1})


def strip(start: float, end: float, height: float = HEIGHT_M) -> Floats:
    """The corners (4, 3) of a strip's lower side."""
    low, high = LINE_Z_M - WIDTH_M / 2, LINE_Z_M + WIDTH_M / 2
    return np.array([[start, height, low], [end, height, low], [end, height, high], [start, height, high]])


def box(start: float, end: float, half: float, z: float) -> list[Floats]:
    """The faces (4, 3) of a strip at `z` that is twice `half` thick, its middle at the lamps' height."""
    corners = np.array(
        list(product((start, end), (HEIGHT_M - half, HEIGHT_M + half), (z - WIDTH_M / 2, z + WIDTH_M / 2)))
    )
    faces = ([0, 4, 5, 1], [0, 2, 3, 1], [4, 6, 7, 5], [0, 4, 6, 2], [1, 5, 7, 3])
    return [corners[list(face)] for face in faces]


def picture(lamps: Sequence[Floats], pose: Floats, beams: Sequence[float] = ()) -> np.ndarray:
    """Grey levels (480, 640) of lamps, and of beams across at these places along x, below them, 20 cm wide."""
    canvas = np.full((480, 640), DIM, np.uint8)
    for corners in lamps:
        fill(canvas, corners, pose, BRIGHT)
    for x in beams:
        beam = np.array([[x, 5.5, -4], [x + 0.2, 5.5, -4], [x + 0.2, 5.5, 6], [x, 5.5, 6]])
        fill(canvas, beam, pose, DIM // 3)
    return cv2.GaussianBlur(canvas, (0, 0), 0.7)


def fill(canvas: np.ndarray, corners: Floats, pose: Floats, value: int) -> None:
    """Paint what lies within corners (4, 3) in one grey level."""
    in_view = (corners - pose[:3, 3]) @ pose[:3, :3] @ CEILING.rig_from_view
    pixels = np.round(np.clip(project(in_view, CEILING.camera), -5000, 5000) * 256).astype(np.int32)
    cv2.fillPoly(canvas, [pixels], value, cv2.LINE_AA, 8)


def seen(grey: np.ndarray, faded: bool = True) -> list[Detection]:
    """What a network says of a picture: sure of lamps near their ends, and, if `faded`, less and less away from these."""
    mask = (grey > (DIM + BRIGHT) / 2).astype(np.uint8)
    ends = np.zeros_like(mask)
    count, _, boxes, _ = cv2.connectedComponentsWithStats(mask)
    for number in range(1, count):
        left, top, width, height = boxes[number][:4].tolist()
        for x in (left, left + width - 1):
            ends[top : top + height, max(x - FADES_PX, 0) : x + FADES_PX] = 1
    sure = mask if not faded else mask & ends
    probability = cv2.GaussianBlur(np.where(sure, 0.95, 0.02 * mask).astype(np.float32), (0, 0), 0.7)
    return regions("light", probability * mask, 0.5, 12)


def view_of(grey: np.ndarray, frame: int = 0) -> View:
    return View(CEILING, frame, frame / 5, np.repeat(grey[..., None], 3, axis=2))


def features_of(lamps: Sequence[Floats], beams: Sequence[float] = (), faded: bool = True) -> list[Feature]:
    """What is extracted on the whole drive."""
    found: list[Feature] = []
    for frame, pose in enumerate(path().world_from_rig):
        grey = picture(lamps, pose, beams)
        found += extract_features(view_of(grey, frame), seen(grey, faded))
    return found
