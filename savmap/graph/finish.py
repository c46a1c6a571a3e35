"""From an estimate and its covariance to the Solution: landmarks, trajectory, and a word on every reference."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from savmap.errors import SolveError
from savmap.graph import scale
from savmap.graph.constraints import Relation
from savmap.graph.covariance import Covariance, Covariances
from savmap.graph.doubt import gross
from savmap.graph.keys import mast_key
from savmap.graph.problem import Problem
from savmap.graph.residuals import Fit
from savmap.graph.solution import Landmark, Rejected, Solution
from savmap.graph.start import Estimate, rotations_at
from savmap.types import Floats, Ints, ReferenceUse, Trajectory

WARN_SIGMA, GROSS_SIGMA = 3.0, 5.0
LEAST_SPARE = 1e-6
VAGUE_M, VAGUE_SHARE = 0.25, 0.1
VAGUE_SCALE = 0.015
MANY_REJECTED = 0.25
UNSEEN = 2
DRIFT_M = 0.05
LEAST_APART_M = 0.01


@dataclass(frozen=True)
class Verdict:
    """A reference's use, what its value would be if it had not been given, and how many standard deviations it is off."""

    use: ReferenceUse
    otherwise: float
    off: float

    @property
    def gross(self) -> bool:
        """Off significantly, and grossly."""
        return self.off > GROSS_SIGMA and gross(self.use.value, self.otherwise)


def conclude(
    problem: Problem,
    estimate: Estimate,
    fit: Fit,
    covariances: Covariances,
    inflation: float,
    bias: Floats,
    notes: tuple[str, ...] = (),
    figures: Mapping[str, float | str] | None = None,
) -> Solution:
    """Put the results together; `notes` go before the warnings, `figures` after the report. Raises SolveError if references
    contradict one another grossly, or if they leave the scale open."""
    _refuse_unseen(problem, fit)
    tested, covariance = covariances.tested, covariances.told
    verdicts = [*_heights(problem, estimate, tested), *_relations(problem, estimate, tested)]
    _refuse_contradiction(problem, verdicts)
    share = 1.0 - float(fit.kept.mean())
    scale_sigma = _scale_sigma(problem, estimate, covariance)
    scale.require_known(problem, scale_sigma)
    return Solution(
        trajectory=_trajectory(problem, estimate, covariance),
        landmarks=_landmarks(problem, estimate, fit, covariance),
        references=tuple(verdict.use for verdict in verdicts),
        rejected=tuple(_rejected(problem, fit)),
        warnings=(*notes, *_warnings(verdicts, share, scale_sigma)),
        report={
            "observations": len(fit.kept),
            "rejected": int((~fit.kept).sum()),
            "rejected_share": share,
            "residual_scale": fit.scale,
            "scale_sigma": scale_sigma,
            "variance_inflation": inflation,
            "frames": len(problem.used),
            "landmarks": len(problem.keys),
            **dict(_biases(problem, bias, covariance)),
            **(figures or {}),
        },
        keys={room.room: room.keys for room in problem.rooms},
        covariance=covariance,
        off={verdict.use.name: verdict.off for verdict in verdicts},
    )


def _biases(problem: Problem, bias: Floats, covariance: Covariance) -> Iterator[tuple[str, float]]:
    """The rooms' biases that were estimated, with their standard deviations."""
    own = len(bias) - (len(problem.frames.calibration.names) if problem.frames.calibration else 0)
    for number in np.flatnonzero(problem.observations.shared.free[:own]).tolist():
        yield f"bias {number + 1}, px", float(bias[number])
        yield f"bias {number + 1}, sigma px", float(np.sqrt(covariance.shared[number, number]))


def _landmarks(
    problem: Problem, estimate: Estimate, fit: Fit, covariance: Covariance
) -> dict[str, dict[str, Landmark]]:
    seen = np.bincount(problem.at_key, minlength=len(problem.keys))
    used = np.bincount(problem.at_key[fit.kept], minlength=len(problem.keys))
    slot = {key: 3 * index for index, key in enumerate(covariance.keys)}

    def landmark(key: int) -> Landmark:
        index, first = problem.index(key), slot[key]
        own = covariance.points[first : first + 3, first : first + 3]
        return Landmark(estimate.points[index], own, int(used[index]), int(seen[index] - used[index]))

    return {room.room: {name: landmark(key) for name, key in room.keys.items()} for room in problem.rooms}


def _trajectory(problem: Problem, estimate: Estimate, covariance: Covariance) -> Trajectory:
    """Solved frames, and those between them: interpolated within a pass, with a sigma that grows with the gap."""
    table = problem.frames.facts.frames
    sigma = np.sqrt(np.maximum(covariance.places, 0.0))
    frames, poses, sigmas = [], [], []
    for chunk in problem.passes():
        if not len(chunk):
            continue
        known = problem.used[chunk]
        own = table.of_pass(table.passes[int(known[0])])
        wanted = own[(own >= known[0]) & (own <= known[-1])]
        frames.append(wanted)
        poses.append(_between(wanted, known, estimate.poses[chunk]))
        gap = np.abs(wanted[:, None] - known).min(axis=1)[:, None]
        sigmas.append(_columns(wanted, known, sigma[chunk]) + DRIFT_M * gap)
    order = np.argsort(np.concatenate(frames), kind="stable")
    return Trajectory(np.concatenate(frames)[order], np.concatenate(poses)[order], np.concatenate(sigmas)[order])


def _between(wanted: Ints, known: Ints, poses: Floats) -> Floats:
    filled = np.tile(np.eye(4), (len(wanted), 1, 1))
    filled[:, :3, :3] = rotations_at(wanted, known, poses[:, :3, :3])
    filled[:, :3, 3] = _columns(wanted, known, poses[:, :3, 3])
    exact = np.isin(wanted, known)
    filled[exact] = poses
    return filled


def _columns(wanted: Ints, known: Ints, values: Floats) -> Floats:
    return np.stack([np.interp(wanted, known, column) for column in values.T], axis=1)


def _heights(problem: Problem, estimate: Estimate, covariance: Covariance) -> Iterator[Verdict]:
    if problem.frames.fixed is not None:
        return
    for number, (height, solved) in enumerate(
        zip(problem.frames.references.camera_heights, estimate.heights, strict=True)
    ):
        name = " ".join(("camera height", *height.passes))
        measured = Measured(float(solved), np.eye(3)[1], covariance, [mast_key(number)])
        yield _verdict(name, height.value_m, height.sigma_m, measured)


def _relations(problem: Problem, estimate: Estimate, covariance: Covariance) -> Iterator[Verdict]:
    for relation in problem.relations:
        if relation.name:
            yield _verdict(
                relation.name, relation.value, relation.sigma, _solved(problem, relation, estimate, covariance)
            )


def _solved(problem: Problem, relation: Relation, estimate: Estimate, covariance: Covariance) -> "Measured":
    at = estimate.points[problem.index(relation.a)]
    if relation.b is None:
        axis = relation.column
        return Measured(float(at[axis]), np.eye(3)[axis], covariance, [relation.a])
    span = estimate.points[problem.index(relation.b)] - at
    along = span / np.linalg.norm(span) if relation.axis is None else np.eye(3)[relation.column]
    return Measured(float(along @ span), np.concatenate([-along, along]), covariance, [relation.a, relation.b])


@dataclass(frozen=True)
class Measured:
    """What the solution says of a reference: its value, and its derivative (3n,) to points by `keys` (n)."""

    value: float
    slope: Floats
    covariance: Covariance
    keys: list[int]

    @property
    def considered(self) -> float:
        """The variance that comes from what was not estimated."""
        return float(self.slope @ self.covariance.considered(self.keys) @ self.slope)

    @property
    def estimated(self) -> float:
        """The variance beside that."""
        return float(self.slope @ self.covariance.of(self.keys) @ self.slope) - self.considered


def _verdict(name: str, value: float, sigma: float, solved: Measured) -> Verdict:
    """Baarda's test: a residual's own variance is the reference's less the solution's, and with it what the solution follows
    of that which was not estimated.

    The residual is but a part of what the rest deviates: the share that the reference leaves it. Where the rest hardly
    speaks of what the reference says, it cannot be tested.
    """
    share = max(1.0 - solved.estimated / sigma**2, LEAST_SPARE)
    spread = float(np.sqrt(share * sigma**2 + solved.considered))
    residual = solved.value - value
    use = ReferenceUse(name, value, sigma, solved.value)
    if spread / share > max(VAGUE_M, VAGUE_SHARE * abs(value)):
        return Verdict(use, solved.value, 0.0)
    return Verdict(use, value + residual / share, abs(residual) / spread)


def _refuse_contradiction(problem: Problem, verdicts: list[Verdict]) -> None:
    gross = [verdict for verdict in verdicts if verdict.gross]
    if gross:
        told = "; ".join(_told(verdict) for verdict in sorted(gross, key=lambda v: -v.off)[:3])
        raise SolveError(f"row {problem.frames.facts.name}: the references contradict one another or the video: {told}")


def _refuse_unseen(problem: Problem, fit: Fit) -> None:
    """Raises SolveError where references hold only because all that was seen of their landmarks was rejected: another one, grossly
    wrong, has won."""
    seen, used = (np.bincount(keys, minlength=len(problem.keys)) for keys in (problem.at_key, problem.at_key[fit.kept]))
    lost = [
        relation.name
        for relation in problem.relations
        if relation.name
        and any(seen[at] and not used[at] for at in map(problem.index, filter(None, (relation.a, relation.b))))
    ]
    if len(lost) >= UNSEEN:
        raise SolveError(
            f"row {problem.frames.facts.name}: the references contradict one another or the video: nothing that was seen of "
            f"{', '.join(lost[:3])} fits the others"
        )


def _told(verdict: Verdict) -> str:
    use = verdict.use
    return f"{use.name} is given as {use.value:.3f} m +- {use.sigma:.3f} m, but the rest says {verdict.otherwise:.3f} m"


def _scale_sigma(problem: Problem, estimate: Estimate, covariance: Covariance) -> float:
    """What is left open of the scale, as a fraction: of the best known distance along the aisle from the row's origin."""
    slots = {key: 3 * index for index, key in enumerate(covariance.keys)}
    order = [slots[int(key)] for key in problem.keys]
    sigma = np.sqrt(np.maximum(np.diag(covariance.points)[order], 0.0))
    distance = np.abs(estimate.points[:, 0])
    apart = distance > LEAST_APART_M
    return float((sigma[apart] / distance[apart]).min()) if apart.any() else 0.0


def _warnings(verdicts: list[Verdict], share: float, scale_sigma: float) -> Iterator[str]:
    if scale_sigma > VAGUE_SCALE:
        yield f"the references give the scale to +-{scale_sigma:.1%} only: a known length would help"
    yield from (_told(verdict) for verdict in verdicts if verdict.off > WARN_SIGMA)
    if share > MANY_REJECTED:
        yield f"{share:.0%} of the observations did not fit and were left out"


def _rejected(problem: Problem, fit: Fit) -> Iterator[Rejected]:
    observations = problem.observations
    for number in np.flatnonzero(~fit.kept).tolist():
        room, name = problem.name_of(int(observations.keys[number]))
        yield Rejected(room, name, int(observations.frames[number]), observations.views[observations.view[number]].name)
