"""What is wrong with the camera as unknowns of the solve: how its panoramas are stitched, and how long they take to
read out.

A consumer panorama is put together from two fisheye lenses, back to back. To first order, wrong angles between the
lenses and wrong principal points turn one half against the other, and a wrong focal length stretches a half away from
its axis: small turns phi = sum_j beta_j b_j(r) of each ray r, the same in every frame (additional parameters of a
self-calibrating bundle adjustment; Brown 1971). A panorama that was cropped above and below and stretched to 2:1 again
shows all elevations larger by one factor. The baseline between the two lenses displaces what is seen at their seam by
its parallax (`bends`). A rolling shutter shows a point where it was s tau later, s = -1/2..1/2 across the read-out: one
unknown, tau, times the pixel's velocity between neighbouring frames (Hedborg et al., Rolling shutter bundle adjustment,
CVPR 2012). Turning jitter faster than the frames follow one another is not modelled.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from savmap.errors import SolveError
from savmap.graph.calibration.bends import BENDS
from savmap.graph.calibration.distortion import Distortion, Lenses, Scene
from savmap.graph.measurements import Biases, ImageMeasurements
from savmap.types import Floats

TURNS = ("rear pitch", "rear yaw", "rear roll")
STRETCHES = ("front scale", "rear scale")
VERTICAL = "vertical scale"
LENS_DISTANCES = tuple(f"lens distance ({bend.name})" for bend in BENDS)
SHUTTER = "read-out"
STEP_PX = 0.5
FAR_PX = 300.0


@dataclass(frozen=True)
class Stitching:
    """Standard deviations of the rear half's turn against the front half about each of the front lens's axes, degrees,
    and of each lens's scale. The halves are blended over `blend_deg`."""

    turn_sigma_deg: float = 1.0
    scale_sigma: float = 0.003
    blend_deg: float = 1.0

    def __post_init__(self) -> None:
        if min(self.turn_sigma_deg, self.scale_sigma, self.blend_deg) <= 0:
            raise SolveError("calibration of the panorama: sigmas and blend must be greater than 0")


@dataclass(frozen=True)
class VerticalScale:
    """Standard deviation of the share by which the panorama shows elevations too large."""

    sigma: float = 0.02

    def __post_init__(self) -> None:
        if self.sigma <= 0:
            raise SolveError("calibration of the vertical scale: sigma must be greater than 0")


@dataclass(frozen=True)
class LensDistance:
    """Standard deviation, m, about 0 of each part (`BENDS`) of the baseline between two lenses whose seam crosses the
    face. The solve begins at the parts' `initial_m`: far from the right baseline, measurements at the seam look like
    outliers."""

    sigma_m: float = 0.03

    def __post_init__(self) -> None:
        if self.sigma_m <= 0:
            raise SolveError("calibration of the lens distance: sigma must be greater than 0 m")


@dataclass(frozen=True)
class Shutter:
    """Standard deviation of the read-out time, s, over the panorama's rows (later lower down) or each half's columns
    (later to the right); negative where it runs the other way."""

    sigma_s: float = 0.02
    axis: Literal["rows", "columns"] = "rows"

    def __post_init__(self) -> None:
        if self.sigma_s <= 0:
            raise SolveError("calibration of the rolling shutter: sigma must be greater than 0 s")


@dataclass(frozen=True)
class Calibration:
    """Which terms are unknowns of the solve. Values are radians, fractions, metres and seconds, in the order of
    `names`. The front lens looks at longitude `front_deg` of the panorama; the lens distance does not use
    `front_deg`."""

    stitching: Stitching | None = None
    shutter: Shutter | None = None
    front_deg: float = 0.0
    vertical: VerticalScale | None = None
    lens_distance: LensDistance | None = None

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The parameters (p,)."""
        stitched = (*TURNS, *STRETCHES) if self.stitching else ()
        lenses = LENS_DISTANCES if self.lens_distance else ()
        return (*stitched, *((VERTICAL,) if self.vertical else ()), *lenses, *((SHUTTER,) if self.shutter else ()))

    @cached_property
    def prior(self) -> Floats:
        """Standard deviations (p,) about 0."""
        return np.array([*self._priors()])

    @cached_property
    def initial(self) -> Floats:
        """Where the solve begins (p,): 0 but for the lens distance."""
        known = {name: bend.initial_m for name, bend in zip(LENS_DISTANCES, BENDS, strict=True)}
        return np.array([known.get(name, 0.0) for name in self.names])

    def _priors(self) -> Iterator[float]:
        if self.stitching:
            yield from 3 * [float(np.radians(self.stitching.turn_sigma_deg))] + 2 * [self.stitching.scale_sigma]
        if self.vertical:
            yield self.vertical.sigma
        if self.lens_distance:
            yield from len(LENS_DISTANCES) * [self.lens_distance.sigma_m]
        if self.shutter:
            yield self.shutter.sigma_s

    def with_parameters(self, measurements: ImageMeasurements) -> ImageMeasurements:
        """The measurements with the parameters as their last biases; `corrected` fills in the slopes."""
        biases, count = measurements.biases, len(self.names)
        added = len(biases.prior) + np.tile(np.arange(count), (len(measurements), 1))
        slopes = np.zeros((len(measurements), 2, count))
        wider = Biases(
            np.concatenate([biases.indices, added], axis=1),
            np.concatenate([biases.slopes, slopes], axis=2),
            np.concatenate([biases.prior, self.prior]),
            np.concatenate([biases.free, np.ones(count, np.bool_)]),
            np.concatenate([biases.relative, np.zeros(count, np.bool_)]),
        )
        return replace(measurements, biases=wider)

    def without_parameters(self, measurements: ImageMeasurements) -> ImageMeasurements:
        """The measurements without the parameters, which are their last biases."""
        biases = measurements.biases
        count = len(biases.prior) - len(self.names)
        by_measurement = biases.indices.shape[1] - len(self.names)
        return replace(
            measurements,
            biases=Biases(
                biases.indices[:, :by_measurement],
                biases.slopes[:, :, :by_measurement],
                biases.prior[:count],
                biases.free[:count],
                biases.relative[:count],
            ),
        )

    def corrected(self, measurements: ImageMeasurements, values: Floats, scene: Scene) -> ImageMeasurements:
        """Measurements with these parameters corrected for `values` (p,), and their slopes to these now.

        Pixels, their covariances and the directions of other biases are moved with the picture about them: an edge's
        place is loose along it, and only there. The slopes of a measurement are those at the pixel where its point
        should be, which an edge leaves open along itself: its line turns about where it was seen.
        """
        lenses = Lenses.of(measurements)
        blend = self.stitching.blend_deg if self.stitching else None
        axis = self.shutter.axis if self.shutter else None
        vertical, distance = self.vertical is not None, self.lens_distance is not None
        field = Distortion(lenses, measurements.pixels, values, scene, self.front_deg, blend, axis, vertical, distance)
        pixels, here = field(measurements.pixels)
        step = STEP_PX * np.eye(2)
        slopes = np.stack([field(measurements.pixels + shift)[0] - pixels for shift in step], axis=2) / STEP_PX
        offset = np.clip(lenses.nearest(scene.points, pixels) - pixels, -FAR_PX, FAR_PX)
        size = np.maximum(np.linalg.norm(offset, axis=1), STEP_PX)[:, None]
        near = field(measurements.pixels + STEP_PX * offset / size)[1]
        moves = here + (size / STEP_PX)[:, :, None] * (near - here)
        biases = measurements.biases
        all_slopes = np.concatenate([slopes @ biases.slopes[:, :, : -len(self.names)], moves], axis=2)
        return replace(
            measurements,
            pixels=pixels,
            covariances=slopes @ measurements.covariances @ np.swapaxes(slopes, 1, 2),
            biases=replace(biases, slopes=all_slopes),
        )
