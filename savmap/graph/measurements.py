"""Measured pixels of landmarks as arrays: what the projection factors are made of."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from savmap.types import Floats, Ints, RowFacts, Track, Trajectory, ViewSpec


@dataclass(frozen=True, eq=False)
class Biases:
    """k unknown biases, px, of which each of n measurements has up to s: `indices` (n, s) of the biases, and `slopes`
    (n, 2, s), the pixel's derivative to each, 0 where there is none.

    `prior` (k,): their standard deviations; `free` (k,): which are estimated. The others are taken for 0, and sigmas
    allow for them. Those that are `relative` (k,) are multiples of each measurement's standard deviation rather than
    px: their slopes hold that as it was given, and where the residuals show another one, it is theirs that counts.
    """

    indices: Ints
    slopes: Floats
    prior: Floats
    free: NDArray[np.bool_]
    relative: NDArray[np.bool_]

    def take(self, chosen: NDArray[np.bool_]) -> "Biases":
        """Of the measurements where a mask (n,) is true."""
        return replace(self, indices=self.indices[chosen], slopes=self.slopes[chosen])

    def moved(self, values: Floats) -> Floats:
        """How far (n, 2) px biases (k,) move the measurements."""
        if not len(values):
            return np.zeros((len(self.indices), 2))
        return np.asarray(np.einsum("nis,ns->ni", self.slopes, values[self.indices]))

    def scaled(self, scales: Floats) -> Floats:
        """Slopes (n, 2, s) where measurements' standard deviations are `scales` (n,) times those given."""
        if not self.relative.any():
            return self.slopes
        return self.slopes * np.where(self.relative[self.indices], scales[:, None], 1.0)[:, None, :]


def no_biases(count: int) -> Biases:
    """Measurements (count,) without biases."""
    none = np.zeros(0)
    return Biases(np.zeros((count, 0), np.int64), np.zeros((count, 2, 0)), none, *(2 * [none.astype(np.bool_)]))


@dataclass(frozen=True, eq=False)
class ImageMeasurements:
    """Landmarks with `keys` (n,), seen in `frames` (n,) at `pixels` (n, 2) with `covariances` (n, 2, 2) px^2, in
    views[view (n,)].

    `dof` (n,) is how many equations a measurement is worth: 2 for a point, 1 for a point on an edge, less where several
    share one edge. `biases`: those that measurements have in common. `classes` (n,) are indices into `class_names`:
    measurements of one class err alike.
    """

    frames: Ints
    keys: Ints
    view: Ints
    pixels: Floats
    covariances: Floats
    dof: Floats
    views: tuple[ViewSpec, ...]
    biases: Biases
    classes: Ints
    class_names: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.frames)

    def take(self, chosen: NDArray[np.bool_]) -> "ImageMeasurements":
        """The measurements where a mask (n,) is true."""
        names = ("frames", "keys", "view", "pixels", "covariances", "dof", "classes")
        return replace(self, biases=self.biases.take(chosen), **{name: getattr(self, name)[chosen] for name in names})

    def inflated(self, factors: Floats) -> "ImageMeasurements":
        """The measurements with `factors` (n,) times their covariances."""
        return replace(self, covariances=self.covariances * factors[:, None, None])

    def without(self, bias: Floats) -> "ImageMeasurements":
        """The measurements corrected for biases (k,) px."""
        return replace(self, pixels=self.pixels - self.biases.moved(bias))


@dataclass(frozen=True, eq=False)
class LinearForms:
    """Measurements as linear forms: whitened pixel error = (forms @ (point - camera)) / depth, exact for a pinhole.

    forms (n, 2, 3) and axes (n, 3), the view's optical axis in the rig or world frame, so that depth = axes . (point -
    camera).
    """

    forms: Floats
    axes: Floats

    def rotated(self, world_from_rig: Floats) -> "LinearForms":
        """The same in the world frame, for attitudes (n, 3, 3)."""
        return LinearForms(
            self.forms @ np.swapaxes(world_from_rig, 1, 2), np.einsum("nij,nj->ni", world_from_rig, self.axes)
        )

    def residuals(self, offsets: Floats) -> tuple[Floats, Floats]:
        """Whitened errors (n, 2) and depths (n,) of points at `offsets` (n, 3) m from the camera; behind it: error
        1e6."""
        depths = np.einsum("ni,ni->n", self.axes, offsets)
        safe = np.where(depths > 1e-6, depths, 1.0)
        errors = np.einsum("nij,nj->ni", self.forms, offsets) / safe[:, None]
        return np.where((depths > 1e-6)[:, None], errors, 1e6), depths


def image_measurements(
    tracks: Sequence[Track],
    keys: Mapping[str, int],
    views: Mapping[str, ViewSpec],
    dof: Mapping[str, Floats] | None = None,
    biases: Biases | None = None,
) -> ImageMeasurements:
    """All pixels of the tracks, each with its full covariance (the paper's weights w_ij). `dof` (by track, one each
    measurement) need only be given where the covariance does not show it; `biases`: in the tracks' order."""
    number = {name: index for index, name in enumerate(views)}
    labels = tuple(dict.fromkeys(track.label for track in tracks))
    worth = [(dof or {}).get(track.name, usual_dof(track.covariances)) for track in tracks]
    return ImageMeasurements(
        np.concatenate([np.zeros(0, np.int64), *(track.frames for track in tracks)]),
        np.array([keys[track.name] for track in tracks for _ in track.views], np.int64),
        np.array([number[view] for track in tracks for view in track.views], np.int64),
        np.concatenate([np.zeros((0, 2)), *(track.pixels for track in tracks)]),
        np.concatenate([np.zeros((0, 2, 2)), *(track.covariances for track in tracks)]),
        np.concatenate([np.zeros(0), *worth]),
        tuple(views.values()),
        biases or no_biases(sum(len(track.frames) for track in tracks)),
        np.array([labels.index(track.label) for track in tracks for _ in track.views], np.int64),
        labels,
    )


def usual_dof(covariances: Floats) -> Floats:
    """2 for round covariances (n, 2, 2), 1 for those more than 30 times as long as wide."""
    spread = np.linalg.eigvalsh(covariances)
    return np.where(spread[:, 1] > 900 * spread[:, 0], 1.0, 2.0)


def join(parts: Sequence[ImageMeasurements]) -> ImageMeasurements:
    """Measurements of several plugins in one record, plugin after plugin."""
    views = np.cumsum([0, *(len(part.views) for part in parts)]).tolist()
    names = np.cumsum([0, *(len(part.class_names) for part in parts)]).tolist()
    same = ("frames", "keys", "pixels", "covariances", "dof")
    return ImageMeasurements(
        **{name: np.concatenate([getattr(part, name) for part in parts]) for name in same},
        view=np.concatenate([part.view + offset for part, offset in zip(parts, views, strict=False)]),
        views=tuple(spec for part in parts for spec in part.views),
        biases=_joined_biases([part.biases for part in parts]),
        classes=np.concatenate([part.classes + offset for part, offset in zip(parts, names, strict=False)]),
        class_names=tuple(name for part in parts for name in part.class_names),
    )


def _joined_biases(parts: Sequence[Biases]) -> Biases:
    """Biases of several plugins in one record: no two plugins share a bias."""
    slots = max((part.indices.shape[1] for part in parts), default=0)
    first = np.cumsum([0, *(len(part.prior) for part in parts)]).tolist()
    wider = [((0, 0), (0, slots - part.indices.shape[1])) for part in parts]
    return Biases(
        np.concatenate([np.pad(p.indices + at, more) for p, at, more in zip(parts, first, wider, strict=False)]),
        np.concatenate([np.pad(p.slopes, ((0, 0), *more)) for p, more in zip(parts, wider, strict=True)]),
        *(np.concatenate([getattr(part, name) for part in parts]) for name in ("prior", "free", "relative")),
    )


def cameras_of(measurements: ImageMeasurements) -> tuple[Floats, Floats]:
    """The calibration matrix (n, 3, 3) and rig_from_view (n, 3, 3) of each measurement."""
    cameras = np.array([spec.camera for spec in measurements.views]).reshape(-1, 3, 3)
    rotations = np.array([spec.rig_from_view for spec in measurements.views]).reshape(-1, 3, 3)
    return cameras[measurements.view], rotations[measurements.view]


def linear_forms(measurements: ImageMeasurements) -> LinearForms:
    """The measurements' linear forms in the rig frame."""
    cameras, rotations = cameras_of(measurements)
    forms = np.zeros((len(measurements), 2, 3))
    forms[:, 0, 0], forms[:, 1, 1] = cameras[:, 0, 0], cameras[:, 1, 1]
    forms[:, :, 2] = cameras[:, :2, 2] - measurements.pixels
    whiten = np.linalg.inv(np.linalg.cholesky(measurements.covariances))
    return LinearForms(whiten @ forms @ np.swapaxes(rotations, 1, 2), rotations[:, :, 2])


def sight_lines(track: Track, facts: RowFacts, start: Trajectory) -> tuple[Floats, Floats]:
    """Origins (n, 3) m and unit rays (n, 3) in the row's frame of a track of points, seen from the poses of `start`.
    Frames without a pose are left out. `savmap.geometry.triangulate` gives the points nearest to such rays."""
    poses = dict(zip(start.frames.tolist(), start.world_from_rig, strict=True))
    seen = [
        (poses[frame], facts.views[view].rig_rays(pixel))
        for frame, view, pixel in zip(track.frames.tolist(), track.views, track.pixels, strict=True)
        if frame in poses
    ]
    return np.array([pose[:3, 3] for pose, _ in seen]), np.array([pose[:3, :3] @ ray for pose, ray in seen])
