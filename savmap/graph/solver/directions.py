"""What measurements are off by in one direction of the camera, the same in all frames: pictures that are no perfect panorama.

A lens program that bends the pictures at their seam, or a cropped panorama, moves what is seen in a direction by the same angle in every frame. Poses
and structures absorb most of that, so that residuals stay small, and references agree; what is left of it is smooth over the sphere and does not
average out. It is fitted as a field of small turns: Fourier terms of the longitude times powers of the latitude, for either component. Errors of
measuring alone leave next to none, for a structure is seen in other directions from frame to frame.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from savmap.graph.calibration.distortion import Lenses
from savmap.graph.measurements import ImageMeasurements
from savmap.graph.problem import Estimate, Problem
from savmap.graph.solver.residuals import Fit
from savmap.types import Bools, Floats

WAVES, POWERS = 3, 2
"""The highest Fourier term in longitude and the highest power of the latitude."""
USUAL_DEG = 0.3
"""Standard deviation of a coefficient before anything is known."""
FEWEST = 60
"""From fewer measurements no field is fitted: its coefficients would follow their errors."""
FAR_SIGMA = 3.0


@dataclass(frozen=True)
class DirectionalErrors:
    """By how much directions are off: the field's `angle_deg` (rms where something was measured), and the `share` of the squared errors
    that it explains."""

    angle_deg: float
    share: float


def directional_errors(problem: Problem, estimate: Estimate, fit: Fit) -> dict[str, DirectionalErrors]:
    """By plugin, the directional errors of what it measured and the solve kept. Plugins of which too little was measured have none."""
    return {
        part.plugin: found
        for part in problem.parts
        if (found := _field_of(problem, estimate, fit.kept & np.isin(problem.measurements.keys, [*part.keys.values()])))
    }


def _field_of(problem: Problem, estimate: Estimate, chosen: Bools) -> DirectionalErrors | None:
    if np.count_nonzero(chosen) < FEWEST:
        return None
    measurements = problem.measurements.take(chosen)
    rig_from_world = np.swapaxes(estimate.poses[problem.at_frame[chosen], :3, :3], 1, 2)
    offsets = estimate.points[problem.at_key[chosen]] - estimate.poses[problem.at_frame[chosen], :3, 3]
    lenses = Lenses.of(measurements)
    errors = measurements.pixels - lenses.projected(np.einsum("nij,nj->ni", rig_from_world, offsets))[0]
    whitening = np.swapaxes(np.linalg.cholesky(np.linalg.inv(measurements.covariances)), 1, 2)
    whitened = np.einsum("nij,nj->ni", whitening, errors)
    size = np.linalg.norm(whitened, axis=1)
    weights = 1 / np.sqrt(1 + (size / (FAR_SIGMA * max(1.0, float(np.median(size))))) ** 2)
    terms, moves = _terms(measurements, lenses)
    slopes = np.einsum("nij,njk,nt->nikt", whitening, moves, terms) * weights[:, None, None, None]
    slopes, values = slopes.reshape(2 * len(size), -1), (whitened * weights[:, None]).ravel()
    prior = np.eye(slopes.shape[1]) / np.radians(USUAL_DEG) ** 2
    field = np.linalg.solve(slopes.T @ slopes + prior, slopes.T @ values)
    share = 1 - float(np.square(values - slopes @ field).sum() / max(np.square(values).sum(), 1e-12))
    turns = terms @ field.reshape(2, -1).T
    return DirectionalErrors(float(np.degrees(np.sqrt(np.square(turns).sum(axis=1).mean()))), share)


def _terms(measurements: ImageMeasurements, lenses: Lenses) -> tuple[Floats, Floats]:
    """The field's terms (n, t) in the measurements' directions, and how their pixels move (n, 2, 2) as these turn eastwards and upwards, px a radian."""
    rays = lenses.rays(measurements.pixels)
    longitude, latitude = np.arctan2(rays[:, 0], rays[:, 2]), np.arcsin(np.clip(-rays[:, 1], -1.0, 1.0))
    east = np.stack([np.cos(longitude), np.zeros(len(rays)), -np.sin(longitude)], axis=1)
    up = np.cross(east, rays)
    slopes = lenses.projected(rays)[1]
    moves = np.stack([np.einsum("nij,nj->ni", slopes, towards) for towards in (east, up)], axis=2)
    return np.stack([*_products(longitude, latitude)], axis=1), moves


def _products(longitude: Floats, latitude: Floats) -> Iterator[Floats]:
    for power in range(POWERS + 1):
        high = latitude**power
        yield high
        for wave in range(1, WAVES + 1):
            yield high * np.cos(wave * longitude)
            yield high * np.sin(wave * longitude)
