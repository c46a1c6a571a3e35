"""Residuals: their scale class by class, which measurements are outliers, how errors persist from frame to frame, and
what is off in one direction of the camera, the same in all frames.

Redundancy: a class that few measurements belong to but that places the camera, such as edges along which it moves,
loses more of its errors to the camera's poses than one of many measurements. Residuals are that much smaller.

Directions: a lens program that bends the pictures at their seam, or a cropped panorama, moves what is seen in a
direction by the same angle in every frame. Poses and structures absorb most of that, so that residuals stay small, and
references agree; what is left of it is smooth over the sphere and does not average out. It is fitted as a field of
small turns: Fourier terms of the longitude times powers of the latitude, for either component. Errors of measuring
leave next to none, for a structure is seen in other directions from frame to frame.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from savmap.graph.calibration import Lenses
from savmap.graph.initial.linear import equal_coordinates
from savmap.graph.problem import Estimate, Problem
from savmap.types import Bools, Floats, Ints

MEDIAN_CHI2 = 0.55
LOWER, LOWER_CHI2, SUSPECT = 0.2, 0.13, 1.5
LEAST_ROBUST, LEAST_SCALE = 0.5, 0.2
SURE = 10.0
"""A class's scale is taken for 1 with the weight of so many equations."""
UPPER, UPPER_CHI2 = 0.8, 1.62
LAGS = 30
LEAST_RATE = 0.05
LEAST_OF_ONE = 0.4
"""Of an error's square, at least so much is taken to be left where its point's mean absorbed the rest."""
MOST_INFLATION = 30.0
FEW_PAIRS = 30.0
"""A class's autocorrelations are taken for those of all classes with the weight of so many pairs."""
TURNS = 5
LEAST_LEFT, NEAREST_M = 0.1, 0.1
LOOSE = np.array([5.0, 5.0, 5.0, 0.1, 0.1, 0.1])
"""What is known of a pose in any case, 1/rad and 1/m: a frame with few measurements is not at a loss."""
WAVES, POWERS = 3, 2
"""The highest Fourier term in longitude and the highest power of the latitude."""
USUAL_DEG = 0.3
"""Standard deviation of a coefficient before anything is known."""
FEWEST = 60
"""From fewer measurements no field is fitted: its coefficients would follow their errors."""
FAR_SIGMA = 3.0


@dataclass(frozen=True, eq=False)
class Fit:
    """Whitened errors (n, 2), which measurements are kept (n,), and the errors' scale: 1 if covariances were honest,
    over all, and `scales` (n,) that of each measurement's class. `spread` (n,): by how much more (>= 1) the
    measurements of the same point vary."""

    errors: Floats
    kept: Bools
    scale: float
    scales: Floats
    spread: Floats


def fit_of(problem: Problem, estimate: Estimate, used: Bools, reject_sigma: float) -> Fit:
    """Judge all measurements by the scale of the errors of their class among those `used` (n,): a robust scale first,
    then the mean one (a variance component for each class, after Foerstner)."""
    if not len(problem.measurements):
        return Fit(np.zeros((0, 2)), used, 1.0, np.zeros(0), np.zeros(0))
    errors = problem.residuals(estimate.poses, estimate.points)
    squared = (errors**2).sum(axis=1)
    worth, classes = problem.measurements.dof, problem.measurements.classes
    robust = np.maximum(LEAST_ROBUST, _robust(squared / worth, classes, used))[classes]
    kept = squared < (reject_sigma * robust) ** 2
    freedom = np.bincount(classes[kept], worth[kept], len(problem.measurements.class_names)).astype(np.float64)
    spare = freedom * left_of(problem, estimate, kept, freedom)
    sums = np.bincount(classes[kept], squared[kept], len(freedom))
    scale = max(LEAST_SCALE, float(np.sqrt(sums.sum() / max(float(spare.sum()), 1.0))))
    scales = np.maximum(LEAST_SCALE, np.sqrt((sums + SURE) / (spare + SURE)))[classes]
    return Fit(errors, kept, scale, scales, _spread(problem, squared / (worth * scales**2)))


def _robust(squared: Floats, classes: Ints, used: Bools) -> Floats:
    """Scale (c,) of each class's used errors by their median; by their lower fifth where most seem outliers."""
    median, lower = (
        np.sqrt(_quantiles(squared, classes, used, share) / usual)
        for share, usual in ((0.5, MEDIAN_CHI2), (LOWER, LOWER_CHI2))
    )
    return np.where(median > SUSPECT, np.clip(lower, SUSPECT, np.maximum(median, SUSPECT)), median)


def _quantiles(values: Floats, groups: Ints, used: Bools, share: float) -> Floats:
    """A quantile of the used values of each group; of all, where a group has none."""
    every = used if used.any() else np.ones_like(used)
    of_all = float(np.quantile(values[every], share))
    present = (values[used & (groups == group)] for group in range(int(groups.max()) + 1))
    return np.array([float(np.quantile(group, share)) if len(group) else of_all for group in present])


def _spread(problem: Problem, squared: Floats) -> Floats:
    """How much (n,) larger the standard deviation of each point's measurements, and of its lines', is than the class's,
    by normalised `squared` (n,) errors, rejected ones included: where many do not fit, it may be another point."""
    lines = (equal_coordinates(problem, axis)[0][problem.at_key] for axis in range(3))
    return np.asarray(np.maximum.reduce([_upper(group, squared) for group in (problem.at_key, *lines)]))


def _upper(points: Ints, squared: Floats) -> Floats:
    """The standard deviation (n,), at least 1, of each group of measurements (n,), by where its upper fifth begins."""
    order = np.lexsort((squared, points))
    first, counts = np.unique(points[order], return_index=True, return_counts=True)[1:]
    at = first + np.minimum((UPPER * counts).astype(np.int64), counts - 1)
    upper = np.zeros(int(points.max()) + 1)
    upper[points[order][first]] = squared[order][at]
    return np.asarray(np.sqrt(np.maximum(upper / UPPER_CHI2, 1.0))[points])


@dataclass(frozen=True, eq=False)
class Persistence:
    """Factors (>= 1) by which errors that persist from frame to frame raise each measurement's variance: (n,) for the
    solve and its tests, and (n,) for the standard deviations that are reported."""

    solved: Floats
    reported: Floats


def persistence(problem: Problem, fit: Fit) -> Persistence:
    """1 + 2 (w_1 r_1 + w_2 r_2 + ...), with r_k the errors' autocorrelations over k frames, class by class, summed
    until they vanish (Geyer's initial sequence), and w_k = 1 - k / n.

    Residuals show too little correlation, for each point's position has absorbed the mean of its errors: n measurements
    without their mean lose I / n in every r_k, I being the factor itself. The reported factor allows for that lag by
    lag, in turns; the factor for tests, which must not hide a contradiction, does so for their sum alone.
    """
    classes = problem.measurements.classes
    if not fit.kept.any():
        return Persistence(*np.ones((2, len(classes))))
    rates, counts = _autocorrelations(problem, fit)
    factors = np.array([_factors(of_class, float(count)) for of_class, count in zip(rates, counts, strict=True)])
    return Persistence(factors[classes, 0], factors[classes, 1])


def _factors(rates: Floats, count: float) -> tuple[float, float]:
    """Both factors of a class, by its autocorrelations (LAGS,) and the usual number of measurements of a point."""
    weights = np.maximum(1 - np.arange(1, LAGS + 1) / max(count, 1.0), 0.0)
    lags = int(np.argmax(np.append(rates, 0.0) < LEAST_RATE))
    total, lost = 2 * float(weights[:lags] @ rates[:lags]), 2 * float(weights[:lags].sum())
    solved = min((1 + total) / max(1 + (total - lost) / count, LEAST_OF_ONE), MOST_INFLATION)
    reported = 1.0
    for _ in range(TURNS):
        raised = rates * max(1 - reported / count, LEAST_OF_ONE) + reported / count
        lags = int(np.argmax(np.append(raised, 0.0) < LEAST_RATE))
        reported = 1 + 2 * float(weights[:lags] @ raised[:lags])
    return solved, min(max(reported, solved), MOST_INFLATION)


def _autocorrelations(problem: Problem, fit: Fit) -> tuple[Floats, Floats]:
    """By class, the correlation (c, LAGS) of a point's errors over 1, 2, ... frames, and how many (c,) it has."""
    measurements = problem.measurements
    size, errors = len(measurements.class_names), fit.errors / fit.scales[:, None]
    order = np.lexsort((measurements.frames, measurements.view, measurements.keys))
    order = order[fit.kept[order]]
    both, squares = np.zeros((2, size, LAGS + 1))
    for shift in range(1, LAGS + 1):
        a, b = order[:-shift], order[shift:]
        lag = measurements.frames[b] - measurements.frames[a]
        same = (measurements.keys[a] == measurements.keys[b]) & (measurements.view[a] == measurements.view[b])
        near = same & (lag <= LAGS) & (lag > 0)
        first, second, cell = errors[a[near]], errors[b[near]], measurements.classes[a[near]] * (LAGS + 1) + lag[near]
        both += np.bincount(cell, (first * second).sum(axis=1), both.size).reshape(both.shape)
        halves = ((first**2).sum(axis=1) + (second**2).sum(axis=1)) / 2
        squares += np.bincount(cell, halves, squares.size).reshape(squares.shape)
    usual = both.sum(axis=0) / np.maximum(squares.sum(axis=0), 1e-9)
    rates = (both + FEW_PAIRS * usual) / (squares + FEW_PAIRS)
    pairs = np.unique(np.stack([measurements.classes[order], problem.at_key[order]]), axis=1)[0]
    counts = np.bincount(measurements.classes[order], minlength=size) / np.maximum(
        np.bincount(pairs, minlength=size), 1
    )
    return rates[:, 1:], np.maximum(counts, 1.0)


def left_of(problem: Problem, estimate: Estimate, kept: Bools, freedom: Floats) -> Floats:
    """The part (c,) of the `freedom` (c,) of the kept (n,) measurements of each class that is left of their errors'
    squares: 1 where the unknowns are held, 0.1 at the least."""
    count = len(freedom)
    classes = problem.measurements.classes[kept]
    points = np.unique(np.stack([classes, problem.at_key[kept]]), axis=1)[0]
    share = np.bincount(points, minlength=count) / max(len(problem.keys), 1)
    free = max(3 * len(problem.keys) - sum(not relation.name for relation in problem.relations), 0)
    taken = free * share + (0.0 if problem.camera.fixed is not None else _by_poses(problem, estimate, kept, count))
    return np.asarray(np.maximum(1 - taken / np.maximum(freedom, 1.0), LEAST_LEFT))


def _by_poses(problem: Problem, estimate: Estimate, kept: Bools, count: int) -> Floats:
    """How many of the poses' unknowns, six a frame, each class (c,) determines: its share of the information."""
    at, classes = problem.at_frame[kept], problem.measurements.classes[kept]
    slopes = _slopes(problem, estimate)[kept]
    information = np.zeros((count, len(problem.used), 6, 6))
    np.add.at(information, (classes, at), np.swapaxes(slopes, 1, 2) @ slopes)
    inverse = np.linalg.inv(information.sum(axis=0) + np.diag(LOOSE**2))
    return np.asarray(np.einsum("cfij,fji->c", information, inverse))


def _slopes(problem: Problem, estimate: Estimate) -> Floats:
    """Derivatives (n, 2, 6) of whitened errors by turns and steps of the rig, where errors are small."""
    poses = estimate.poses[problem.at_frame]
    forms = problem.linear_forms
    offsets = np.einsum("nji,nj->ni", poses[:, :3, :3], estimate.points[problem.at_key] - poses[:, :3, 3])
    depths = np.maximum(np.einsum("ni,ni->n", forms.axes, offsets), NEAREST_M)[:, None, None]
    turns = np.cross(forms.forms, offsets[:, None])
    return np.asarray(np.concatenate([turns, -forms.forms], axis=2) / depths)


@dataclass(frozen=True)
class DirectionalErrors:
    """By how much directions are off: the field's `angle_deg` (rms where something was measured), and the `share` of
    the squared errors that it explains."""

    angle_deg: float
    share: float


def directional_errors(problem: Problem, estimate: Estimate, fit: Fit) -> dict[str, DirectionalErrors]:
    """By plugin, the directional errors of what it measured and the solve kept. Plugins of which too little was
    measured have none."""
    errors = problem.residuals(estimate.poses, estimate.points)
    kept = {part.plugin: fit.kept & np.isin(problem.measurements.keys, [*part.keys.values()]) for part in problem.parts}
    return {plugin: _field_of(problem, errors, chosen) for plugin, chosen in kept.items() if chosen.sum() >= FEWEST}


def _field_of(problem: Problem, errors: Floats, chosen: Bools) -> DirectionalErrors:
    """The field that explains the whitened errors (n, 2) of the chosen measurements (n,)."""
    values = errors[chosen]
    size = np.linalg.norm(values, axis=1)
    weights = 1 / np.sqrt(1 + (size / (FAR_SIGMA * max(1.0, float(np.median(size))))) ** 2)
    terms, moves = _terms(problem, chosen)
    slopes = np.einsum("nik,nt->nikt", moves, terms) * weights[:, None, None, None]
    slopes, values = slopes.reshape(2 * len(size), -1), (values * weights[:, None]).ravel()
    prior = np.eye(slopes.shape[1]) / np.radians(USUAL_DEG) ** 2
    field = np.linalg.solve(slopes.T @ slopes + prior, slopes.T @ values)
    share = 1 - float(np.square(values - slopes @ field).sum() / max(np.square(values).sum(), 1e-12))
    turns = terms @ field.reshape(2, -1).T
    return DirectionalErrors(float(np.degrees(np.sqrt(np.square(turns).sum(axis=1).mean()))), share)


def _terms(problem: Problem, chosen: Bools) -> tuple[Floats, Floats]:
    """The field's terms (n, t) in the directions of the chosen measurements, and how their whitened errors change
    (n, 2, 2) as these turn eastwards and upwards, a radian."""
    measurements, forms = problem.measurements.take(chosen), problem.linear_forms
    rays = Lenses.of(measurements).rays(measurements.pixels)
    longitude, latitude = np.arctan2(rays[:, 0], rays[:, 2]), np.arcsin(np.clip(-rays[:, 1], -1.0, 1.0))
    east = np.stack([np.cos(longitude), np.zeros(len(rays)), -np.sin(longitude)], axis=1)
    towards = np.stack([east, np.cross(east, rays)], axis=2)
    depths = np.einsum("ni,ni->n", forms.axes[chosen], rays)
    moves = forms.forms[chosen] @ towards / depths[:, None, None]
    return np.stack([*_products(longitude, latitude)], axis=1), moves


def _products(longitude: Floats, latitude: Floats) -> Iterator[Floats]:
    for power in range(POWERS + 1):
        high = latitude**power
        yield high
        for wave in range(1, WAVES + 1):
            yield high * np.cos(wave * longitude)
            yield high * np.sin(wave * longitude)
