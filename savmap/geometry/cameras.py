"""Camera models: which ray each pixel of a picture sees, and which pixel sees a ray.

Rig frame: x right, y down, z along the optical axis (of a panorama: towards its centre column). Pixel centres are at
integer coordinates, so that a picture spans [-0.5, W - 0.5) x [-0.5, H - 0.5).
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from savmap.geometry.arrays import Bools, Floats, array_record
from savmap.geometry.sphere import panorama_pixels_from_rays, rays_from_panorama_pixels

ROUNDS = 20
"""Of looking for the ray that a distorted pixel sees."""
BORDER = 64
"""Pixels along each border of a picture that tell how far off its axis the camera sees."""
TERMS = 8
"""Of distortion."""
BEYOND, TANGENTS = 1.001, 500
"""A ray so much further off the axis than any pixel of the border is not seen; off it how many are looked at."""


class Camera(ABC):
    """A camera of pictures (height, width)."""

    width: int
    height: int

    @abstractmethod
    def rays(self, pixels: Floats) -> Floats:
        """Unit rays (..., 3) in the rig frame through pixels (..., 2); nan where a pixel sees nothing."""

    @abstractmethod
    def pixels(self, rays: Floats) -> Floats:
        """Pixels (..., 2) that see rays (..., 3) in the rig frame, of any length but zero; nan where none does."""

    @property
    @abstractmethod
    def resolution(self) -> float:
        """Pixels a radian in the middle of a picture."""

    def _within(self, pixels: Floats) -> Bools:
        """Which pixels (..., 2) are of the picture."""
        inside = (pixels >= -0.5) & (pixels < [self.width - 0.5, self.height - 0.5])
        return np.asarray(inside.all(axis=-1))


@dataclass(frozen=True)
class Equirectangular(Camera):
    """A whole panorama, twice as wide as high."""

    height: int

    @property
    def width(self) -> int:  # type: ignore[override]  # a number, and not to be set
        return 2 * self.height

    @property
    def resolution(self) -> float:
        return self.height / np.pi

    def rays(self, pixels: Floats) -> Floats:
        return rays_from_panorama_pixels(pixels, self.height)

    def pixels(self, rays: Floats) -> Floats:
        return panorama_pixels_from_rays(rays, self.height)


@dataclass(frozen=True)
class Pinhole(Camera):
    """A camera with an ordinary lens: focal length and principal point, pixels, and the terms k1, k2, p1, p2, k3, k4,
    k5, k6 of Brown's model in OpenCV's order, as many as are given."""

    width: int
    height: int
    focal_px: tuple[float, float]
    centre_px: tuple[float, float]
    distortion: tuple[float, ...] = ()

    @classmethod
    def of_hfov(cls, width: int, height: int, hfov_deg: float) -> "Pinhole":
        """A camera without distortion whose outer pixel borders are `hfov_deg` apart."""
        focal = width / 2 / np.tan(np.radians(hfov_deg) / 2)
        return cls(width, height, (focal, focal), ((width - 1) / 2, (height - 1) / 2))

    @property
    def hfov_deg(self) -> float:
        """How far apart the outer pixel borders would be without distortion, degrees."""
        return float(np.degrees(2 * np.arctan(self.width / 2 / self.focal_px[0])))

    @property
    def resolution(self) -> float:
        return max(self.focal_px)

    @cached_property
    def _widest(self) -> float:
        """The greatest tangent of the angle between the axis and a ray that is seen: that of the picture's border, or
        from where on distortion folds rays back."""
        rays = self.rays(border(self.width, self.height))
        seen = float((np.hypot(rays[:, 0], rays[:, 1]) / rays[:, 2]).max()) * BEYOND
        tangents = np.linspace(0.0, seen, TANGENTS)
        across = self._projected(np.column_stack([tangents, np.zeros(TANGENTS)]))[:, 0]
        folded = np.flatnonzero(np.diff(across) <= 0)
        return float(tangents[folded[0]]) if len(folded) else seen

    def rays(self, pixels: Floats) -> Floats:
        flat = np.reshape(pixels, (-1, 2)).astype(np.float64)
        at = (flat - self.centre_px) / self.focal_px
        for _ in range(ROUNDS if any(self.distortion) else 0):
            at = at + (flat - self._projected(at)) / self.focal_px
        rays = np.column_stack([at, np.ones(len(at))])
        units: Floats = rays / np.linalg.norm(rays, axis=1, keepdims=True)
        return units.reshape(*np.shape(pixels)[:-1], 3)

    def _projected(self, at: Floats) -> Floats:
        """Pixels (n, 2) of what is seen at x and y (n, 2) at depth 1."""
        k1, k2, p1, p2, k3, k4, k5, k6 = (*self.distortion, *(0.0,) * (TERMS - len(self.distortion)))
        x, y = at.T
        square = x * x + y * y
        radial = 1 + square * (k1 + square * (k2 + square * k3))
        radial = radial / (1 + square * (k4 + square * (k5 + square * k6)))
        across = x * radial + 2 * p1 * x * y + p2 * (square + 2 * x * x)
        down = y * radial + p1 * (square + 2 * y * y) + 2 * p2 * x * y
        return np.column_stack([across, down]) * self.focal_px + self.centre_px

    def pixels(self, rays: Floats) -> Floats:
        flat = np.reshape(rays, (-1, 3)).astype(np.float64)
        ahead = flat[:, 2] > 0
        with np.errstate(divide="ignore", invalid="ignore"):
            ahead &= np.hypot(flat[:, 0], flat[:, 1]) < self._widest * flat[:, 2]
        pixels = np.full((len(flat), 2), np.nan)
        if ahead.any():
            pixels[ahead] = self._projected(flat[ahead, :2] / flat[ahead, 2:])
        pixels[~self._within(pixels)] = np.nan
        return pixels.reshape(*np.shape(rays)[:-1], 2)


@dataclass(frozen=True)
class Fisheye(Camera):
    """A camera with a fisheye lens (Kannala and Brandt 2006): a ray at the angle t from the axis is seen
    f (t + k1 t^3 + k2 t^5 + k3 t^7 + k4 t^9) from the principal point, up to half of `field_deg`."""

    width: int
    height: int
    focal_px: tuple[float, float]
    centre_px: tuple[float, float]
    distortion: tuple[float, ...] = ()
    field_deg: float = 220.0

    @classmethod
    def of_hfov(cls, width: int, height: int, hfov_deg: float) -> "Fisheye":
        """An equidistant lens whose pictures' left and right borders are `hfov_deg` apart, which sees no further."""
        focal = width / float(np.radians(hfov_deg))
        return cls(width, height, (focal, focal), ((width - 1) / 2, (height - 1) / 2), field_deg=hfov_deg)

    @property
    def resolution(self) -> float:
        return max(self.focal_px)

    def _bent(self, angles: Floats) -> Floats:
        """Distances from the principal point of angles (...), focal lengths."""
        return np.asarray(np.polynomial.polynomial.polyval(angles**2, [1.0, *self.distortion]) * angles, np.float64)

    def _slope(self, angles: Floats) -> Floats:
        terms = [(2 * number + 1) * term for number, term in enumerate((1.0, *self.distortion))]
        return np.asarray(np.polynomial.polynomial.polyval(angles**2, terms), np.float64)

    def rays(self, pixels: Floats) -> Floats:
        at = (np.asarray(pixels) - self.centre_px) / self.focal_px
        distances = np.asarray(np.linalg.norm(at, axis=-1), np.float64)
        widest = np.radians(self.field_deg) / 2
        seen = distances <= self._bent(np.full(1, widest))
        angles = np.where(seen, distances, np.nan)
        for _ in range(ROUNDS):
            step = (self._bent(angles) - distances) / self._slope(angles)
            angles = np.asarray(np.clip(angles - step, 0, widest), np.float64)
        across = at * (np.sin(angles) / np.maximum(distances, 1e-12))[..., None]
        return np.concatenate([across, np.cos(angles)[..., None]], axis=-1)

    def pixels(self, rays: Floats) -> Floats:
        off = np.hypot(rays[..., 0], rays[..., 1])
        angles = np.arctan2(off, rays[..., 2])
        at = rays[..., :2] * (self._bent(angles) / np.maximum(off, 1e-12))[..., None]
        pixels = at * self.focal_px + self.centre_px
        pixels[~self._within(pixels) | (angles > np.radians(self.field_deg) / 2)] = np.nan
        return np.asarray(pixels)


@dataclass(frozen=True, eq=False)
@array_record
class FisheyePair(Camera):
    """Two fisheye lenses whose pictures lie side by side: `rig_from_lens` (3, 3) of each. What both see is taken from
    the one whose axis is nearer."""

    left: Fisheye
    right: Fisheye
    rig_from_left: Floats
    rig_from_right: Floats

    @property
    def width(self) -> int:  # type: ignore[override]  # a number, and not to be set
        return self.left.width + self.right.width

    @property
    def height(self) -> int:  # type: ignore[override]
        return max(self.left.height, self.right.height)

    @property
    def resolution(self) -> float:
        return max(self.left.resolution, self.right.resolution)

    def rays(self, pixels: Floats) -> Floats:
        of_right = np.asarray(pixels)[..., :1] >= self.left.width - 0.5
        left = self.left.rays(pixels) @ self.rig_from_left.T
        right = self.right.rays(pixels - np.array([self.left.width, 0.0])) @ self.rig_from_right.T
        return np.where(of_right, right, left)

    def pixels(self, rays: Floats) -> Floats:
        left, right = self.left.pixels(rays @ self.rig_from_left), self.right.pixels(rays @ self.rig_from_right)
        nearer = (rays @ (self.rig_from_right - self.rig_from_left)[:, 2] > 0)[..., None]
        right = right + np.array([self.left.width, 0.0])
        first, second = np.where(nearer, right, left), np.where(nearer, left, right)
        return np.where(np.isnan(first), second, first)


def border(width: int, height: int) -> Floats:
    """Pixels (n, 2) along the border of a picture."""
    x, y = np.linspace(-0.5, width - 0.5, BORDER), np.linspace(-0.5, height - 0.5, BORDER)
    sides = [(x, np.full(BORDER, end)) for end in (-0.5, height - 0.5)]
    sides += [(np.full(BORDER, end), y) for end in (-0.5, width - 0.5)]
    return np.concatenate([np.stack(side, axis=-1) for side in sides])
