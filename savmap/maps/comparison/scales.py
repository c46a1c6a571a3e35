"""By how much more one map measures than another, and whether what both know of their scale allows that.

A scale that all elements of a row have in common says nothing of any one of them, so that the fit takes it out. It does
say that one of the maps rests on a wrong reference, such as a camera's height that is off by a hand's breadth. It is
estimated free of any prior; its variance is that of the fit, and what the errors that either map's elements share make
of it, by that map's joint covariance.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from scipy.stats import norm
from scipy.stats import t as student

from savmap.maps.comparison.changes import accepted
from savmap.maps.comparison.elements import Elements, sides
from savmap.maps.comparison.motion import LEAST_SCALE, SCALE, Equations, Fit, Pairs
from savmap.maps.comparison.records import ScaleDifference
from savmap.types import Floats, JointCovariance, RowMap, Structure

SIGMAS = 3.0
LEAST_LEVER_M = 1.0
SAY_LEAST_P = 1e-12


def scale_differences(
    found: Fit, pairs: Pairs, old: tuple[Elements, RowMap], new: tuple[Elements, RowMap]
) -> tuple[ScaleDifference, ...]:
    """The scales along x and y that a fit without a prior of them found; none along an axis on which nothing is far
    enough apart to tell. Whether they are significant is said by `judged_scales`."""
    return tuple(_differences(found, pairs, old, new))


def _differences(
    found: Fit, pairs: Pairs, old: tuple[Elements, RowMap], new: tuple[Elements, RowMap]
) -> Iterator[ScaleDifference]:
    equations, gain = found.equations, found.gain
    rows, columns = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    freedom = float(found.freedom.min())
    for axis, name in ((0, "x"), (1, "y")):
        known = [
            _map_sigma(equations, gain[SCALE][axis], axis, of, chosen, found.turned and of is old)
            for of, chosen in ((old, rows.tolist()), (new, columns.tolist()))
        ]
        if known[0] is None or known[1] is None:
            continue
        variance = float(found.covariance[SCALE, SCALE][axis, axis]) + LEAST_SCALE**2
        share, sigma = float(found.unknowns[SCALE][axis]), float(np.sqrt(variance + known[0] ** 2 + known[1] ** 2))
        p = 2 * float(student.sf(abs(share) / sigma, freedom))
        yield ScaleDifference(name, share, sigma, known[0], known[1], max(p, SAY_LEAST_P))


def _map_sigma(
    equations: Equations, gain: Floats, axis: int, of: tuple[Elements, RowMap], chosen: Sequence[int], turned: bool
) -> float | None:
    """The standard deviation of a map's own scale along an axis, as the fit's equations tell it; None where nothing
    tells."""
    elements, row = of
    lever = np.abs(equations.slopes[:, SCALE][:, axis])
    far = (equations.axis == axis) & ~equations.size & (lever > LEAST_LEVER_M)
    if not far.any():
        return None
    if row.joint is not None:
        return _joint_sigma(equations, gain, elements, row.joint, chosen, turned)
    rates = elements.middle_sigmas[np.asarray(chosen)[equations.pair[far]], axis] / lever[far]
    return float(np.median(rates))


def _joint_sigma(
    equations: Equations,
    gain: Floats,
    elements: Elements,
    joint: JointCovariance,
    chosen: Sequence[int],
    turned: bool,
) -> float:
    """What the errors of a map's vertices, and what they share, make of a figure that is `gain` (m,) times the
    differences."""
    solved, own = np.zeros(len(joint.covariance)), 0.0
    for pair, k in enumerate(chosen):
        structure = elements.structures[k]
        weights = _vertex_weights(equations, gain, pair, structure, turned)
        numbers = joint.coordinates.get(elements.kinds[elements.groups[k]][0], {}).get(structure.id)
        of_joint = np.zeros(weights.shape, dtype=np.bool_) if numbers is None else numbers >= 0
        if numbers is not None:
            np.add.at(solved, numbers[of_joint], weights[of_joint])
        spread = np.diagonal(structure.covariances, axis1=1, axis2=2)
        own += float(np.sum((weights**2 * spread)[~of_joint]))
    return float(np.sqrt(max(float(solved @ joint.covariance @ solved), 0.0) + own))


def _vertex_weights(equations: Equations, gain: Floats, pair: int, structure: Structure, turned: bool) -> Floats:
    """How much (n, 3) each coordinate of a structure's vertices counts in the figure."""
    weights = np.zeros(structure.vertices.shape)
    low, high = sides(structure.vertices)
    for k in np.flatnonzero(equations.pair == pair):
        axis, share = int(equations.axis[k]), float(gain[k]) / len(low)
        if equations.size[k]:
            ends = -share, share
        else:
            ends = (-share / 2, -share / 2) if turned and axis != 1 else (share / 2, share / 2)
        np.add.at(weights[:, axis], low[:, axis], ends[0])
        np.add.at(weights[:, axis], high[:, axis], ends[1])
    return weights


def stands_out(scales: Sequence[ScaleDifference]) -> bool:
    """Whether any of these scales, by itself, is beyond what both maps know."""
    return any(one.p <= _least_p() for one in scales)


def judged_scales(rows: Sequence[Sequence[ScaleDifference]], level: float) -> list[tuple[ScaleDifference, ...]]:
    """The scales of each row with what is significant of them: beyond three standard deviations, and, of all rows'
    scales together, with no more than a share of `level` that is chance."""
    limit = min(accepted([one.p for row in rows for one in row], level), _least_p())
    return [tuple(replace(one, significant=one.p <= limit) for one in row) for row in rows]


def _least_p() -> float:
    return 2 * float(norm.sf(SIGMAS))
