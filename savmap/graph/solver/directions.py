"""What measurements are off by in one direction of the camera, the same in all frames: pictures that are no perfect
panorama.

A lens program that bends the pictures at their seam, or a cropped panorama, moves what is seen in a direction by the
same angle in every frame. Poses and structures absorb most of that, so that residuals stay small, and references agree;
what is left of it is smooth over the sphere and does not average out. It is fitted as a field of small turns: Fourier
terms of the longitude times powers of the latitude, for either component. Errors of measuring alone leave next to none,
for a structure is seen in other directions from frame to frame.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from savmap.graph.calibration.distortion import Lenses
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
    """By how much directions are off: the field's `angle_deg` (rms where something was measured), and the `share` of
    the squared errors that it explains."""

    angle_deg: float
    share: float


def directional_errors(problem: Problem, estimate: Estimate, fit: Fit) -> dict[str, DirectionalErrors]:
    """By plugin, the directional errors of what it measured and the solve kept. Plugins of which too little was
    measured have none."""
    errors = problem.residuals(estimate.poses, estimate.points)
    kept = {part.plugin: fit.kept & np.isin(problem.measurements.keys, [*part.keys.values()]) for part in problem.parts}
    return {plugin: _field_of(problem, errors, chosen) for plugin, chosen in kept.items() if chosen.sum() >= FEWEST}


def _field_of(problem: Problem, errors: Floats, chosen: Bools) -> DirectionalErrors:
    """The field that explains the whitened errors (n, 2) of the chosen measurements (n,)."""
    values = errors[chosen]
    size = np.linalg.norm(values, axis=1)
    weights = 1 / np.sqrt(1 + (size / (FAR_SIGMA * max(1.0, float(np.median(size))))) ** 2)
    terms, moves = _terms(problem, chosen)
    slopes = np.einsum("nik,nt->nikt", moves, terms) * weights[:, None, None, None]
    slopes, values = slopes.reshape(2 * len(size), -1), (values * weights[:, None]).ravel()
    prior = np.eye(slopes.shape[1]) / np.radians(USUAL_DEG) ** 2
    field = np.linalg.solve(slopes.T @ slopes + prior, slopes.T @ values)
    share = 1 - float(np.square(values - slopes @ field).sum() / max(np.square(values).sum(), 1e-12))
    turns = terms @ field.reshape(2, -1).T
    return DirectionalErrors(float(np.degrees(np.sqrt(np.square(turns).sum(axis=1).mean()))), share)


def _terms(problem: Problem, chosen: Bools) -> tuple[Floats, Floats]:
    """The field's terms (n, t) in the directions of the chosen measurements, and how their whitened errors change (n,
    2, 2) as these turn eastwards and upwards, a radian."""
    measurements, forms = problem.measurements.take(chosen), problem.linear_forms
    rays = Lenses.of(measurements).rays(measurements.pixels)
    longitude, latitude = np.arctan2(rays[:, 0], rays[:, 2]), np.arcsin(np.clip(-rays[:, 1], -1.0, 1.0))
    east = np.stack([np.cos(longitude), np.zeros(len(rays)), -np.sin(longitude)], axis=1)
    towards = np.stack([east, np.cross(east, rays)], axis=2)
    depths = np.einsum("ni,ni->n", forms.axes[chosen], rays)
    moves = forms.forms[chosen] @ towards / depths[:, None, None]
    return np.stack([*_products(longitude, latitude)], axis=1), moves


def _products(longitude: Floats, latitude: Floats) -> Iterator[Floats]:
    for power in range(POWERS + 1):
        high = latitude**power
        yield high
        for wave in range(1, WAVES + 1):
            yield high * np.cos(wave * longitude)
            yield high * np.sin(wave * longitude)
