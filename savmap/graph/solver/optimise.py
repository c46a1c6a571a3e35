"""The solve: Levenberg-Marquardt with Huber's loss, then again without outliers, until these do not change; and
without frames that were solved far from those before and after them.

In such a frame too little was seen, and a camera does not leap. The frame fits its few measurements wherever it is, so
that no residual shows it; but it bends what others see there, and pictures laid on a plane from such a place cover it.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce

import gtsam
import numpy as np
from scipy.sparse import coo_array, csc_array

from savmap.errors import SolveError
from savmap.graph.calibration import calibration_report
from savmap.graph.covariance import Covariance, Covariances, covariance
from savmap.graph.factors.problem_factors import HUBER, estimate_of, values_of, whole_graph
from savmap.graph.factors.projections import whitening
from savmap.graph.initial.observability import SCALE_LIMIT, UnknownScaleError, robust_fit
from savmap.graph.initial.outlier_references import START_SIGMA_M, not_seen
from savmap.graph.initial.start import Start, aligned, moved, starts
from savmap.graph.measurements import ImageMeasurements
from savmap.graph.normal_equations import Layout, Reduced, SharedUnknowns
from savmap.graph.problem import Estimate, Problem, frames_of
from savmap.graph.solver.judgement.contradictions import Judgement, judgement_of
from savmap.graph.solver.judgement.reference_tests import (
    reference_tests,
    reference_uses,
    refuse_unseen,
    solved_references,
    tested_keys,
)
from savmap.graph.solver.judgement.soft_references import holding_scale, softened
from savmap.graph.solver.judgement.unchecked import moves
from savmap.graph.solver.levenberg_marquardt import FINE, ROUGH, minimum
from savmap.graph.solver.residuals import Fit, Persistence, fit_of, persistence
from savmap.graph.solver.solution import Solution, build_solution, pixels_off, scale_sigma, trajectory
from savmap.types import Bools, Floats, Ints, MapWarning, Trajectory

SETTLED = 1e-4
SETTLED_BIAS = 0.1
SOFT_ROUNDS = 3
"""Rounds with soft references: what fits hardly changes after them, and the rounds with the given ones begin with
it."""
OUTLIER_COST, CLEARLY = 12.5, 12.5
LARGE = 2.0
"""Times as far off as they should be: residuals of fewer are of good measurements with errors that persist, for which
another reference is the remedy."""
FAR_OFF_M = 0.25
"""A reference that is so far off a first fit to all would bend the path by which other structures are looked for."""
LEAP, USUAL_QUANTILE = 6.0, 0.75
MOST_FRAMES_ASTRAY = 2


@dataclass(frozen=True)
class SolveOptions:
    """A measurement more than `reject_sigma` standard deviations off is left out, in at most `rounds` rounds.
    `max_iterations` of Levenberg-Marquardt a round. `judge`: references that all else contradicts are found first;
    `judge_far`: where some are far off a first fit to all."""

    reject_sigma: float = 4.0
    rounds: int = 5
    max_iterations: int = 50
    judge: bool = True
    judge_far: bool = False


@dataclass(frozen=True, eq=False)
class Iterate:
    """The solve after a round: the problem corrected for the `bias` (k,) px estimated so far, the estimate, its fit,
    and how errors persist; `notes` for the user, what is known of the references, and the residuals' scale of the first
    round."""

    problem: Problem
    bias: Floats
    estimate: Estimate
    fit: Fit
    persistence: Persistence
    notes: tuple[str, ...] = ()
    judgement: Judgement | None = None
    first_scale: float = 0.0

    @property
    def inflation(self) -> Floats:
        """The factors (n,) by which measurements' variances are larger than given, in the solve and its tests."""
        return np.asarray(self.fit.scales**2 * self.persistence.solved)

    @property
    def huber(self) -> Floats:
        """Where (n,) Huber's loss of them turns from squares: persisting errors are not the more often outliers for
        that."""
        return np.asarray(HUBER / np.sqrt(self.persistence.solved))

    def warned(self, warning: MapWarning) -> "Iterate":
        """With something more that speaks against it."""
        judgement = self.judgement or Judgement(self.problem)
        return replace(self, judgement=replace(judgement, warnings=(*judgement.warnings, warning)))

    @property
    def scattered(self) -> "Iterate":
        """With larger variances of points whose measurements are at no one place."""
        return replace(self, fit=replace(self.fit, scales=self.fit.scales * self.fit.spread))

    @property
    def reported(self) -> "Iterate":
        """With the factors for the standard deviations that are reported instead."""
        return replace(self.scattered, persistence=replace(self.persistence, solved=self.persistence.reported))

    @property
    def kept(self) -> ImageMeasurements:
        """The measurements that fit, with the variances that they have."""
        return self.problem.measurements.inflated(self.inflation).take(self.fit.kept)


def solve(problem: Problem, options: SolveOptions | None = None) -> Solution:
    """Solve, reject, repeat; then covariances. Raises SolveError if scale or place are not observable, if references
    contradict one another, or if the graph cannot be solved."""
    return solution_of(converged(problem, options))


@dataclass(frozen=True, eq=False)
class LocatedCamera:
    """A first path of the camera, what of its scale and place was assumed for want of references (see `Problem`), and
    the first positions (3,) of every plugin's landmarks, by plugin and name."""

    path: Trajectory
    assumed: tuple[str, ...] = ()
    points: Mapping[str, Mapping[str, Floats]] = field(default_factory=dict)


def locate_camera(problem: Problem, sigmas: bool = False) -> LocatedCamera:
    """The camera's path by one round, good enough to track other structures, whichever of its references is wrong. With
    `sigmas` its standard deviations come with it. Raises SolveError if the graph cannot be solved or, unless the
    problem is `partial`, if scale or place are not observable."""
    options = SolveOptions(rounds=1, judge=False, judge_far=True)
    try:
        iterate = converged(problem, options)
    except SolveError:  # the solve of the row will tell
        iterate = converged(problem, replace(options, judge_far=False))
    problem, estimate = iterate.problem, iterate.estimate
    cameras = _covariance(iterate.reported, None).cameras if sigmas else None
    spread = None if cameras is None else np.sqrt(np.maximum(cameras, 0.0))
    points = {
        part.plugin: {name: estimate.points[problem.index(key)] for name, key in part.keys.items()}
        for part in problem.parts
    }
    return LocatedCamera(trajectory(problem, estimate, spread), problem.assumed, points)


def converged(problem: Problem, options: SolveOptions | None = None) -> Iterate:
    """The optimum, from the measurements that fit it; without the frames that are astray. Raises SolveError as `solve`
    does."""
    chosen = options or SolveOptions()
    iterate = _converged(problem, chosen)
    astray = frames_astray(iterate.problem, iterate.estimate.poses, iterate.estimate.points)
    if not len(astray):
        return iterate
    numbers = ", ".join(map(str, astray.tolist()))
    left = without_frames(problem, astray)
    if left is problem:
        line = f"solved far from the frames before and after: frame {numbers}"
        return iterate.warned(MapWarning("camera-motion", frame=int(astray[0]), details=(line,)))
    again = _converged(left, chosen)
    note = f"frame {numbers} is left out: too little was seen in it to tell where the camera was"
    return replace(again, notes=(*again.notes, note))


def _converged(problem: Problem, chosen: SolveOptions) -> Iterate:
    begin = _likeliest(starts(problem), chosen)
    judgement, estimate, soft = _tested(begin, chosen)
    *_, last = _rounds(judgement.problem, estimate, chosen, soft)
    if len(last.fit.kept) and not last.fit.kept.any():
        raise SolveError(f"row {problem.camera.facts.name}: no measurement fits the solution")
    judgement = replace(judgement, given=begin.given)
    last = replace(last, notes=(*begin.notes, *judgement.notes), judgement=judgement)
    return reduce(Iterate.warned, begin.warnings, last)


def _tested(begin: Start, options: SolveOptions) -> tuple[Judgement, Estimate, Iterate | None]:
    """The problem without wrong references, where to start with it, and the optimum with soft references, if there are
    any. Raises SolveError where it is not clear which is wrong."""
    given, estimate = begin.given, begin.estimate
    roughly = Judgement(begin.problem, notes=begin.refuted_notes), estimate, None
    if not options.judge and not options.judge_far:
        return roughly
    similarity, misfits = robust_fit(given, estimate.poses[:, :3, 3], estimate.points, START_SIGMA_M)
    if not options.judge and max(misfits.values(), default=0.0) < FAR_OFF_M:
        return roughly
    if similarity.scale <= 0:
        warnings = tuple(not_seen(*outlier) for outlier in begin.refuted)
        return Judgement(begin.problem, warnings=warnings), estimate, None
    if not misfits:
        return roughly
    soft = softened(given, misfits)
    if not any(True for _ in solved_references(soft, estimate)):
        return roughly
    options = replace(options, rounds=min(options.rounds, SOFT_ROUNDS))
    begun = moved(soft, estimate, similarity)
    soft = holding_scale(soft, begun.poses[:, :3, 3], begun.points)
    *_, last = _rounds(soft, begun, options)
    covariances = (_covariance(iterate, None, tested_keys(soft)) for iterate in (last, last.scattered))
    judgement = judgement_of(soft, given, last.estimate, covariances)
    return judgement, aligned(judgement.problem, last.estimate), last


def solution_of(iterate: Iterate, joint: Covariances | None = None) -> Solution:
    """The solution at an optimum, with its covariances or the `joint` ones of several rows. Raises SolveError if
    references contradict one another grossly."""
    if joint is None:
        tested = _covariance(iterate, None, tested_keys(iterate.problem))
        joint = Covariances(tested, with_hidden([iterate], _covariance(iterate.reported, None)))
    term = iterate.problem.camera.calibration
    calibration = calibration_report(term, iterate.bias, joint.reported, iterate.first_scale, iterate.fit.scale)
    notes = (*iterate.notes, *calibration.notes)
    inflation = _by_class(iterate.problem.measurements, iterate.reported.inflation)
    problem, estimate, fit = iterate.problem, iterate.estimate, iterate.fit
    judgement = iterate.judgement or Judgement(problem)
    refuse_unseen(problem, fit)
    try:
        tests = reference_tests(problem, estimate, joint.tested, judgement.unseen)
        figures = calibration.report
        solution = build_solution(
            problem, estimate, fit, joint.reported, tests, inflation, iterate.bias, notes, figures
        )
    except UnknownScaleError as error:
        warnings = "; ".join(warning.line for warning in judgement.warnings if warning.code == "reference-conflict")
        row = problem.camera.facts.name
        if misfit := _misfit(iterate):
            raise SolveError(f"row {row}: {misfit}{warnings and '; '}{warnings}") from None
        raise (
            SolveError(f"row {row}: {warnings}; what is left does not give the scale") if warnings else error
        ) from None
    uses = tuple(reference_uses(judgement.given or problem, problem, estimate))
    every = (*solution.warnings, *judgement.warnings)
    return replace(solution, references=uses, warnings=every, unchecked=judgement.unchecked)


def with_hidden(rows: Sequence[Iterate], whole: Covariance) -> Covariance:
    """The covariance of rows with how far their points move with errors of references that would stay hidden."""
    errors = [(row.problem, row.estimate, row.judgement.hidden if row.judgement else ()) for row in rows]
    return replace(whole, hidden=moves(errors, whole))


def _misfit(iterate: Iterate) -> str:
    """How far pixels are off, where that hides the scale that the references would give; else empty."""
    problem, fit = iterate.problem, iterate.fit
    if not fit.kept.any() or fit.scale < LARGE:
        return ""
    unit = np.ones(len(fit.kept))
    as_given = replace(iterate, fit=replace(fit, scales=unit), persistence=Persistence(unit, unit))
    if not scale_sigma(problem, iterate.estimate, _covariance(as_given, None)) < SCALE_LIMIT:
        return ""
    off_px = float(np.sqrt(np.mean(pixels_off(problem, fit)[fit.kept] ** 2)))
    return (
        f"what was measured does not fit together: pixels are off by {off_px:.1f} px, {fit.scale:.1f} times as far as "
        "they should be, which hides the scale that the references give; check that the pictures are whole panoramas "
        "of one aisle, neither cropped nor stretched, and the camera's height and other references"
    )


def _likeliest(begins: list[Start], options: SolveOptions) -> Start:
    """The start of the best fit of pictures and references. Raises SolveError where it is not clear, if not partial."""
    if len(begins) == 1:
        return begins[0]
    firsts = [next(_rounds(start.problem, start.estimate, options)) for start in begins]
    inflation = np.minimum.reduce([iterate.inflation for iterate in firsts])
    costs = [
        _cost(iterate, inflation) + OUTLIER_COST * len(start.refuted)
        for iterate, start in zip(firsts, begins, strict=True)
    ]
    best, second = (int(k) for k in np.argsort(costs, kind="stable")[:2])
    if costs[second] - costs[best] < CLEARLY and not begins[best].problem.partial:
        part, other = (" and ".join(begins[k].alternatives) for k in (best, second))
        raise SolveError(
            f"row {begins[0].problem.camera.facts.name}: only a part of the row was found, and it is not clear whether "
            f"that is {part} or {other}: give only the references of the part that the footage shows"
        )
    return begins[best]


def _by_class(measurements: ImageMeasurements, inflation: Floats) -> dict[str, float]:
    """The usual factor (n,) of each class of measurements, and of all."""
    if not len(inflation):
        return {}
    names = enumerate(measurements.class_names)
    of_class = {name: inflation[measurements.classes == number] for number, name in names}
    usual = {f"variance_inflation, {name}": float(np.median(some)) for name, some in of_class.items() if len(some)}
    return {"variance_inflation": float(np.median(inflation)), **usual}


def _cost(iterate: Iterate, inflation: Floats) -> float:
    """Half the sum of squared residuals, in sigmas, of all references and, by Huber's loss, of all measurements."""
    measurements = iterate.problem.measurements.inflated(inflation)
    graph = whole_graph(iterate.problem, iterate.estimate, measurements, HUBER)
    return graph.error(values_of(iterate.problem, iterate.estimate))


def _rounds(
    problem: Problem,
    estimate: Estimate,
    options: SolveOptions,
    begun: Iterate | None = None,
    bias: Floats | None = None,
) -> Iterator[Iterate]:
    """The iterates, of which the last is the answer: from all measurements at first, or those that fitted in what is
    `begun`, then from those that fitted, corrected for biases. `bias` (k,): where the biases begin."""
    huber = np.full(len(problem.measurements), HUBER)
    kept: Bools = np.ones(len(problem.measurements), dtype=bool)
    bias = _initial_biases(problem, options) if bias is None else bias
    weight, first_scale = np.ones(len(kept)), 0.0
    if begun is not None:
        kept, bias, weight, first_scale = begun.fit.kept, begun.bias, begun.inflation, begun.first_scale
        huber = begun.huber
    row = f"row {problem.camera.facts.name}"
    for number in range(options.rounds):
        near = number > 0 or begun is not None
        corrected = problem.without(bias, estimate.poses, estimate.points)
        weighed = corrected.measurements.inflated(weight).take(kept)
        graph = whole_graph(corrected, estimate, weighed, huber[kept])
        begin = values_of(corrected, estimate)
        values = minimum(row, graph, begin, options.max_iterations, FINE if near else ROUGH)
        estimate = estimate_of(corrected, values, estimate)
        corrected = problem.without(bias, estimate.poses, estimate.points)
        fit = fit_of(corrected, estimate, kept, options.reject_sigma)
        first_scale = first_scale or fit.scale
        iterate = Iterate(corrected, bias, estimate, fit, persistence(corrected, fit), first_scale=first_scale)
        weight = iterate.inflation
        yield iterate
        huber = iterate.huber
        step = _bias_step(iterate, huber) if number + 1 < options.rounds else np.zeros(len(bias))
        if near and (fit.kept != kept).sum() <= SETTLED * len(kept) and not step.any():
            return
        kept, bias = fit.kept, bias + step


def refined(problem: Problem, estimate: Estimate, options: SolveOptions, bias: Floats) -> Iterate:
    """The optimum near an estimate and biases (k,), without a look at the references. Raises SolveError if the graph
    cannot be solved."""
    *_, last = _rounds(problem, estimate, options, bias=bias)
    return last


def estimated_biases(iterate: Iterate) -> tuple[Floats, Floats]:
    """The biases (k,) at an optimum, the camera's calibration last, with the step that is left to it; and their
    covariance (k, k)."""
    joint = _covariance(iterate, iterate.huber, ())
    return iterate.bias + joint.step, joint.shared


def stepped(problem: Problem, iterate: Iterate, reject_sigma: float = SolveOptions.reject_sigma) -> Iterate:
    """After one Gauss-Newton step of all unknowns of a problem and its free biases, from an iterate that is corrected
    for its own; what fits, and the weights, are judged anew."""
    values, layout, reduced = _with_biases(iterate, iterate.huber)
    step = reduced.solve()
    moved = layout.moved(values, layout.vectors(step[: layout.size]))
    estimate, bias = estimate_of(problem, moved, iterate.estimate), iterate.bias.copy()
    bias[problem.measurements.biases.free] += step[layout.size :]
    corrected = problem.without(bias, estimate.poses, estimate.points)
    fit = fit_of(corrected, estimate, iterate.fit.kept, reject_sigma)
    return Iterate(corrected, bias, estimate, fit, persistence(corrected, fit))


def _with_biases(iterate: Iterate, huber: Floats | None) -> tuple[gtsam.Values, Layout, Reduced]:
    """The variables of a solve, as they are laid out, and its normal equations with the free biases."""
    values = values_of(iterate.problem, iterate.estimate)
    layout, unknowns = Layout.of(values), bias_unknowns(iterate, huber).estimated()
    return values, layout, Reduced.of(_graph_of(iterate, huber), values, layout, unknowns)


def _bias_step(iterate: Iterate, huber: Floats | None) -> Floats:
    """The step that brings the free biases (k,) to their optimum, zeros where that is near."""
    free, step = np.flatnonzero(iterate.problem.measurements.biases.free), np.zeros(len(iterate.bias))
    if len(free):
        _, layout, reduced = _with_biases(iterate, huber)
        estimated = reduced.solve()[layout.size :]
        if (np.abs(estimated) > SETTLED_BIAS * np.sqrt(np.diag(reduced.last(len(free))))).any():
            step[free] = estimated
    return step


def _initial_biases(problem: Problem, options: SolveOptions) -> Floats:
    """Where the biases (k,) begin: at 0, but for some of the camera's calibration, unless there is a single round."""
    biases, term = np.zeros(len(problem.measurements.biases.prior)), problem.camera.calibration
    if term is not None and term.names and options.rounds > 1:
        biases[-len(term.names) :] = term.initial
    return biases


def _covariance(iterate: Iterate, huber: Floats | None, only: Collection[int] | None = None) -> Covariance:
    values = values_of(iterate.problem, iterate.estimate)
    return covariance(_graph_of(iterate, huber), values, bias_unknowns(iterate, huber), only)


def _graph_of(iterate: Iterate, huber: Floats | None) -> gtsam.NonlinearFactorGraph:
    """The graph of what is kept, in Huber's loss unless that is None."""
    loss = None if huber is None else huber[iterate.fit.kept]
    return whole_graph(iterate.problem, iterate.estimate, iterate.kept, loss)


def bias_unknowns(iterate: Iterate, huber: Floats | None) -> SharedUnknowns:
    """The biases of the kept measurements."""
    kept, measurements = iterate.fit.kept, iterate.kept
    errors = iterate.fit.errors[kept] / np.sqrt(iterate.inflation[kept])[:, None]
    slopes = measurements.biases.scaled(iterate.fit.scales[kept])
    columns = _bias_columns(measurements, slopes, errors, None if huber is None else huber[kept])
    biases = iterate.problem.measurements.biases
    return SharedUnknowns(columns, iterate.bias, biases.prior, biases.free)


def _bias_columns(measurements: ImageMeasurements, slopes: Floats, errors: Floats, huber: Floats | None) -> csc_array:
    """Derivatives (2n, k) of whitened errors (n, 2), in Huber's loss, to biases: pixels move by `slopes` (n, 2, s)."""
    whiten = whitening(measurements.covariances)
    size = np.linalg.norm(errors, axis=1)
    weight = np.ones(len(size)) if huber is None else np.minimum(1.0, huber / np.maximum(size, 1e-9))
    biases = measurements.biases
    values = np.sqrt(weight)[:, None, None] * (whiten @ slopes)
    rows = np.broadcast_to(np.arange(2 * len(values)).reshape(-1, 2, 1), values.shape)
    columns = np.broadcast_to(biases.indices[:, None, :], values.shape)
    shape = (2 * len(values), len(biases.prior))
    return csc_array(coo_array((values.ravel(), (rows.ravel(), columns.ravel())), shape=shape))


def frames_astray(problem: Problem, poses: Floats, points: Floats) -> Ints:
    """Numbers (k,) of the frames whose pose (f, 4, 4) is a leap away from both neighbours' in their pass, one or two in
    a row.

    A leap is farther than the landmarks, at `points` (m, 3), usually are, and `LEAP` times what three quarters of the
    steps between frames stay below, for the time between them.
    """
    if problem.camera.fixed is not None:
        return np.zeros(0, np.int64)
    away = np.linalg.norm(points[problem.at_key] - poses[problem.at_frame, :3, 3], axis=1)
    usual = float(np.median(away)) if len(away) else np.inf
    astray = [problem.used[of_pass[_leapt(problem, poses, of_pass, usual)]] for of_pass in problem.passes()]
    return np.concatenate([np.zeros(0, np.int64), *astray])


def without_frames(problem: Problem, frames: Ints) -> Problem:
    """The problem without what was measured in some frames; itself where a landmark was measured in these alone, or a
    plugin's factor binds one of them."""
    kept = ~np.isin(problem.measurements.frames, frames)
    if (
        set(problem.measurements.keys[kept]) != set(problem.measurements.keys)
        or np.isin(frames, frames_of(problem.parts)).any()
    ):
        return problem
    return replace(problem, measurements=problem.measurements.take(kept))


def _leapt(problem: Problem, poses: Floats, of_pass: Ints, least: float) -> Ints:
    """Indices (k,) into a pass's frames of those in short runs between leaps of at least `least`."""
    if len(of_pass) <= 2 * MOST_FRAMES_ASTRAY + 1:
        return np.zeros(0, np.int64)
    stamps = problem.camera.facts.frames.stamps_s[problem.used[of_pass]]
    steps = np.linalg.norm(np.diff(poses[of_pass, :3, 3], axis=0), axis=1)
    times = np.diff(stamps) / max(float(np.median(np.diff(stamps))), 1e-9)
    paces = steps / np.maximum(times, 1.0)
    leaps = paces > max(LEAP * float(np.quantile(paces, USUAL_QUANTILE)), least)
    run = np.concatenate([[0], np.cumsum(leaps)])
    return np.flatnonzero(np.bincount(run)[run] <= MOST_FRAMES_ASTRAY)
