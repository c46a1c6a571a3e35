"""A start that needs no guess: with attitudes known, every pixel is a linear equation in camera position and point.

On the face plane it reads (x - t_x) d_z + t_z d_x = 0 for a ray d; in general, forms @ (X - t) / depth = 0, whitened in
pixels (see `LinearForms`), with the depth of the last round. Points with an equal coordinate share one unknown. The
equations are homogeneous: position and scale are set roughly here, by the start's mean, and by the references
afterwards (`initial.observability.fit`).
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix, csc_matrix, vstack
from scipy.sparse.linalg import splu

from savmap.graph.factors.walked import PLACE_SIGMA, shares
from savmap.graph.problem import Problem
from savmap.types import Floats, Ints, Trajectory

ROUNDS = 6
HUBER = 1.345
HARD, SOFT = 1e4, 1e-3
SMOOTH_M = 1.0
ANCHORED = 50
"""How many cameras have their mean position set: an equation of all of them would be dense."""
LEAST_FIRM = 1e-6
"""Of a camera that nothing holds; where nothing holds most of them, all count alike."""

Equation = tuple[list[tuple[int, float]], float]


@dataclass(frozen=True)
class Layout:
    """Where unknowns stand: slot (m, 3) of each point's coordinate, or -1 where it is set to fixed (m, 3); cameras come
    first."""

    slot: Ints
    fixed: Floats
    cameras: int
    size: int


def layout(problem: Problem) -> Layout:
    """Points with an equal coordinate share a slot; fixed coordinates have none."""
    count, cameras = len(problem.keys), 0 if problem.camera.fixed is not None else len(problem.used)
    slot, fixed, size = np.zeros((count, 3), np.int64), np.zeros((count, 3)), 3 * cameras
    for axis in range(3):
        group, fixed_groups = equal_coordinates(problem, axis)
        roots = np.unique(group)
        free = np.array([root for root in roots if root not in fixed_groups], np.int64)
        place = np.full(count, -1, np.int64)
        place[free] = size + np.arange(len(free))
        slot[:, axis] = place[group]
        fixed[:, axis] = [fixed_groups.get(root, 0.0) for root in group.tolist()]
        size += len(free)
    return Layout(slot, fixed, cameras, size)


def equal_coordinates(problem: Problem, axis: int) -> tuple[Ints, dict[int, float]]:
    """For each point the smallest index of those with an equal coordinate along an axis, and the values of fixed
    groups."""
    group = list(range(len(problem.keys)))

    def root(index: int) -> int:
        while group[index] != index:
            group[index] = group[group[index]]
            index = group[index]
        return index

    structure = [r for r in problem.relations if not r.name and r.column == axis]
    for relation in structure:
        if relation.b is not None and relation.value == 0.0:
            low, high = sorted((root(problem.index(relation.a)), root(problem.index(relation.b))))
            group[high] = low
    fixed = {root(problem.index(r.a)): r.value for r in structure if r.b is None}
    return np.array([root(index) for index in range(len(group))], np.int64), fixed


def linear_positions(problem: Problem, poses: Floats, initial: Floats) -> tuple[Floats, Floats]:
    """Camera positions (f, 3) and points (m, 3) up to scale and shift, from attitudes in poses (f, 4, 4); rough
    positions in both arguments only set the scale and hold what was not measured. Robust: every round weighs the
    measurements anew."""
    plan = layout(problem)
    forms_in_world = problem.linear_forms.rotated(poses[problem.at_frame, :3, :3])
    priors = _matrix(_soft(problem, plan, poses, initial), plan.size)
    depths = _first_depths(problem, plan, forms_in_world.forms, forms_in_world.axes, poses)
    weights = np.ones(len(problem.measurements))
    cameras, points = poses[:, :3, 3], initial
    for number in range(ROUNDS):
        forms = forms_in_world.forms * (weights / depths)[:, None, None]
        anchors = _anchors(problem, plan, poses, weights / depths)
        unknowns = _solve(vstack([_rows(problem, plan, forms, poses), priors, *anchors]).tocsc(), plan.size)
        cameras, points = _unpack(plan, unknowns, poses)
        errors, depths = forms_in_world.residuals(points[problem.at_key] - cameras[problem.at_frame])
        weights = _weights(np.linalg.norm(errors, axis=1), number)
        depths = np.maximum(depths, 0.2)
    return cameras, points


def _weights(errors: Floats, number: int) -> Floats:
    """Square roots of Huber's weights at first, then of Geman and McClure's."""
    scale = max(1.0, float(np.median(errors)) / 1.1774)
    if number < 3:
        return np.sqrt(np.minimum(1.0, HUBER * scale / np.maximum(errors, 1e-9)))
    return 1.0 / (1.0 + (errors / (3.0 * scale)) ** 2)


def _first_depths(problem: Problem, plan: Layout, forms: Floats, axes: Floats, poses: Floats) -> Floats:
    """Depth (n,) m: where the ray meets the face, for points known to lie there; the start's distance otherwise."""
    rays = np.cross(forms[:, 0], forms[:, 1])
    rays /= np.einsum("ni,ni->n", rays, axes)[:, None]
    away = poses[problem.at_frame, 2, 3]
    typical = float(np.median(np.abs(away))) if plan.cameras else 3.0
    on_face = (plan.slot[problem.at_key, 2] < 0) & (away * rays[:, 2] < 0)
    depths = np.where(on_face, -away / np.where(on_face, rays[:, 2], 1.0), typical)
    limited: Floats = np.clip(depths, 0.3, 30.0)
    return limited


def _rows(problem: Problem, plan: Layout, forms: Floats, poses: Floats) -> csc_matrix:
    """Equations (2n, size + 1), the last column being what is known (moved to the left side)."""
    row = np.arange(2 * len(forms)).reshape(-1, 2, 1)
    slot, fixed = plan.slot[problem.at_key], plan.fixed[problem.at_key]
    columns = np.where(slot < 0, plan.size, slot)
    parts = [(row, columns[:, None, :], forms * np.where(slot < 0, fixed, 1.0)[:, None, :])]
    if plan.cameras:
        parts.append((row, 3 * problem.at_frame[:, None, None] + np.arange(3), -forms))
    else:
        constant = -np.einsum("nij,nj->ni", forms, poses[problem.at_frame, :3, 3])[:, :, None]
        parts.append((row, np.full((1, 1, 1), plan.size), constant))
    flat = [tuple(np.broadcast_to(array, shape.shape).ravel() for array in (r, c, shape)) for r, c, shape in parts]
    rows, cols, data = (np.concatenate(arrays) for arrays in zip(*flat, strict=True))
    return coo_matrix((data, (rows, cols)), shape=(2 * len(forms), plan.size + 1)).tocsc()


def _soft(problem: Problem, plan: Layout, poses: Floats, initial: Floats) -> Iterator[Equation]:
    """Smooth motion, or as it was walked; the extent of a path without a face plane; a faint pull of every coordinate
    to its start."""
    for slots, value in _faint(plan, initial):
        yield [(slots, SOFT)], SOFT * value
    if not plan.cameras:
        return
    if (plan.slot[:, 2] >= 0).any() and not (plan.slot[:, 2] < 0).any():
        yield _travel(poses, plan)
    if problem.camera.walked is not None:
        yield from _as_walked(problem, problem.camera.walked, poses)
        return
    for chunk in problem.passes():
        for before, now, after in zip(chunk[:-2], chunk[1:-1], chunk[2:], strict=True):
            for axis in range(3):
                bend = [(3 * int(before) + axis, 0.5), (3 * int(now) + axis, -1.0), (3 * int(after) + axis, 0.5)]
                yield [(slot, weight / SMOOTH_M) for slot, weight in bend], 0.0


def _as_walked(problem: Problem, walked: Trajectory, poses: Floats) -> Iterator[Equation]:
    """Each frame lies between two others as in a walked path, in the axes that the poses (f, 4, 4) of the used frames
    give the first."""
    for three, share in shares(walked, problem.camera.facts.frames, problem.used):
        first, second, last = (int(np.searchsorted(problem.used, frame)) for frame in three)
        turn = poses[first, :3, :3]
        along = turn @ share @ turn.T
        weight = 1 / (PLACE_SIGMA * max(float(np.linalg.norm(poses[last, :3, 3] - poses[first, :3, 3])), 1e-6))
        for axis in range(3):
            entries = [(3 * first + k, weight * (along[axis, k] - (axis == k))) for k in range(3)]
            entries += [(3 * last + k, -weight * along[axis, k]) for k in range(3)]
            yield [*entries, (3 * second + axis, weight)], 0.0


def _anchors(problem: Problem, plan: Layout, poses: Floats, factors: Floats) -> Iterator[csc_matrix]:
    """Position and scale, where cameras are sought: the mean place of some is the start's.

    Each counts by how firmly its measurements, with their `factors` (n,), hold it, at most as much as most do: all
    others shrink to a point for one that flies off."""
    if not plan.cameras:
        return
    anchors = np.unique(np.linspace(0, plan.cameras - 1, ANCHORED).astype(np.int64))
    firm = np.bincount(problem.at_frame, np.square(factors), plan.cameras)[anchors]
    shares = np.minimum(firm, np.median(firm)) + LEAST_FIRM
    shares /= shares.sum()
    for axis in range(3):
        if axis == 2 or (plan.slot[:, axis] >= 0).all():
            entries = [(3 * f + axis, HARD * share) for f, share in zip(anchors.tolist(), shares.tolist(), strict=True)]
            yield _matrix([(entries, HARD * float(shares @ poses[anchors, axis, 3]))], plan.size)


def _faint(plan: Layout, initial: Floats) -> Iterator[tuple[int, float]]:
    slots, first = np.unique(plan.slot.ravel(), return_index=True)
    for slot, index in zip(slots.tolist(), first.tolist(), strict=True):
        if slot >= 0:
            yield slot, float(initial.ravel()[index])


def _travel(poses: Floats, plan: Layout) -> Equation:
    """The extent of the cameras' path is the start's: for structures without a face plane."""
    path = poses[:, :3, 3] - poses[:, :3, 3].mean(axis=0)
    extent = max(float((path**2).sum()), 1e-9)
    entries = [(3 * f + axis, HARD * path[f, axis] / extent) for f in range(plan.cameras) for axis in range(3)]
    return entries, HARD


def _matrix(equations: Iterable[Equation], size: int) -> csc_matrix:
    """Equations (k, size + 1) in the form of `_rows`."""
    triplets = [(row, *entry) for row, (entries, value) in enumerate(equations) for entry in (*entries, (size, -value))]
    rows, cols, data = (np.array(column) for column in zip(*triplets, strict=True))
    return coo_matrix((data, (rows, cols)), shape=(int(rows[-1]) + 1, size + 1)).tocsc()


def _solve(matrix: csc_matrix, size: int) -> Floats:
    normal = (matrix.T @ matrix).tocsc()
    right = -normal[:size, size].toarray().ravel()
    factor = splu(normal[:size, :size].tocsc(), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
    return np.asarray(factor.solve(right), np.float64)


def _unpack(plan: Layout, unknowns: Floats, poses: Floats) -> tuple[Floats, Floats]:
    cameras = unknowns[: 3 * plan.cameras].reshape(-1, 3) if plan.cameras else poses[:, :3, 3]
    points = np.where(plan.slot < 0, plan.fixed, unknowns[np.maximum(plan.slot, 0)])
    return cameras, points
