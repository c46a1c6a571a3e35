"""The normal equations of a graph, H x = g, without the frames.

A frame is bound to the points that it shows and to its neighbours. Frames in an order in which neighbours stay together
(reverse Cuthill and McKee) are cut into blocks; what of a block is bound to the next one is kept among the points, so
that blocks are bound to one another no more. Each is eliminated by itself, with dense matrices of what it shows. What
is left, points, references and other unknowns, is one dense matrix (Schur complement).
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import gtsam
import numpy as np
from scipy.linalg import LinAlgError, cho_solve, cholesky, solve_triangular
from scipy.sparse import coo_array, csc_array, csr_array, diags_array, hstack
from scipy.sparse.csgraph import reverse_cuthill_mckee
from scipy.sparse.linalg import LinearOperator, cg

from savmap.errors import SolveError
from savmap.graph.factors.projections import Graph
from savmap.graph.keys import CENTRE, FRAME, width_of
from savmap.types import Bools, Floats, Ints

BLOCK, MANY = 16, 8
"""Frames of a block: fewer leave more unknowns over, more cost more each. And of how many blocks an unknown must be
seen to be taken as bound to all."""
PRECISE, MOST_TURNS = 1e-4, 12
"""Of conjugate gradients: the residual that is left, and after how many turns a new elimination costs less."""
SHARED = -2
UNDETERMINED = "the solution leaves some points undetermined: too few measurements for what is asked"


@dataclass(frozen=True, eq=False)
class SharedUnknowns:
    """Unknowns beside the graph's variables that the pixels' rows (r,) share, such as biases: whitened derivatives (r,
    k), their value (k,) now, and the standard deviations (k,) of their prior about 0. Those that are not `free` (k,)
    are not estimated: their uncertainty spreads to the others (Schmidt's consider parameters)."""

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
        """The keys of all variables but poses and frames' positions."""
        return [int(key) for key in self.keys[(self.widths == 3) & (self.keys >> 56 != ord(CENTRE))]]

    def of_kind(self, kind: str) -> Ints:
        """The keys (k,) whose letter is `kind`."""
        of_kind: Ints = self.keys[self.keys >> 56 == ord(kind)]
        return of_kind

    @cached_property
    def frames(self) -> Ints:
        """The frame of each unknown (size,), a number for both its pose and its position; -1: of none."""
        of_frame = np.isin(self.keys >> 56, (ord(FRAME), ord(CENTRE)))
        numbers = np.full(len(self.keys), -1)
        numbers[of_frame] = np.unique(self.keys[of_frame] & ((1 << 56) - 1), return_inverse=True)[1]
        return np.repeat(numbers, self.widths)

    def moved(self, values: gtsam.Values, step: Floats) -> gtsam.Values:
        """The values after a step (size,); frames' positions by a step in the world, as `in_world` has it."""
        vectors = gtsam.VectorValues()
        for key, first, width in zip(self.keys.tolist(), self.first.tolist(), self.widths.tolist(), strict=True):
            vectors.insert(key, step[first : first + width])
        moved, frames = values.retract(vectors), self.of_kind(FRAME)
        for key, first in zip(frames.tolist(), self.slots(frames).tolist(), strict=True):
            place = values.atPose3(key).translation() + step[first + 3 : first + 6]
            moved.update(key, gtsam.Pose3(moved.atPose3(key).rotation(), place))
        return moved

    def in_world(self, values: gtsam.Values, columns: int) -> csr_array:
        """What turns derivatives (..., columns) as GTSAM has them, by steps of frames in their own axes, into those by
        steps in the world's. So the step of a frame and that of the point at its place are one, whichever way it is
        turned."""
        frames = self.of_kind(FRAME)
        turns = np.array([values.atPose3(key).rotation().matrix().T for key in frames.tolist()]).reshape(-1, 3, 3)
        places = self.slots(frames)[:, None] + np.arange(3, 6)
        rows, cols = (np.broadcast_to(part, turns.shape) for part in (places[:, :, None], places[:, None]))
        same = np.setdiff1d(np.arange(columns), places)
        entries = np.append(turns, np.ones(len(same))), (np.append(rows, same), np.append(cols, same))
        return csr_array(coo_array(entries, shape=(columns, columns)))


@dataclass(frozen=True, eq=False)
class Equations:
    """A graph at some values, linear about these: the rows of GTSAM's factors (r, n) and of the pixels (p, n), and the
    right side (n,) of the normal equations. Unknowns are the variables in the layout's order, then those `shared` (k,),
    whose precision (k,) is known beforehand."""

    layout: Layout
    others: csr_array
    pixels: csr_array
    right: Floats
    precision: Floats

    @staticmethod
    def of(graph: Graph, values: gtsam.Values, layout: Layout, shared: SharedUnknowns | None = None) -> "Equations":
        """Of a graph at some values."""
        size, columns = layout.size, 0 if shared is None else len(shared.prior)
        entries = graph.factors.linearize(values).sparseJacobian_()
        at, slot = entries[:2].astype(np.int64) - 1
        kept, height = slot < size, int(at.max(initial=-1)) + 1
        others = csr_array(coo_array((entries[2][kept], (at[kept], slot[kept])), shape=(height, size + columns)))
        others = others @ layout.in_world(values, size + columns)
        slopes, off = graph.pixels.linearized(values)
        frames, points = (layout.slots(keys)[:, None] for keys in (graph.pixels.frames, graph.pixels.points))
        places = np.concatenate([frames + np.arange(6), points + np.arange(3)], axis=1)
        ends = np.arange(0, 2 * places.size + 1, 9)
        pixels = csr_array((slopes.ravel(), np.repeat(places, 2, axis=0).ravel(), ends), shape=(2 * len(off), size))
        right = others.T @ np.bincount(at[~kept], entries[2][~kept], minlength=height)
        if shared is not None and columns:
            pixels = csr_array(hstack([pixels, shared.columns]))
            right[size:] -= shared.value / shared.prior**2
        precision = np.zeros(0) if shared is None else shared.prior**-2.0
        return Equations(layout, others, pixels, right + pixels.T @ off.ravel(), precision)

    def times(self, step: Floats, damping: float = 0.0) -> Floats:
        """The information matrix, with so much added to the variables' information, times (n,)."""
        added = np.concatenate([np.full(self.layout.size, damping), self.precision]) * step
        return np.asarray(self.others.T @ (self.others @ step) + self.pixels.T @ (self.pixels @ step) + added)

    def step(self, near: "Reduced", damping: float) -> Floats | None:
        """The solution (n,) by conjugate gradients, with the elimination of a system `near` this one, which costs a
        tenth of one; None where they do not converge soon."""
        shape = (len(self.right),) * 2
        matrix = LinearOperator(shape, lambda step: self.times(step, damping), dtype=np.float64)
        inverse = LinearOperator(shape, near.solve, dtype=np.float64)
        step, failed = cg(matrix, self.right, rtol=PRECISE, maxiter=MOST_TURNS, M=inverse)
        return None if failed else np.asarray(step)

    def reduced(self, damping: float = 0.0) -> "Reduced":
        """Without the frames, with so much added to the variables' information. Raises SolveError where a frame is
        undetermined."""
        diagonal = np.concatenate([np.full(self.layout.size, damping), self.precision])
        information = csr_array(self.others.T @ self.others + self.pixels.T @ self.pixels + diags_array(diagonal))
        order, ends, hubs = _order(np.append(self.layout.frames, np.full(len(self.precision), SHARED)), information)
        matrix, within = information[order][:, order], int(ends[-1])
        left = matrix[within:, within:].toarray()
        parts = tuple(
            _eliminated(matrix[begin:end], slice(begin, end), within, hubs) for begin, end in pairwise(ends.tolist())
        )
        for part in parts:
            near, far = np.hsplit(part.cross, [part.width])
            left[part.near, part.near] -= near.T @ near
            left[hubs:, part.near] -= far.T @ near
            left[hubs:, hubs:] -= far.T @ far
        left[:hubs, hubs:] = left[hubs:, :hubs].T
        return Reduced(order, parts, left, hubs)


def _order(frames: Ints, information: csr_array) -> tuple[Ints, Ints, int]:
    """The order (n,) of elimination of the unknowns, by their frames (n,), -1 for none or `SHARED`; where in it each
    block of frames begins, and where the last ends (b + 1,); and where among what is left those begin that many blocks
    see.

    What is left comes in the order of the blocks that see it first, shared unknowns last.
    """
    count, entries = int(frames.max(initial=-1)) + 1, information.tocoo()
    a, b = frames[entries.row], frames[entries.col]
    between = (a >= 0) & (b >= 0)
    rank = np.zeros(count + 1, np.int64)
    if count:
        bound = csr_array(coo_array((np.ones(int(between.sum())), (a[between], b[between])), shape=(count, count)))
        rank[reverse_cuthill_mckee(bound, symmetric_mode=True)] = np.arange(count)
    blocks = np.where(frames >= 0, rank[frames] // BLOCK, -1)
    later = between & (blocks[entries.row] < blocks[entries.col])
    last = (count - 1) // BLOCK + 1
    blocks[np.unique(entries.row[later])] = -1
    seeing = blocks[entries.row]
    seen = (seeing >= 0) & (blocks[entries.col] < 0)
    pairs = np.unique(entries.col[seen] * (last + 1) + seeing[seen])
    place, of_block = np.divmod(pairs, last + 1)
    first = np.full(len(frames), last)
    np.minimum.at(first, place, of_block)
    hub = (np.bincount(place, minlength=len(frames)) > MANY) | (first == last)
    group = np.where(blocks >= 0, blocks, last + np.where(hub, last + 1, first))
    group[frames == SHARED] = 2 * last + 2
    order = np.argsort(group, kind="stable")
    ends = np.searchsorted(group[order], np.arange(last + 1))
    return order, np.unique(ends), int(np.searchsorted(group[order], 2 * last + 1) - ends[-1])


@dataclass(frozen=True, eq=False)
class Part:
    """An eliminated block: its place in the order of `Reduced`, the Cholesky factor L of its own information (b, b),
    and L^-1 `cross` (b, c), its information with what is left: with the unknowns `near` it, and with the hubs."""

    place: slice
    factor: Floats
    cross: Floats
    near: slice
    hubs: int

    @property
    def width(self) -> int:
        """The number of unknowns near it."""
        return int(self.near.stop - self.near.start)

    def bound(self, left: Floats) -> Floats:
        """Of what is left (k, ...), what the block is bound to (c, ...)."""
        return np.concatenate([left[self.near], left[self.hubs :]])


def _eliminated(rows: csr_array, place: slice, within: int, hubs: int) -> Part:
    size = place.stop - place.start
    inside, columns = rows.indices < within, rows.indices - within
    close = columns[~inside & (columns < hubs)]
    near = slice(int(close.min()), int(close.max()) + 1) if len(close) else slice(0, 0)
    wide = size + near.stop - near.start
    at = np.where(
        inside, rows.indices - place.start, np.where(columns < hubs, size + columns - near.start, wide + columns - hubs)
    )
    dense = np.zeros((size, wide + rows.shape[1] - within - hubs))
    dense[np.repeat(np.arange(size), np.diff(rows.indptr)), at] = rows.data
    factor = _cholesky(dense[:, :size])
    return Part(place, factor, solve_triangular(factor, dense[:, size:], lower=True, check_finite=False), near, hubs)


def _cholesky(matrix: Floats) -> Floats:
    """Raises SolveError for a matrix that is not positive definite."""
    if not np.isfinite(matrix).all():
        raise SolveError(UNDETERMINED)
    try:
        return np.asarray(cholesky(matrix, lower=True, check_finite=False))
    except LinAlgError as error:
        raise SolveError(UNDETERMINED) from error


@dataclass(frozen=True, eq=False)
class Reduced:
    """What is left of n unknowns without the frames: the information (k, k) of the last k in `order` (n,), of which
    those from `hubs` on are bound to many parts, and the eliminated `parts`, which are those before."""

    order: Ints
    parts: tuple[Part, ...]
    information: Floats
    hubs: int

    @property
    def left(self) -> Ints:
        """The unknowns (k,) that are left."""
        return self.order[len(self.order) - len(self.information) :]

    @cached_property
    def _factor(self) -> Floats:
        return _cholesky(self.information)

    def right(self, right: Floats) -> tuple[Floats, list[Floats]]:
        """The right side of what is left, for one of all unknowns (n,) or of all but some shared ones; and the
        parts'."""
        held, solved = len(self.order) - len(right), list[Floats]()
        left = right[self.left[: len(self.left) - held]]
        for part in self.parts:
            half = solve_triangular(part.factor, right[self.order[part.place]], lower=True, check_finite=False)
            left[part.near] -= part.cross[:, : part.width].T @ half
            left[self.hubs :] -= part.cross[:, part.width : part.cross.shape[1] - held].T @ half
            solved.append(half)
        return left, solved

    def solve(self, right: Floats) -> Floats:
        """The unknowns (n,) for a right side (n,); where that is shorter, the last shared ones are held. Raises
        SolveError where one is undetermined."""
        left, parts = self.right(right)
        count = len(left)
        step = cho_solve((self._factor[:count, :count], True), left, check_finite=False)
        whole = np.empty(len(right))
        whole[self.left[:count]] = step
        for part, solved in zip(self.parts, parts, strict=True):
            bound = part.bound(step)
            half = solved - part.cross[:, : len(bound)] @ bound
            whole[self.order[part.place]] = solve_triangular(part.factor, half, lower=True, trans=1, check_finite=False)
        return whole

    def last(self, count: int) -> Floats:
        """The covariance (count, count) of the last unknowns. Raises SolveError where one is undetermined."""
        first = len(self._factor) - count
        inverse = solve_triangular(self._factor[first:, first:], np.eye(count), lower=True, check_finite=False)
        covariance: Floats = inverse.T @ inverse
        return covariance

    def variances(self, joint: Floats) -> Floats:
        """The variances (n,) of all unknowns, by the covariance (k, k) of what is left."""
        whole = np.empty(len(self.order))
        whole[self.left] = np.diag(joint)
        for part in self.parts:
            inverse = solve_triangular(part.factor, np.eye(len(part.factor)), lower=True, check_finite=False)
            follows, around = inverse.T @ part.cross, part.bound(part.bound(joint).T)
            whole[self.order[part.place]] = np.square(inverse).sum(axis=0) + (follows @ around * follows).sum(axis=1)
        return whole
