"""A ceiling with lamps, drawn as a camera that drives along an aisle sees it, and what a network makes of it."""

from collections.abc import Sequence
from itertools import product

import cv2
import numpy as np

from savmap.geometry.pinhole import angles_from_rotation, project
from savmap.graph import KeySpace, camera_priors, merge, solve
from savmap.pipeline.finding import INWARDS_PX, STRAY_PX
from savmap.types import (
    Detection,
    Feature,
    Floats,
    FoundObject,
    FrameTable,
    PlaneEvidence,
    PlanePatch,
    RowFacts,
    Structure,
    Trajectory,
    View,
    ViewSpec,
)
from savmap.vision.evidence import PackedView, features_of, gather, outlines_in
from savmap.vision.networks.adapter import regions
from savmap.vision.networks.segmenter import Segmentation
from savmap_lights.features import extract_features
from savmap_lights.find import find
from savmap_lights.plugin import Lights, Settings

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
    """What a network says of a picture: sure of lamps near their ends, and, if `faded`, less and less away from
    these."""
    mask = (grey > (DIM + BRIGHT) / 2).astype(np.uint8)
    return regions("light", probability_of(mask, faded, 0.02) * mask, 0.5, 12)


def segmentation(grey: np.ndarray, faded: bool = True) -> Segmentation:
    """The same, as maps."""
    probability = probability_of((grey > (DIM + BRIGHT) / 2).astype(np.uint8), faded, 0.6)
    return Segmentation(("light",), np.stack([1 - probability, probability]))


def probability_of(mask: np.ndarray, faded: bool, least: float) -> np.ndarray:
    """How sure a network is of lamps (480, 640): `least` away from their ends, if `faded`."""
    ends = np.zeros_like(mask)
    count, _, boxes, _ = cv2.connectedComponentsWithStats(mask)
    for number in range(1, count):
        left, top, width, height = boxes[number][:4].tolist()
        for x in (left, left + width - 1):
            ends[top : top + height, max(x - FADES_PX, 0) : x + FADES_PX] = 1
    sure = mask if not faded else mask & ends
    return cv2.GaussianBlur(np.where(sure, 0.95, least * mask).astype(np.float32), (0, 0), 0.7)


def view_of(grey: np.ndarray, frame: int = 0) -> View:
    return View(CEILING, frame, frame / 5, np.repeat(grey[..., None], 3, axis=2))


class Drive:
    """A drive below lamps, and beams across."""

    def __init__(self, lamps: Sequence[Floats], beams: Sequence[float] = (), faded: bool = True) -> None:
        self.path, self.facts, self.faded = path(), facts(), faded
        self.pictures = [picture(lamps, pose, beams) for pose in self.path.world_from_rig]
        self.views = [view_of(grey, frame) for frame, grey in enumerate(self.pictures)]
        self.packed = [
            PackedView.of(view, segmentation(grey, faded)) for view, grey in zip(self.views, self.pictures, strict=True)
        ]

    def gather(self, patch: PlanePatch, picture: bool = True) -> PlaneEvidence:
        return gather(patch, ("light",), self.packed, self.facts.views, self.path, picture)

    def found(self) -> list[FoundObject]:
        return find(self.gather, self.path, self.facts)

    def features(self) -> list[Feature]:
        """What is measured of what is found."""
        objects, features = [item for item in self.found() if item.is_mapped], list[Feature]()
        for view, grey, pose in zip(self.views, self.pictures, self.path.world_from_rig, strict=True):
            of_view = extract_features(view, seen(grey, self.faded))
            features += features_of(of_view, outlines_in(CEILING, pose, objects), STRAY_PX, INWARDS_PX)
        return features

    def mapped(self, settings: Settings | None = None) -> list[Structure]:
        """The lamps of the drive, whose path is known."""
        return mapped(self.features(), settings)


def mapped(features: Sequence[Feature], settings: Settings | None = None) -> list[Structure]:
    """The lamps of features that name them; the path is known."""
    plugin = Lights(settings or Settings())
    tracks = plugin.track(features, facts(), path())
    constraints = plugin.constrain(tracks, facts(), path(), KeySpace("lights"))
    solution = solve(merge(camera_priors(facts(), path(), fixed=path()), constraints))
    return plugin.describe(tracks, solution.landmarks_of("lights"))
