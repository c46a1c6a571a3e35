"""The normal equations of a graph, H x = g, without the frames: what joint covariances and the steps of biases need.

Frames are bound to the points that they show and to their neighbours: in an order in which neighbours stay together
(reverse Cuthill and McKee) their information is a narrow band. What is left, points, references and other unknowns, is
one dense matrix (Schur complement), whose inverse is the joint covariance; GTSAM gives that key by key.
"""

from dataclasses import dataclass
from functools import cached_property

import gtsam
import numpy as np
from scipy.linalg import LinAlgError, cho_solve, cholesky, cholesky_banded, solve_triangular
from scipy.linalg.lapack import dtbtrs
from scipy.sparse import coo_array, csc_array, csr_array, diags_array, hstack, vstack
from scipy.sparse.csgraph import reverse_cuthill_mckee

from savmap.errors import SolveError
from savmap.graph.keys import FRAME, width_of
from savmap.types import Bools, Floats, Ints

UNDETERMINED = "the solution leaves some points undetermined: too few measurements for what is asked"


@dataclass(frozen=True, eq=False)
class SharedUnknowns:
    """Unknowns beside the graph's variables that the last rows (r,) of its equations, the pixels', share, such as
    biases: whitened derivatives (r, k), their value (k,) now, and the standard deviations (k,) of their prior about 0.
    Those that are not `free` (k,) are not estimated: their uncertainty spreads to the others (Schmidt's consider
    parameters)."""

    columns: csc_array
    value: Floats
    prior: Floats
    free: Bools

    def estimated(self) -> "SharedUnknowns":
        """Those that are free alone."""
        free = self.free
        return SharedUnknowns(self.columns[:, np.flatnonzero(free)], self.value[free], self.prior[free], free[free])


@dataclass(frozen=True, eq=False)
class Layout:
    """Where the variables of a graph stand among the unknowns: sorted `keys` (v,), their `first` (v,) and their numbers
    (v,) of unknowns."""

    keys: Ints
    first: Ints
    widths: Ints

    @staticmethod
    def of(values: gtsam.Values) -> "Layout":
        """All of the values' variables, as GTSAM's Jacobians have them."""
        keys = np.array(sorted(values.keys()), np.int64)
        widths = np.array([width_of(key) for key in keys.tolist()], np.int64)
        return Layout(keys, np.cumsum(widths) - widths, widths)

    @property
    def size(self) -> int:
        """The number of unknowns."""
        return int(self.widths.sum())

    def slots(self, keys: Ints | list[int]) -> Ints:
        """Where (k,) variables begin."""
        slots: Ints = self.first[np.searchsorted(self.keys, keys)]
        return slots

    @property
    def points(self) -> list[int]:
        """The keys of all variables but poses."""
        return [int(key) for key in self.keys[self.widths == 3]]

    @cached_property
    def frames(self) -> list[int]:
        """The keys of the frames' poses."""
        return [int(key) for key in self.keys[self.keys >> 56 == ord(FRAME)]]

    def vectors(self, step: Floats) -> gtsam.VectorValues:
        """A step (size,) variable by variable."""
        vectors = gtsam.VectorValues()
        for key, first, width in zip(self.keys.tolist(), self.first.tolist(), self.widths.tolist(), strict=True):
            vectors.insert(key, step[first : first + width])
        return vectors

    def moved(self, values: gtsam.Values, step: gtsam.VectorValues) -> gtsam.Values:
        """The values after a step; the frames' positions by a straight one."""
        moved = values.retract(step)
        for key in self.frames:
            pose, turned = values.atPose3(key), moved.atPose3(key).rotation()
            moved.update(key, gtsam.Pose3(turned, pose.transformFrom(step.at(key)[3:])))
        return moved

    def damping(self, information: float) -> gtsam.GaussianFactorGraph:
        """So much information about each unknown: that it is 0."""
        graph = gtsam.GaussianFactorGraph()
        factors = {
            width: (np.sqrt(information) * np.eye(width), np.zeros(width), gtsam.noiseModel.Unit.Create(width))
            for width in set(self.widths.tolist())
        }
        for key, width in zip(self.keys.tolist(), self.widths.tolist(), strict=True):
            graph.add(key, *factors[width])
        return graph


@dataclass(frozen=True, eq=False)
class Reduced:
    """Normal equations without the frames. The frames' unknowns `poses` (p,) are eliminated: the Cholesky factor L of
    their information, as a `band` (b, p), L^-1 `cross` (p, k), that with what is left, and L^-1 `half` (p,), their
    right side. `information` (k, k) and `right` (k,) are of the unknowns that are `left` (k,): the graph's other
    variables in the layout's order, then the shared ones."""

    poses: Ints
    left: Ints
    band: Floats
    cross: Floats
    half: Floats
    information: Floats
    right: Floats

    @staticmethod
    def of(
        graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, layout: Layout, shared: SharedUnknowns | None = None
    ) -> "Reduced":
        """Of a graph at some values, with shared unknowns or without. Raises SolveError where a frame is
        undetermined."""
        entries = graph.linearize(values).sparseJacobian_()
        at, slots = entries[:2].astype(np.int64) - 1
        size, height, kept = layout.size, int(at.max()) + 1, slots < layout.size
        rows = csr_array(coo_array((entries[2][kept], (at[kept], slots[kept])), shape=(height, size)))
        off, precision = np.bincount(at[~kept], entries[2][~kept], minlength=height), np.zeros(0)
        if shared is not None and len(shared.prior):
            others = csr_array((height - shared.columns.shape[0], len(shared.prior)))
            rows, precision = csr_array(hstack([rows, vstack([others, shared.columns])])), shared.prior**-2.0
        right = rows.T @ off
        if shared is not None:
            right[size:] -= shared.value * precision
        return _eliminated(csr_array(rows.T @ rows + diags_array(np.append(np.zeros(size), precision))), right, layout)

    def solve(self) -> Floats:
        """All unknowns (n,). Raises SolveError where one is undetermined."""
        whole = np.empty(len(self.poses) + len(self.left))
        whole[self.left] = cho_solve((self._factor, True), self.right)
        whole[self.poses] = _solved(self.band, self.half - self.cross @ whole[self.left], "T")
        return whole

    def last(self, count: int) -> Floats:
        """The covariance (count, count) of the last unknowns. Raises SolveError where one is undetermined."""
        first = len(self._factor) - count
        inverse = solve_triangular(self._factor[first:, first:], np.eye(count), lower=True)
        covariance: Floats = inverse.T @ inverse
        return covariance

    @cached_property
    def _factor(self) -> Floats:
        try:
            return np.asarray(cholesky(self.information, lower=True))
        except (LinAlgError, ValueError) as error:
            raise SolveError(UNDETERMINED) from error

    def place_variances(self, values: gtsam.Values, layout: Layout, joint: Floats) -> Floats:
        """The variances (f, 3) of the frames' positions in the world, m^2, by the covariance (k, k) of what is left."""
        row = np.empty(len(self.poses) + len(self.left), np.int64)
        row[self.poses] = np.arange(len(self.poses))
        axes = np.zeros((len(self.poses), len(layout.frames), 3))
        for number, (key, first) in enumerate(zip(layout.frames, layout.slots(layout.frames).tolist(), strict=True)):
            axes[row[first + 3 : first + 6], number] = values.atPose3(key).rotation().matrix().T
        half = _solved(self.band, axes.reshape(len(axes), -1))
        follows = half.T @ self.cross
        return np.asarray(np.square(half).sum(axis=0) + (follows @ joint * follows).sum(axis=1)).reshape(-1, 3)


def _eliminated(information: csr_array, right: Floats, layout: Layout) -> Reduced:
    poses = (layout.slots(layout.frames)[:, None] + np.arange(6)).ravel()
    left = np.setdiff1d(np.arange(len(right)), poses)
    poses = poses[reverse_cuthill_mckee(information[poses][:, poses], symmetric_mode=True)]
    inside = information[poses][:, poses].tocoo()
    lower = inside.row >= inside.col
    away = (inside.row - inside.col)[lower]
    band = np.zeros((int(away.max(initial=0)) + 1, len(poses)))
    band[away, inside.col[lower]] = inside.data[lower]
    try:
        band = cholesky_banded(band, lower=True)
    except (LinAlgError, ValueError) as error:
        raise SolveError(UNDETERMINED) from error
    cross, half = _solved(band, information[poses][:, left].toarray()), _solved(band, right[poses])
    rest = information[left][:, left].toarray() - cross.T @ cross
    return Reduced(poses, left, band, cross, half, rest, right[left] - cross.T @ half)


def _solved(band: Floats, right: Floats, transposed: str = "N") -> Floats:
    """L^-1, or L^-T where it is "T", times (p,) or (p, k), for a triangular matrix as a band (b, p)."""
    solved, _ = dtbtrs(band, right.reshape(len(right), -1), uplo="L", trans=transposed)
    return np.asarray(solved.reshape(right.shape))
