"""Covariances of all points and places at once.

`gtsam.Marginals` asks for one variable at a time. Frames meet only their neighbours, so they are eliminated sparsely, and what
is left, the points' information, is small and inverted whole: joint covariances come with it.
"""

from dataclasses import dataclass

import gtsam
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, cho_factor, cho_solve
from scipy.sparse import coo_matrix, csc_array, csc_matrix, hstack, vstack
from scipy.sparse.linalg import splu

from savmap.errors import SolveError
from savmap.types import Floats, Ints

CHUNK = 256
Bools = NDArray[np.bool_]


@dataclass(frozen=True)
class Shared:
    """Unknowns beside the graph's own that its last rows (r,) have in common: whitened derivatives (r, k), their value
    (k,) now, and the standard deviations (k,) of their prior, which is about 0. Those that are not `free` (k,) are not
    estimated: what they may be spreads to the others (Schmidt's consider parameters)."""

    columns: csc_array
    value: Floats
    prior: Floats
    free: Bools


@dataclass(frozen=True)
class Covariance:
    """Joint covariance `points` (3m, 3m) of the Point3 variables `keys` (m,), and variances (f, 3) of the frames' places.

    `shared` (k, k): covariance of the shared unknowns; `step` (k,): what would bring these to their optimum. `followed`
    (3m, c): how far the points follow each shared unknown that is not estimated, a standard deviation off: part of `points`.
    """

    keys: tuple[int, ...]
    points: Floats
    places: Floats
    shared: Floats
    step: Floats
    followed: Floats

    def of(self, keys: list[int]) -> Floats:
        """Joint covariance (3n, 3n) of some variables."""
        slots = self._slots(keys)
        joint: Floats = self.points[np.ix_(slots, slots)]
        return joint

    def considered(self, keys: list[int]) -> Floats:
        """The part (3n, 3n) of their joint covariance that comes from shared unknowns which are not estimated."""
        followed = self.followed[self._slots(keys)]
        part: Floats = followed @ followed.T
        return part

    def _slots(self, keys: list[int]) -> Ints:
        return np.concatenate([3 * self.keys.index(key) + np.arange(3) for key in keys])


@dataclass(frozen=True)
class Covariances:
    """One for testing references, and one for the standard deviations that are told."""

    tested: Covariance
    told: Covariance


def covariance(
    graph: gtsam.NonlinearFactorGraph,
    values: gtsam.Values,
    frames: list[int],
    centres: list[int],
    shared: Shared | None = None,
) -> Covariance:
    """From a graph at its optimum. `frames` are Pose3 keys, `centres` Point3 keys of their places.

    Raises SolveError if the graph leaves a variable undetermined.
    """
    information, gradient, slots = _information(graph, values, set(frames), shared)
    inner = np.concatenate([slots[key] for key in sorted((*frames, *centres))])
    outer_keys = sorted(set(slots) - set(frames) - set(centres))
    count = 3 * len(outer_keys)
    own = [slots[key] for key in outer_keys]
    outer = np.concatenate([*own, np.arange(len(inner) + count, information.shape[0])])
    near = splu(information[inner][:, inner].tocsc(), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
    cross = information[inner][:, outer].tocsc()
    position = np.empty(information.shape[0], np.int64)
    position[inner] = np.arange(len(inner))
    wanted = position[np.concatenate([slots[key] for key in centres])]
    solved, schur = np.empty((len(wanted), len(outer))), information[outer][:, outer].toarray()
    for first in range(0, len(outer), CHUNK):
        part = slice(first, min(first + CHUNK, len(outer)))
        columns = near.solve(cross[:, part].toarray())
        schur[:, part] -= cross.T @ columns
        solved[:, part] = columns[wanted]
    right = gradient[outer] - cross.T @ near.solve(gradient[inner])
    joint, step, followed = _joint((schur + schur.T) / 2, right, shared)
    alone = np.concatenate(
        [_diagonal(near, wanted[first : first + CHUNK], len(inner)) for first in range(0, len(wanted), CHUNK)]
    )
    places = alone + np.einsum("ij,ij->i", solved @ joint, solved)
    points, biases = joint[:count, :count], joint[count:, count:]
    return Covariance(tuple(outer_keys), points, places.reshape(-1, 3), biases, step[count:], followed[:count])


def _information(
    graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, poses: set[int], shared: Shared | None
) -> tuple[csc_matrix, Floats, dict[int, Ints]]:
    """Information matrix and right side, and the rows of each key in them: keys are laid out in order, shared ones last."""
    entries = graph.linearize(values).sparseJacobian_()
    rows, cols = entries[:2].astype(np.int64) - 1
    slots: dict[int, Ints] = {}
    size = 0
    for key in sorted(values.keys()):
        width = 6 if key in poses else 3
        slots[key] = np.arange(size, size + width)
        size += width
    kept = cols < size
    height = int(rows.max()) + 1
    jacobian = coo_matrix((entries[2][kept], (rows[kept], cols[kept])), shape=(height, size)).tocsc()
    right = np.bincount(rows[~kept], entries[2][~kept], minlength=height)
    if shared is None or not len(shared.prior):
        return (jacobian.T @ jacobian).tocsc(), jacobian.T @ right, slots
    above = csc_array((height - shared.columns.shape[0], len(shared.prior)))
    prior = np.diag(1 / shared.prior)
    seen = hstack([jacobian, vstack([above, shared.columns])])
    whole = vstack([seen, hstack([csc_array((len(prior), size)), csc_array(prior)])])
    right = np.concatenate([right, -prior @ shared.value])
    return csc_matrix(whole.T @ whole), np.asarray(whole.T @ right), slots


def _joint(information: Floats, right: Floats, shared: Shared | None) -> tuple[Floats, Floats, Floats]:
    """Covariance (n, n) of all unknowns, shared ones last, the step (n,) to their optimum, and how far (n, c) they follow
    each shared one that is not free, a standard deviation off.

    Shared ones that are not free keep their prior, and the others' estimates follow them.
    """
    fixed = np.zeros(len(information), np.bool_)
    if shared is not None and len(shared.free):
        fixed[-len(shared.free) :] = ~shared.free
    free = ~fixed
    joint, step = np.zeros_like(information), np.zeros(len(information))
    own = _inverse(information[np.ix_(free, free)])
    joint[np.ix_(free, free)] = own
    step[free] = own @ right[free]
    followed = np.zeros((len(information), int(fixed.sum())))
    if shared is not None and fixed.any():
        prior = np.diag(shared.prior[~shared.free])
        followed[free], followed[fixed] = -own @ information[np.ix_(free, fixed)] @ prior, prior
        joint += followed @ followed.T
    return joint, step, followed


def _inverse(matrix: Floats) -> Floats:
    """Inverse of a positive definite matrix, scaled so that tight and loose variables do not drown one another."""
    diagonal = np.diag(matrix)
    if not np.isfinite(matrix).all() or diagonal.min() <= 0:
        raise SolveError("the solution leaves some points undetermined: too few observations for what is asked")
    scale = 1.0 / np.sqrt(diagonal)
    try:
        inverse = cho_solve(cho_factor(matrix * scale[:, None] * scale), np.eye(len(matrix)))
    except LinAlgError as error:
        raise SolveError(
            "the solution leaves some points undetermined: too few observations for what is asked"
        ) from error
    result: Floats = inverse * scale[:, None] * scale
    return result


def _diagonal(near: object, wanted: Ints, size: int) -> Floats:
    unit = np.zeros((size, len(wanted)))
    unit[wanted, np.arange(len(wanted))] = 1.0
    solved: Floats = near.solve(unit)  # type: ignore[attr-defined]
    return solved[wanted, np.arange(len(wanted))]
