"""Covariances of all points and camera positions at once.

`gtsam.Marginals` asks for one variable at a time. Frames share factors only with their neighbours, so they are
eliminated sparsely, and the rest, the points' information, is small and inverted whole: joint covariances come with it.
"""

from collections.abc import Collection
from dataclasses import dataclass

import gtsam
import numpy as np
from scipy.linalg import LinAlgError, cho_solve, cholesky
from scipy.linalg.lapack import dpotri
from scipy.sparse import coo_matrix, csc_array, csc_matrix, hstack, vstack
from scipy.sparse.linalg import SuperLU, splu

from savmap.errors import SolveError
from savmap.types import Bools, Floats, Ints

CHUNK = 256
BLOCK = 144


@dataclass(frozen=True, eq=False)
class SharedUnknowns:
    """Unknowns beside the graph's variables that its last rows (r,) share, such as biases: whitened derivatives (r, k),
    their value (k,) now, and the standard deviations (k,) of their prior about 0. Those that are not `free` (k,) are
    not estimated: their uncertainty spreads to the others (Schmidt's consider parameters)."""

    columns: csc_array
    value: Floats
    prior: Floats
    free: Bools


@dataclass(frozen=True, eq=False)
class Covariance:
    """Joint covariance `points` (3m, 3m) of the Point3 variables `keys` (m,), and variances `cameras` (f, 3) of the
    frames' positions.

    `shared` (k, k): covariance of the shared unknowns; `step` (k,): the step that brings these to their optimum.
    `followed` (3m, c): how far the points move with each shared unknown that is not estimated, for one standard
    deviation; `points` contains it.
    """

    keys: tuple[int, ...]
    points: Floats
    cameras: Floats
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


@dataclass(frozen=True, eq=False)
class Covariances:
    """One for the tests of references, and one for the standard deviations that are reported."""

    tested: Covariance
    reported: Covariance


def covariance(
    graph: gtsam.NonlinearFactorGraph,
    values: gtsam.Values,
    frames: list[int],
    centres: list[int],
    shared: SharedUnknowns | None = None,
    only: Collection[int] | None = None,
) -> Covariance:
    """From a graph at its optimum. `frames` are Pose3 keys, `centres` Point3 keys of their positions. With `only` it is
    of these variables and the shared unknowns, without the frames' positions.

    Raises SolveError if the graph leaves a variable undetermined.
    """
    information, gradient, slots = _information(graph, values, set(frames), shared)
    inner = np.concatenate([slots[key] for key in sorted((*frames, *centres))])
    outer_keys = sorted(set(slots) - set(frames) - set(centres))
    count = 3 * len(outer_keys)
    outer = np.concatenate([*(slots[key] for key in outer_keys), np.arange(len(inner) + count, information.shape[0])])
    near = splu(information[inner][:, inner].tocsc(), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
    cross = information[inner][:, outer].tocsc()
    wanted = [slots[key] for key in (centres if only is None else ())]
    cameras = np.searchsorted(inner, np.concatenate([np.zeros(0, np.int64), *wanted]))
    schur, solved = _eliminated(near, cross, information[outer][:, outer].toarray(), cameras)
    right = gradient[outer] - cross.T @ near.solve(gradient[inner])
    kept = [index for index, key in enumerate(outer_keys) if only is None or key in only]
    points = (3 * np.array(kept, np.int64)[:, None] + np.arange(3)).ravel()
    joint, step, followed = _joint(schur, right, shared, np.append(points, np.arange(count, len(outer))))
    spread = np.zeros(0)
    if only is None:
        spread = _diagonal(near, cameras, len(inner)) + np.einsum("ij,ij->i", solved @ joint, solved)
    size = len(points)
    return Covariance(
        tuple(outer_keys[index] for index in kept),
        joint[:size, :size],
        spread.reshape(-1, 3),
        joint[size:, size:],
        step[count:],
        followed[:size],
    )


def _eliminated(near: SuperLU, cross: csc_matrix, outer: Floats, wanted: Ints) -> tuple[Floats, Floats]:
    """What is left of the `outer` information (k, k) without the frames', `near` (n, n), and the `wanted` rows of
    near^-1 cross.

    A frame shows few of the points, neighbours the same ones: frames are taken some at a time, with dense blocks.
    """
    rows = cross.tocsr()
    blocks: list[tuple[slice, Ints, Floats]] = []
    for first in range(0, cross.shape[0], BLOCK):
        block = slice(first, min(first + BLOCK, cross.shape[0]))
        columns = np.unique(rows[block].indices).astype(np.int64)
        blocks.append((block, columns, np.asarray(rows[block][:, columns].toarray().T, np.float64)))
    solved = np.empty((len(wanted), len(outer)))
    for first in range(0, len(outer), CHUNK):
        part = slice(first, min(first + CHUNK, len(outer)))
        solution = near.solve(cross[:, part].toarray())
        for rows_of_block, columns, entries in blocks:
            outer[columns, part] -= entries @ solution[rows_of_block]
        solved[:, part] = solution[wanted]
    return (outer + outer.T) / 2, solved


def _information(
    graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, poses: set[int], shared: SharedUnknowns | None
) -> tuple[csc_matrix, Floats, dict[int, Ints]]:
    """Information matrix, right side, and the rows of each key in them, in the keys' order; shared unknowns last."""
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


def _joint(
    information: Floats, right: Floats, shared: SharedUnknowns | None, wanted: Ints
) -> tuple[Floats, Floats, Floats]:
    """Covariance (w, w) of the `wanted` (w,) among the unknowns (n,), shared ones being last, the step (n,) to the
    optimum of all, and how far (w, c) the wanted follow each shared one that is not free, a standard deviation off.

    Those that are not free keep their prior, and the others' estimates follow them.
    """
    fixed = np.zeros(len(information), np.bool_)
    if shared is not None and len(shared.free):
        fixed[-len(shared.free) :] = ~shared.free
    free = np.flatnonzero(~fixed)
    slot = np.full(len(information), -1)
    slot[free] = np.arange(len(free))
    estimated = np.flatnonzero(~fixed[wanted])
    inverse = Inverse.of(information[np.ix_(free, free)])
    columns = inverse.columns(slot[wanted[estimated]])
    joint, step = np.zeros((len(wanted), len(wanted))), np.zeros(len(information))
    joint[np.ix_(estimated, estimated)] = columns[slot[wanted[estimated]]]
    step[free] = inverse.times(right[free])
    followed = np.zeros((len(wanted), int(fixed.sum())))
    if shared is not None and fixed.any():
        prior = np.diag(shared.prior[~shared.free])
        followed[estimated] = -columns.T @ information[np.ix_(free, np.flatnonzero(fixed))] @ prior
        followed[fixed[wanted]] = prior
        joint += followed @ followed.T
    return joint, step, followed


@dataclass(frozen=True, eq=False)
class Inverse:
    """Inverse of a positive definite matrix (n, n), by the Cholesky `factor` of the matrix scaled (n,) so that tight
    and loose variables do not drown one another."""

    factor: Floats
    scale: Floats

    @classmethod
    def of(cls, matrix: Floats) -> "Inverse":
        """Raises SolveError for a matrix that is not positive definite."""
        diagonal = np.diag(matrix)
        undetermined = "the solution leaves some points undetermined: too few measurements for what is asked"
        if not np.isfinite(matrix).all() or diagonal.min() <= 0:
            raise SolveError(undetermined)
        scale = 1.0 / np.sqrt(diagonal)
        try:
            return cls(cholesky(matrix * scale[:, None] * scale, lower=True, check_finite=False), scale)
        except LinAlgError as error:
            raise SolveError(undetermined) from error

    def columns(self, wanted: Ints) -> Floats:
        """Columns (n, w) of the inverse."""
        if len(wanted) < len(self.scale) // 3:
            return self.times(np.eye(len(self.scale))[:, wanted])
        half, _ = dpotri(self.factor, lower=1)
        whole = np.tril(half) + np.tril(half, -1).T
        inverse: Floats = (whole * self.scale[:, None] * self.scale)[:, wanted]
        return inverse

    def times(self, right: Floats) -> Floats:
        """The inverse times (n,) or (n, w)."""
        scale = self.scale if right.ndim == 1 else self.scale[:, None]
        product: Floats = scale * cho_solve((self.factor, True), scale * right, check_finite=False)
        return product


def _diagonal(near: SuperLU, wanted: Ints, size: int) -> Floats:
    """The diagonal (w,) of near^-1 (n, n) at the `wanted` rows."""
    diagonal = np.empty(len(wanted))
    for first in range(0, len(wanted), CHUNK):
        part = wanted[first : first + CHUNK]
        unit = np.zeros((size, len(part)))
        unit[part, np.arange(len(part))] = 1.0
        diagonal[first : first + CHUNK] = near.solve(unit)[part, np.arange(len(part))]
    return diagonal
