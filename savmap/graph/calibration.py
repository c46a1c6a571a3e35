"""What is wrong with the camera as unknowns of the solve: how its panoramas are stitched, and how long they take to read out.

A consumer panorama is put together from two fisheye lenses, back to back. To first order, wrong angles between the lenses
and wrong principal points turn one half against the other, and a wrong focal length stretches a half away from its axis:
small turns phi = sum_j beta_j b_j(r) of each ray r, the same in every frame (additional parameters of a self-calibrating
bundle adjustment; Brown 1971). A rolling shutter shows a point where it was s tau later, s = -1/2..1/2 across the read-out:
one unknown, tau, times the pixel's velocity between neighbouring frames (Hedborg et al., Rolling shutter bundle adjustment,
CVPR 2012). Turning jitter faster than the frames follow one another is not modelled.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from savmap.errors import SolveError
from savmap.graph.observations import Biases, Observations
from savmap.types import Floats

TURNS = ("rear pitch", "rear yaw", "rear roll")
STRETCHES = ("front scale", "rear scale")
SHUTTER = "read-out"
LEAST_DEPTH = 0.02
LEAST_DEPTH_M = 0.2


@dataclass(frozen=True)
class Stitching:
    """Standard deviations of the rear half's turn against the front half about each of the rig's axes, degrees, and of each
    lens's scale. The halves are blended over `blend_deg`."""

    turn_sigma_deg: float = 1.0
    scale_sigma: float = 0.003
    blend_deg: float = 1.0

    def __post_init__(self) -> None:
        if min(self.turn_sigma_deg, self.scale_sigma, self.blend_deg) <= 0:
            raise SolveError("calibration of the panorama: sigmas and blend must be greater than 0")


@dataclass(frozen=True)
class Shutter:
    """Standard deviation of the read-out time, s, over the panorama's rows (later lower down) or each half's columns (later
    to the right); negative where it runs the other way."""

    sigma_s: float = 0.02
    axis: Literal["rows", "columns"] = "rows"

    def __post_init__(self) -> None:
        if self.sigma_s <= 0:
            raise SolveError("calibration of the rolling shutter: sigma must be greater than 0 s")


@dataclass(frozen=True)
class Scene:
    """What observations look at now: their points (n, 3) m and the points' velocities (n, 3) m/s in the rig frame."""

    points: Floats
    velocities: Floats


@dataclass(frozen=True)
class Calibration:
    """Which terms are unknowns of the solve. Values are radians, fractions and seconds, in the order of `names`. The front
    lens looks at longitude `front_deg` of the panorama."""

    stitching: Stitching | None = None
    shutter: Shutter | None = None
    front_deg: float = 0.0

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The parameters (p,)."""
        return (*((*TURNS, *STRETCHES) if self.stitching else ()), *((SHUTTER,) if self.shutter else ()))

    @cached_property
    def prior(self) -> Floats:
        """Standard deviations (p,) about 0."""
        return np.array([*self._priors()])

    def _priors(self) -> Iterator[float]:
        if self.stitching:
            yield from 3 * [float(np.radians(self.stitching.turn_sigma_deg))] + 2 * [self.stitching.scale_sigma]
        if self.shutter:
            yield self.shutter.sigma_s

    def added(self, observations: Observations) -> Observations:
        """The observations with the parameters among their shared unknowns, last; `freed` fills in how pixels move."""
        shared, count = observations.shared, len(self.names)
        own = len(shared.prior) + np.tile(np.arange(count), (len(observations), 1))
        moves = np.zeros((len(observations), 2, count))
        wider = Biases(
            np.concatenate([shared.which, own], axis=1),
            np.concatenate([shared.moves, moves], axis=2),
            np.concatenate([shared.prior, self.prior]),
            np.concatenate([shared.free, np.ones(count, np.bool_)]),
        )
        return replace(observations, shared=wider)

    def freed(self, observations: Observations, values: Floats, scene: Scene) -> Observations:
        """Observations with `added` parameters freed of `values` (p,), and how their pixels move with them now."""
        count = len(self.names)
        pixels, moves = observations.pixels, list[Floats]()
        if self.stitching:
            blend, own = self.stitching.blend_deg, values[: len(TURNS + STRETCHES)]
            pixels, turned = _unstitched(observations, self.front_deg, blend, own)
            moves.append(turned)
        if self.shutter:
            late = _late(observations, self.front_deg, self.shutter.axis, scene)
            pixels = pixels - values[-1] * late
            moves.append(late[:, :, None])
        shared = observations.shared
        every = np.concatenate([shared.moves[:, :, :-count], *moves], axis=2)
        return replace(observations, pixels=pixels, shared=replace(shared, moves=every))


def turns(rays: Floats, front_deg: float, blend_deg: float) -> Floats:
    """Small turns (n, 5, 3) of rays (n, 3) of the panorama to their true directions, a radian or a unit of scale."""
    ahead = _ahead(front_deg)
    off_axis = np.arccos(np.clip(rays @ ahead, -1.0, 1.0))
    rear = np.clip((np.degrees(off_axis) - 90.0) / blend_deg + 0.5, 0.0, 1.0)
    about = np.cross(ahead, rays)
    about /= np.maximum(np.linalg.norm(about, axis=-1), 1e-9)[:, None]
    halves = (rear - 0.5)[:, None, None] * np.eye(3)
    stretched = [((1 - rear) * off_axis)[:, None] * about, (rear * (np.pi - off_axis))[:, None] * -about]
    return np.concatenate([halves, np.stack(stretched, axis=1)], axis=1)


def _ahead(front_deg: float) -> Floats:
    longitude = np.radians(front_deg)
    return np.array([np.sin(longitude), 0.0, np.cos(longitude)])


def _unstitched(
    observations: Observations, front_deg: float, blend_deg: float, values: Floats
) -> tuple[Floats, Floats]:
    """True pixels (n, 2), and how observed ones move (n, 2, 5) with the parameters."""
    mounts, cameras = _lenses(observations)
    rays = _rays(observations.pixels, mounts, cameras)
    basis = turns(rays, front_deg, blend_deg)
    straight: Floats = Rotation.from_rotvec(np.einsum("p,npi->ni", values, basis)).apply(rays)
    pixels, slopes = _projected(straight, mounts, cameras)
    moves = -np.einsum("nij,npj->nip", slopes, np.cross(basis, straight[:, None]))
    return pixels, moves


def _late(observations: Observations, front_deg: float, axis: str, scene: Scene) -> Floats:
    """How pixels move (n, 2) with the read-out time, px/s; 0 for points behind the view."""
    mounts, cameras = _lenses(observations)
    rays = _rays(observations.pixels, mounts, cameras)
    _, slopes = _projected(scene.points, mounts, cameras)
    seen = np.einsum("nji,nj->ni", mounts, scene.points)[:, 2] > LEAST_DEPTH_M
    velocity = np.einsum("nij,nj->ni", slopes, scene.velocities) * seen[:, None]
    moves: Floats = read_out_share(rays, front_deg, axis)[:, None] * velocity
    return moves


def read_out_share(rays: Floats, front_deg: float, axis: str) -> Floats:
    """When rays (n, 3) are read out, -1/2..1/2 of the read-out time."""
    if axis == "rows":
        return np.arcsin(np.clip(rays[:, 1], -1.0, 1.0)) / np.pi
    longitude = np.arctan2(rays[:, 0], rays[:, 2]) - np.radians(front_deg)
    share: Floats = np.mod(longitude / np.pi + 0.5, 1.0) - 0.5
    return share


def _lenses(observations: Observations) -> tuple[Floats, Floats]:
    """rig_from_view (n, 3, 3) and calibration matrix (n, 3, 3) of every observation."""
    mounts = np.array([spec.rig_from_view for spec in observations.views]).reshape(-1, 3, 3)
    cameras = np.array([spec.camera for spec in observations.views]).reshape(-1, 3, 3)
    return mounts[observations.view], cameras[observations.view]


def _rays(pixels: Floats, mounts: Floats, cameras: Floats) -> Floats:
    """Unit rays (n, 3) in the rig frame."""
    focal = np.stack([cameras[:, 0, 0], cameras[:, 1, 1]], axis=1)
    plane = np.concatenate([(pixels - cameras[:, :2, 2]) / focal, np.ones((len(pixels), 1))], axis=1)
    rays = np.einsum("nij,nj->ni", mounts, plane)
    unit: Floats = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    return unit


def _projected(points: Floats, mounts: Floats, cameras: Floats) -> tuple[Floats, Floats]:
    """Pixels (n, 2) of points (n, 3) in the rig frame, and their derivatives (n, 2, 3) to these."""
    local = np.einsum("nji,nj->ni", mounts, points)
    depth = np.maximum(local[:, 2], LEAST_DEPTH)
    focal = np.stack([cameras[:, 0, 0], cameras[:, 1, 1]], axis=1)
    plane = local[:, :2] / depth[:, None]
    slopes = np.zeros((len(points), 2, 3))
    slopes[:, 0, 0] = slopes[:, 1, 1] = 1.0
    slopes[:, :, 2] = -plane
    slopes = (focal / depth[:, None])[:, :, None] * slopes @ np.swapaxes(mounts, 1, 2)
    return plane * focal + cameras[:, :2, 2], slopes
