"""Measured pixels as rows of the equations, all at once, beside GTSAM's factors: GTSAM's projection factors, an object
for each pixel, cost most of a solve to make and to linearize."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import gtsam
import numpy as np

from savmap.graph.keys import frame_key, rekey
from savmap.graph.measurements import ImageMeasurements, linear_forms
from savmap.types import Floats, Ints

FAR_OFF = 1e3
"""What a point behind the camera is off, in standard deviations."""
NEAR_M = 1e-6


@dataclass(frozen=True, eq=False)
class Projections:
    """Points with keys `points` (n,), seen from poses with keys `frames` (n,): whitened pixel error = (forms @ q) /
    (axes . q) for a point q in the rig, with forms (n, 2, 3) and axes (n, 3); in Huber's loss that turns from squares
    at `huber` (n,)."""

    frames: Ints
    points: Ints
    forms: Floats
    axes: Floats
    huber: Floats

    @staticmethod
    def of(measurements: ImageMeasurements, huber: float | Floats | None, row: int = 0) -> "Projections":
        """Measurements with their full covariances, in Huber's loss, one or one each (n,), unless that is None; in a
        graph of several rows those of `row`."""
        forms = linear_forms(measurements)
        widths = np.full(len(measurements), np.inf if huber is None else huber)
        return Projections(
            measurements.frames + rekey(frame_key(0), row),
            measurements.keys + rekey(0, row),
            forms.forms,
            forms.axes,
            widths,
        )

    @staticmethod
    def joined(parts: Sequence["Projections"]) -> "Projections":
        """All parts' rows, part after part."""
        names = ("frames", "points", "forms", "axes", "huber")
        return Projections(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))

    @cached_property
    def _places(self) -> tuple[Ints, Ints, Ints, Ints]:
        """Keys of the frames (f,) and where each row's (n,) is among them; the same of the points."""
        return (*np.unique(self.frames, return_inverse=True), *np.unique(self.points, return_inverse=True))

    def _seen(self, values: gtsam.Values) -> tuple[Floats, Floats, Floats, Floats]:
        """Rotations world_from_rig (n, 3, 3), points (n, 3) m in the rig, their depths and whitened errors (n, 2)."""
        frames, at_frame, points, at_point = self._places
        poses = np.array([values.atPose3(key).matrix() for key in frames.tolist()]).reshape(-1, 4, 4)
        places = np.array([values.atPoint3(key) for key in points.tolist()]).reshape(-1, 3)
        rotations = poses[at_frame, :3, :3]
        offsets = np.einsum("nji,nj->ni", rotations, places[at_point] - poses[at_frame, :3, 3])
        depths = np.einsum("ni,ni->n", self.axes, offsets)
        before = depths > NEAR_M
        depths = np.where(before, depths, np.inf)
        errors = np.einsum("nij,nj->ni", self.forms, offsets) / depths[:, None]
        errors[~before] = FAR_OFF
        return rotations, offsets, depths, errors

    def error(self, values: gtsam.Values) -> float:
        """Half the sum of the squared errors, in Huber's loss."""
        size = np.linalg.norm(self._seen(values)[-1], axis=1)
        within = np.minimum(size, self.huber)
        return float((within * (size - within / 2)).sum())

    def linearized(self, values: gtsam.Values) -> tuple[Floats, Floats]:
        """Derivatives (n, 2, 9) of the errors, times the root of their weight in Huber's loss, by turns and steps of
        the rig in its own axes and by the point; and the right side (n, 2)."""
        rotations, offsets, depths, errors = self._seen(values)
        weights = np.sqrt(np.minimum(1.0, self.huber / np.maximum(np.linalg.norm(errors, axis=1), 1e-9)))
        slopes = self.forms - errors[:, :, None] * self.axes[:, None]
        slopes *= (weights / depths)[:, None, None]
        in_world = slopes @ np.swapaxes(rotations, 1, 2)
        rows = np.concatenate([np.cross(slopes, offsets[:, None]), -in_world, in_world], axis=2)
        return rows, -weights[:, None] * errors


@dataclass(frozen=True, eq=False)
class Graph:
    """GTSAM's factors, and the measured pixels."""

    factors: gtsam.NonlinearFactorGraph
    pixels: Projections

    def error(self, values: gtsam.Values) -> float:
        """Half the sum of all squared errors, in their losses."""
        return float(self.factors.error(values)) + self.pixels.error(values)
