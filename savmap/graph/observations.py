"""Observed pixels as arrays: what the projection factors are made of."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from savmap.types import Floats, Ints, Track, ViewSpec


@dataclass(frozen=True)
class Biases:
    """k unknown biases, px, of which each of n observations has up to s: `which` (n, s), and how it moves with them
    (n, 2, s), 0 where there is none.

    `prior` (k,): their standard deviations; `free` (k,): which are estimated. The others are taken for 0, and sigmas allow
    for them.
    """

    which: Ints
    moves: Floats
    prior: Floats
    free: NDArray[np.bool_]

    def take(self, chosen: NDArray[np.bool_]) -> "Biases":
        """Of the observations where a mask (n,) is true."""
        return replace(self, which=self.which[chosen], moves=self.moves[chosen])

    def moved(self, values: Floats) -> Floats:
        """How far (n, 2) px biases (k,) move the observations."""
        if not len(values):
            return np.zeros((len(self.which), 2))
        return np.asarray(np.einsum("nis,ns->ni", self.moves, values[self.which]))


def no_biases(count: int) -> Biases:
    """Observations (count,) without biases."""
    none = np.zeros(0)
    return Biases(np.zeros((count, 0), np.int64), np.zeros((count, 2, 0)), none, none.astype(np.bool_))


@dataclass(frozen=True)
class Observations:
    """Landmark `keys` (n,) seen in `frames` (n,) at `pixels` (n, 2) with `covariances` (n, 2, 2) px^2, in views[view (n,)].

    `dof` (n,) is how many equations an observation is worth: 2 for a point, 1 for a point on an edge, less where several share one edge.
    `shared`: biases that observations have in common.
    """

    frames: Ints
    keys: Ints
    view: Ints
    pixels: Floats
    covariances: Floats
    dof: Floats
    views: tuple[ViewSpec, ...]
    shared: "Biases"

    def __len__(self) -> int:
        return len(self.frames)

    def take(self, chosen: NDArray[np.bool_]) -> "Observations":
        """The observations where a mask (n,) is true."""
        return Observations(
            self.frames[chosen],
            self.keys[chosen],
            self.view[chosen],
            self.pixels[chosen],
            self.covariances[chosen],
            self.dof[chosen],
            self.views,
            self.shared.take(chosen),
        )

    def without(self, bias: Floats) -> "Observations":
        """The observations freed of biases (k,) px."""
        return replace(self, pixels=self.pixels - self.shared.moved(bias))


@dataclass(frozen=True)
class Sight:
    """Observations as linear forms: whitened pixel error = (forms @ (point - camera)) / depth, exact for a pinhole.

    forms (n, 2, 3) and axes (n, 3), the view's optical axis in the rig or world frame, so that depth = axes . (point - camera).
    """

    forms: Floats
    axes: Floats

    def turned(self, world_from_rig: Floats) -> "Sight":
        """The same in the world frame, for attitudes (n, 3, 3)."""
        return Sight(self.forms @ np.swapaxes(world_from_rig, 1, 2), np.einsum("nij,nj->ni", world_from_rig, self.axes))

    def residuals(self, offsets: Floats) -> tuple[Floats, Floats]:
        """Whitened errors (n, 2) and depths (n,) of points at `offsets` (n, 3) m from the camera; behind it: error 1e6."""
        depths = np.einsum("ni,ni->n", self.axes, offsets)
        safe = np.where(depths > 1e-6, depths, 1.0)
        errors = np.einsum("nij,nj->ni", self.forms, offsets) / safe[:, None]
        return np.where((depths > 1e-6)[:, None], errors, 1e6), depths


def observe(
    tracks: Sequence[Track],
    keys: Mapping[str, int],
    views: Mapping[str, ViewSpec],
    weights: Mapping[str, float] | None = None,
    dof: Mapping[str, Floats] | None = None,
    shared: Biases | None = None,
) -> Observations:
    """All pixels of the tracks, each with its full covariance; `weights` (by track) are the paper's w_ij, 1 if not given.
    `dof` (by track, one each observation) need only be given where it is not plain from the covariance; `shared`: their biases, in
    the tracks' order."""
    number = {name: index for index, name in enumerate(views)}
    worth = dof or {}
    return Observations(
        np.concatenate([np.zeros(0, np.int64), *(track.frames for track in tracks)]),
        np.repeat(np.array([keys[track.name] for track in tracks], np.int64), [len(track.frames) for track in tracks]),
        np.array([number[view] for track in tracks for view in track.views], np.int64),
        np.concatenate([np.zeros((0, 2)), *(track.pixels for track in tracks)]),
        np.concatenate(
            [np.zeros((0, 2, 2)), *(track.covariances / (weights or {}).get(track.name, 1.0) for track in tracks)]
        ),
        np.concatenate([np.zeros(0), *(worth.get(track.name, plain_dof(track.covariances)) for track in tracks)]),
        tuple(views.values()),
        shared or no_biases(sum(len(track.frames) for track in tracks)),
    )


def plain_dof(covariances: Floats) -> Floats:
    """2 for round covariances (n, 2, 2), 1 for those more than 30 times as long as wide."""
    spread = np.linalg.eigvalsh(covariances)
    return np.where(spread[:, 1] > 900 * spread[:, 0], 1.0, 2.0)


def join(parts: Sequence[Observations]) -> Observations:
    """Observations of several rooms in one, room after room."""
    offsets = np.cumsum([0, *(len(part.views) for part in parts)]).tolist()
    return Observations(
        np.concatenate([part.frames for part in parts]),
        np.concatenate([part.keys for part in parts]),
        np.concatenate([part.view + offset for part, offset in zip(parts, offsets, strict=False)]),
        np.concatenate([part.pixels for part in parts]),
        np.concatenate([part.covariances for part in parts]),
        np.concatenate([part.dof for part in parts]),
        tuple(spec for part in parts for spec in part.views),
        _joined_biases([part.shared for part in parts]),
    )


def _joined_biases(parts: Sequence[Biases]) -> Biases:
    """Those of several rooms in one: each room has its own."""
    slots = max((part.which.shape[1] for part in parts), default=0)
    first = np.cumsum([0, *(len(part.prior) for part in parts)]).tolist()
    wider = [slots - part.which.shape[1] for part in parts]
    return Biases(
        np.concatenate(
            [np.pad(p.which + at, ((0, 0), (0, more))) for p, at, more in zip(parts, first, wider, strict=False)]
        ),
        np.concatenate([np.pad(p.moves, ((0, 0), (0, 0), (0, more))) for p, more in zip(parts, wider, strict=True)]),
        np.concatenate([part.prior for part in parts]),
        np.concatenate([part.free for part in parts]),
    )


def sight(observations: Observations) -> Sight:
    """The observations' linear forms in the rig frame."""
    cameras = np.array([spec.camera for spec in observations.views]).reshape(-1, 3, 3)[observations.view]
    rotations = np.array([spec.rig_from_view for spec in observations.views]).reshape(-1, 3, 3)[observations.view]
    forms = np.zeros((len(observations), 2, 3))
    forms[:, 0, 0], forms[:, 1, 1] = cameras[:, 0, 0], cameras[:, 1, 1]
    forms[:, :, 2] = cameras[:, :2, 2] - observations.pixels
    whiten = np.linalg.inv(np.linalg.cholesky(observations.covariances))
    return Sight(whiten @ forms @ np.swapaxes(rotations, 1, 2), rotations[:, :, 2])
