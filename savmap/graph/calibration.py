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

from savmap.errors import SolveError
from savmap.graph.distortion import Distortion, Lenses, Scene
from savmap.graph.observations import Biases, Observations
from savmap.types import Floats

TURNS = ("rear pitch", "rear yaw", "rear roll")
STRETCHES = ("front scale", "rear scale")
SHUTTER = "read-out"
STEP_PX = 0.5
FAR_PX = 300.0


@dataclass(frozen=True)
class Stitching:
    """Standard deviations of the rear half's turn against the front half about each of the front lens's axes, degrees, and of
    each lens's scale. The halves are blended over `blend_deg`."""

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
        """Observations with `added` parameters freed of `values` (p,), and how they move with them now.

        Pixels and their covariances go with the picture about them. How an observation moves is said of the place where
        its point should be, which an edge leaves open along itself: its line turns about where it was seen.
        """
        lenses = Lenses.of(observations)
        blend = self.stitching.blend_deg if self.stitching else None
        axis = self.shutter.axis if self.shutter else None
        field = Distortion(lenses, observations.pixels, values, scene, self.front_deg, blend, axis)
        pixels, here = field(observations.pixels)
        step = STEP_PX * np.eye(2)
        slopes = np.stack([field(observations.pixels + one)[0] - pixels for one in step], axis=2) / STEP_PX
        off = np.clip(lenses.nearest(scene.points, pixels) - pixels, -FAR_PX, FAR_PX)
        size = np.maximum(np.linalg.norm(off, axis=1), STEP_PX)[:, None]
        near = field(observations.pixels + STEP_PX * off / size)[1]
        moves = here + (size / STEP_PX)[:, :, None] * (near - here)
        shared = observations.shared
        every = np.concatenate([shared.moves[:, :, : -len(self.names)], moves], axis=2)
        return replace(
            observations,
            pixels=pixels,
            covariances=slopes @ observations.covariances @ np.swapaxes(slopes, 1, 2),
            shared=replace(shared, moves=every),
        )
