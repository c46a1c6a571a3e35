"""How stitching, cropping, lenses that stand apart and read-out distort a panorama's pictures, at measured pixels."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from savmap.geometry.pinhole import rig_from_view
from savmap.graph.calibration.bends import BENDS
from savmap.graph.measurements import ImageMeasurements
from savmap.types import Floats

LEAST_DEPTH = 0.02
LEAST_DEPTH_M = 0.2


@dataclass(frozen=True, eq=False)
class Scene:
    """What n measurements show now: their points (n, 3) m in the rig frame, the camera's own speeds (n, 3) m/s and
    turning rates (n, 3) rad/s there, and its `drive` (3, 3) there (`drive_axes`)."""

    points: Floats
    speeds: Floats
    rates: Floats
    drive: Floats


@dataclass(frozen=True, eq=False)
class Lenses:
    """The views of n measurements: rig_from_view (n, 3, 3), focal lengths (n, 2) and principal points (n, 2), px."""

    mounts: Floats
    focal: Floats
    centres: Floats

    @staticmethod
    def of(measurements: ImageMeasurements) -> "Lenses":
        """The lens of each measurement."""
        mounts = np.array([spec.rig_from_view for spec in measurements.views]).reshape(-1, 3, 3)
        cameras = np.array([spec.camera for spec in measurements.views]).reshape(-1, 3, 3)[measurements.view]
        return Lenses(mounts[measurements.view], cameras[:, [0, 1], [0, 1]], cameras[:, :2, 2])

    def rays(self, pixels: Floats) -> Floats:
        """Unit rays (n, 3) in the rig frame."""
        plane = np.concatenate([(pixels - self.centres) / self.focal, np.ones((len(pixels), 1))], axis=1)
        rays = np.einsum("nij,nj->ni", self.mounts, plane)
        unit: Floats = rays / np.linalg.norm(rays, axis=1, keepdims=True)
        return unit

    def depths(self, points: Floats) -> Floats:
        """Depths (n,) of points (n, 3) in the rig frame."""
        return np.asarray(np.einsum("ni,ni->n", self.mounts[:, :, 2], points))

    def projected(self, points: Floats) -> tuple[Floats, Floats]:
        """Pixels (n, 2) of points (n, 3) in the rig frame, and their derivatives (n, 2, 3) to these."""
        local = np.einsum("nji,nj->ni", self.mounts, points)
        depth = np.maximum(local[:, 2], LEAST_DEPTH)[:, None]
        plane = local[:, :2] / depth
        slopes = np.zeros((len(points), 2, 3))
        slopes[:, 0, 0] = slopes[:, 1, 1] = 1.0
        slopes[:, :, 2] = -plane
        slopes = (self.focal / depth)[:, :, None] * slopes @ np.swapaxes(self.mounts, 1, 2)
        return plane * self.focal + self.centres, slopes

    def nearest(self, points: Floats, pixels: Floats) -> Floats:
        """Pixels (n, 2) of points (n, 3) m that are in front of the view; the given ones for others."""
        return np.where((self.depths(points) > LEAST_DEPTH_M)[:, None], self.projected(points)[0], pixels)


@dataclass(frozen=True, eq=False)
class Distortion:
    """The distortion about n observed pixels (n, 2) for parameters `values` (p,): those of the stitching, where there
    is a `blend_deg`, the `vertical` scale, the `lens_distance`, and that of the read-out, where it has an `axis`. A
    measured pixel and those about it belong to one half."""

    lenses: Lenses
    seen: Floats
    values: Floats
    scene: Scene
    front_deg: float
    blend_deg: float | None
    axis: str | None
    vertical: bool = False
    lens_distance: bool = False

    def __call__(self, pixels: Floats) -> tuple[Floats, Floats]:
        """Where pixels (n, 2) would be without it, and how they move (n, 2, p) with each parameter."""
        rays = self.lenses.rays(pixels)
        true, moves = pixels, list[Floats]()
        basis = self._turns(rays)
        if basis.shape[1]:
            turn = np.einsum("p,npi->ni", self.values[: basis.shape[1]], basis)
            straight = np.asarray(Rotation.from_rotvec(turn).apply(rays))
            true, slopes = self.lenses.projected(straight)
            moves.append(-np.einsum("nij,npj->nip", slopes, np.cross(basis, straight[:, None])))
        if self.lens_distance:
            first = basis.shape[1]
            true = true - self._parallax @ self.values[first : first + len(BENDS)]
            moves.append(self._parallax)
        if self.axis is not None:
            late = read_out_share(rays, self.front_deg, self.axis)[:, None] * self._velocities(rays)
            true = true - self.values[-1] * late
            moves.append(late[:, :, None])
        return true, np.concatenate(moves, axis=2)

    def _turns(self, rays: Floats) -> Floats:
        """Small turns (n, t, 3) of rays (n, 3) to their true directions, for each of the parameters that turn them."""
        parts = [np.zeros((len(rays), 0, 3))]
        if self.blend_deg is not None:
            rear = rear_share(self.lenses.rays(self.seen), self.front_deg, self.blend_deg)
            parts.append(turns(rays, rear, self.front_deg))
        if self.vertical:
            parts.append(lowered(rays)[:, None])
        return np.concatenate(parts, axis=1)

    @cached_property
    def _parallax(self) -> Floats:
        """How the points' pixels move (n, 2, b) with the baseline of each bend, px/m. What is seen about a point moves
        with it, and is not sheared: that is below a degree."""
        points, drive = self.scene.points, self.scene.drive
        slopes = self.lenses.projected(points)[1] * (self.lenses.depths(points) > LEAST_DEPTH_M)[:, None, None]
        rays = points / np.maximum(np.linalg.norm(points, axis=1), LEAST_DEPTH)[:, None]
        places = [bend.points_of_view(rays, drive) for bend in BENDS]
        return np.stack([-np.einsum("nij,nj->ni", slopes, place) for place in places], axis=2)

    def _velocities(self, rays: Floats) -> Floats:
        """How fast (n, 2) px/s what is seen along rays (n, 3) moves in the picture, at the depths of the points."""
        depths = self.lenses.depths(self.scene.points)
        points = (np.maximum(depths, LEAST_DEPTH_M) / np.maximum(self.lenses.depths(rays), LEAST_DEPTH))[:, None] * rays
        moving = -np.cross(self.scene.rates, points) - self.scene.speeds
        slopes = self.lenses.projected(points)[1]
        return np.asarray(np.einsum("nij,nj->ni", slopes, moving) * (depths > LEAST_DEPTH_M)[:, None])


def rear_share(rays: Floats, front_deg: float, blend_deg: float) -> Floats:
    """How much (n,) of what is seen along rays (n, 3) the rear lens shows, 0..1."""
    off_axis = np.arccos(np.clip(rays @ rig_from_view(front_deg, 0.0, 0.0)[:, 2], -1.0, 1.0))
    return np.clip((np.degrees(off_axis) - 90.0) / blend_deg + 0.5, 0.0, 1.0)


def turns(rays: Floats, rear: Floats, front_deg: float) -> Floats:
    """Small turns (n, 5, 3) of rays (n, 3) of the panorama to their true directions, a radian or a unit of scale."""
    rig_from_lens = rig_from_view(front_deg, 0.0, 0.0)
    ahead = rig_from_lens[:, 2]
    off_axis = np.arccos(np.clip(rays @ ahead, -1.0, 1.0))
    about = np.cross(ahead, rays)
    about /= np.maximum(np.linalg.norm(about, axis=-1), 1e-9)[:, None]
    halves = (rear - 0.5)[:, None, None] * rig_from_lens.T
    stretched = [((1 - rear) * off_axis)[:, None] * about, (rear * (np.pi - off_axis))[:, None] * -about]
    return np.concatenate([halves, np.stack(stretched, axis=1)], axis=1)


def lowered(rays: Floats) -> Floats:
    """Small turns (n, 3) of rays (n, 3) towards the panorama's horizon, by as much as they are above or below it."""
    down = np.array([0.0, 1.0, 0.0])
    about = np.cross(rays, down)
    about /= np.maximum(np.linalg.norm(about, axis=-1), 1e-9)[:, None]
    return np.arcsin(np.clip(-rays[:, 1], -1.0, 1.0))[:, None] * about


def read_out_share(rays: Floats, front_deg: float, axis: str) -> Floats:
    """When (n,) rays (n, 3) are read out, -1/2..1/2 of the read-out time."""
    if axis == "rows":
        return np.arcsin(np.clip(rays[:, 1], -1.0, 1.0)) / np.pi
    longitude = np.arctan2(rays[:, 0], rays[:, 2]) - np.radians(front_deg)
    share: Floats = np.mod(longitude / np.pi + 0.5, 1.0) - 0.5
    return share


def velocities(poses: Floats, stamps_s: Floats) -> tuple[Floats, Floats]:
    """Speeds (f, 3) m/s in the world and turning rates (f, 3) rad/s in the rig frame of poses (f, 4, 4) at stamps (f,),
    in order of time; zeros where two stamps are equal."""
    count = len(poses)
    before, after = np.maximum(np.arange(count) - 1, 0), np.minimum(np.arange(count) + 1, count - 1)
    span = stamps_s[after] - stamps_s[before]
    per_second = np.where(span > 0, 1 / np.where(span > 0, span, 1.0), 0.0)[:, None]
    turned = np.swapaxes(poses[before, :3, :3], 1, 2) @ poses[after, :3, :3]
    rates: Floats = Rotation.from_matrix(turned).as_rotvec() * per_second
    return (poses[after, :3, 3] - poses[before, :3, 3]) * per_second, rates
