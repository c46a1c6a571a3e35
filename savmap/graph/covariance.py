"""Covariances of all points and camera positions at once.

`gtsam.Marginals` asks for one variable at a time. Without the frames, the points' information is small and inverted
whole: joint covariances come with it.
"""

from collections.abc import Collection
from dataclasses import dataclass

import gtsam
import numpy as np
from scipy.linalg import LinAlgError, cho_solve, cholesky
from scipy.linalg.lapack import dpotri

from savmap.errors import SolveError
from savmap.graph.normal_equations import UNDETERMINED, Layout, Reduced, SharedUnknowns
from savmap.types import Floats, Ints


@dataclass(frozen=True, eq=False)
class Covariance:
    """Joint covariance `points` (3m, 3m) of the Point3 variables `keys` (m,), and variances `cameras` (f, 3) of the
    frames' positions.

    `shared` (k, k): covariance of the shared unknowns; `step` (k,): the step that brings these to their optimum.
    `followed` (3m, c): how far the points move with each shared unknown that is not estimated, for one standard
    deviation; `points` contains it. `hidden` (k, 3m): how far they move with each error of references that would stay
    hidden, m; `points` does not contain it.
    """

    keys: tuple[int, ...]
    points: Floats
    cameras: Floats
    shared: Floats
    step: Floats
    followed: Floats
    hidden: Floats

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

    def estimated_with(self, keys: list[int]) -> Floats:
        """The covariance (3m, 3n) of all variables with some, but for what comes from shared unknowns which are not
        estimated: how the estimate follows these."""
        slots = self._slots(keys)
        part: Floats = self.points[:, slots] - self.followed @ self.followed[slots].T
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
    shared: SharedUnknowns | None = None,
    only: Collection[int] | None = None,
) -> Covariance:
    """From a graph at its optimum. With `only` it is of these variables and the shared unknowns, without the frames'
    positions.

    Raises SolveError if the graph leaves a variable undetermined.
    """
    layout = Layout.of(values)
    reduced = Reduced.of(graph, values, layout, shared)
    keys = [key for key in layout.points if only is None or key in only]
    points = np.searchsorted(reduced.left, layout.slots(keys)[:, None] + np.arange(3)).ravel()
    biases = np.flatnonzero(reduced.left >= layout.size)
    chosen = np.append(points, biases)
    joint, step, followed = _joint(
        reduced.information, reduced.right, shared, np.arange(len(reduced.left)) if only is None else chosen
    )
    cameras = np.zeros((0, 3))
    if only is None:
        cameras = reduced.place_variances(values, layout, joint)
        joint, followed = joint[np.ix_(chosen, chosen)], followed[chosen]
    size = len(points)
    of_points, of_shared = joint[:size, :size], joint[size:, size:]
    nothing = np.zeros((0, size))
    return Covariance(tuple(keys), of_points, cameras, of_shared, step[biases], followed[:size], nothing)


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
        if not np.isfinite(matrix).all() or diagonal.min() <= 0:
            raise SolveError(UNDETERMINED)
        scale = 1.0 / np.sqrt(diagonal)
        try:
            return cls(cholesky(matrix * scale[:, None] * scale, lower=True, check_finite=False), scale)
        except LinAlgError as error:
            raise SolveError(UNDETERMINED) from error

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
