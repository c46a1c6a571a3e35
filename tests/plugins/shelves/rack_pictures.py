"""A small rasteriser: what a perfect network would give for a rack seen from a known place, with the exact truth."""

from dataclasses import dataclass, field
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.geometry import pinhole
from savmap.types import Detection, Feature, Floats, View, ViewSpec
from savmap.vision.networks.segmenter import regions

SOFT_PX = 0.8
HEIGHT, WIDTH = 480, 640
Image = NDArray[np.float32]


@dataclass(frozen=True)
class Rack:
    """Uprights (x_left, x_right) and, for each bay between two of them, beams (y_bottom, y_top); all at z = 0."""

    uprights: list[tuple[float, float]] = field(
        default_factory=lambda: [(2.6 * i, 2.6 * i + 0.1) for i in range(-3, 5)]
    )
    beams: list[tuple[float, float]] = field(
        default_factory=lambda: [(0.65 * i + 0.3, 0.65 * i + 0.4) for i in range(6)]
    )
    height: float = 4.2

    @property
    def sections(self) -> list[tuple[float, float]]:
        return [(a[1], b[0]) for a, b in zip(self.uprights, self.uprights[1:], strict=False)]


@dataclass(frozen=True)
class Camera:
    """Where the view is taken from (m) and how it is turned (degrees) from looking straight at the face."""

    x: float = 1.3
    y: float = 2.1
    z: float = 1.5
    hfov: float = 125.0
    yaw: float = 0.0
    pitch: float = 0.0
    roll: float = 0.0

    @property
    def spec(self) -> ViewSpec:
        return ViewSpec("face", 0.0, hfov_deg=self.hfov)

    def pixels(self, x: float, y: float) -> Floats:
        """Pixel (2,) of a point on the face; nan behind the camera."""
        local = pinhole.rig_from_view(self.yaw, self.pitch, self.roll).T @ np.array([x - self.x, self.y - y, self.z])
        return pinhole.project(local, self.spec.camera)

    def quad(self, x: tuple[float, float], y: tuple[float, float]) -> Floats:
        """Pixels (4, 2) of a rectangle's corners: clockwise in the picture from the top left."""
        return np.array([self.pixels(a, b) for a, b in ((x[0], y[1]), (x[1], y[1]), (x[1], y[0]), (x[0], y[0]))])


def painted(image: Image, quad: Floats) -> None:
    """Draws a soft convex quadrilateral: its probability is exactly 0.5 on its border."""
    low = np.clip(np.floor(quad.min(axis=0)) - 4, 0, (WIDTH, HEIGHT)).astype(int)
    high = np.clip(np.ceil(quad.max(axis=0)) + 5, 0, (WIDTH, HEIGHT)).astype(int)
    if (high <= low).any():
        return
    u, v = np.meshgrid(np.arange(low[0], high[0]), np.arange(low[1], high[1]))
    inside = np.full(u.shape, np.inf)
    for a, b in zip(quad, np.roll(quad, -1, axis=0), strict=True):
        along = (b - a) / np.linalg.norm(b - a)
        inside = np.minimum(inside, along[0] * (v - a[1]) - along[1] * (u - a[0]))
    window = image[low[1] : high[1], low[0] : high[0]]
    np.maximum(window, 1 / (1 + np.exp(-np.clip(inside / (SOFT_PX / 2), -30, 30))), out=window, casting="unsafe")


@dataclass(frozen=True)
class Picture:
    """A rack seen by a camera: probabilities of both classes, and the truth about every edge."""

    rack: Rack = field(default_factory=Rack)
    camera: Camera = field(default_factory=Camera)

    @cached_property
    def uprights(self) -> Image:
        image = np.zeros((HEIGHT, WIDTH), dtype=np.float32)
        for x in self.rack.uprights:
            self._paint(image, x, (0.0, self.rack.height))
        return image

    @cached_property
    def beams(self) -> Image:
        image = np.zeros((HEIGHT, WIDTH), dtype=np.float32)
        for x in self.rack.sections:
            for y in self.rack.beams:
                self._paint(image, x, y)
        return image

    def _paint(self, image: Image, x: tuple[float, float], y: tuple[float, float]) -> None:
        quad = self.camera.quad(x, y)
        if np.isfinite(quad).all():
            painted(image, quad)

    def detections(self, threshold: float = 0.5, least_pixels: int = 30) -> list[Detection]:
        """As the segmentation would give them."""
        return [
            *regions("upright", self.uprights, threshold, least_pixels),
            *regions("beam", self.beams, threshold, least_pixels),
        ]

    @property
    def view(self) -> View:
        """The view, with a grey picture."""
        return View(self.camera.spec, 7, 0.5, np.full((HEIGHT, WIDTH, 3), 128, dtype=np.uint8))

    def edge_error(self, feature: Feature) -> float:
        """Largest distance, px, of an edge's ends (n = 2) or of a corner (n = 1) from the nearest true line or point."""
        return float(min(np.max(np.abs(_distances(feature, truth))) for truth in self._truths(feature)))

    def corner_offset(self, feature: Feature) -> Floats:
        """A corner's error (2,), px."""
        offsets = [(feature.pixels - truth).ravel() for truth in self._truths(feature)]
        return min(offsets, key=lambda offset: float(np.linalg.norm(offset)))

    def measurable(self, x: tuple[float, float]) -> bool:
        """Whether an upright is in the view from side to side, along half of the picture's height."""
        quad = self.camera.quad(x, (0.0, self.rack.height))
        rows = np.clip(quad[:, 1], 0, HEIGHT - 1)
        seen = np.isfinite(quad).all() and rows[2] - rows[1] > 0.5 * HEIGHT
        return bool(seen and (quad[:, 0] > 1).all() and (quad[:, 0] < WIDTH - 2).all())

    @property
    def corners(self) -> Floats:
        """Corners (n, 2), at measurable uprights, of all beam ends that are in the view by 3 px."""
        inner = [x[0] for x in self.rack.uprights[1:] if self.measurable(x)]
        inner += [x[1] for x in self.rack.uprights[:-1] if self.measurable(x)]
        ends = np.array([[self.camera.pixels(x, y) for y in beam] for x in inner for beam in self.rack.beams])
        return ends[((ends > 3) & (ends < (WIDTH - 4, HEIGHT - 4))).all(axis=(1, 2))].reshape(-1, 2)

    def _truths(self, feature: Feature) -> list[Floats]:
        if feature.label == "upright":
            side = 0 if feature.part == "left" else 1
            ends = [[self.camera.pixels(x[side], y) for y in (1.0, 3.0)] for x in self.rack.uprights]
        else:
            level = 1 if "upper" in feature.part else 0
            ends = [self._beam_truth(feature, x, y[level]) for x in self.rack.sections for y in self.rack.beams]
        return [np.array(pair) for pair in ends if np.isfinite(pair).all()]

    def _beam_truth(self, feature: Feature, x: tuple[float, float], y: float) -> list[Floats]:
        if len(feature.pixels) == 2:
            return [self.camera.pixels(at, y) for at in x]
        return [self.camera.pixels(x[0 if "left" in feature.part else 1], y)]


def _distances(feature: Feature, truth: Floats) -> Floats:
    if len(feature.pixels) == 1:
        distances: Floats = np.linalg.norm(feature.pixels - truth, axis=-1)
        return distances
    along = (truth[1] - truth[0]) / np.linalg.norm(truth[1] - truth[0])
    across: Floats = (feature.pixels - truth[0]) @ np.array([-along[1], along[0]])
    return across


def soften(mask: NDArray[np.bool_]) -> Image:
    """A probability of which a mask is the part above 0.5."""
    return np.asarray(cv2.GaussianBlur(mask.astype(np.float32), (5, 5), 0.9), dtype=np.float32)
