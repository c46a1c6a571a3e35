"""From an estimate and its covariance to the Solution: landmarks, trajectory, and a word on every reference."""

from collections.abc import Iterator, Mapping

import numpy as np

from savmap.graph import scale
from savmap.graph.covariance import Covariance, Covariances
from savmap.graph.problem import Problem
from savmap.graph.residuals import Fit
from savmap.graph.solution import Landmark, Rejected, Solution
from savmap.graph.start import Estimate, rotations_at
from savmap.graph.verdicts import Verdict, judged, refuse_contradiction, refuse_unseen, told
from savmap.types import Floats, Ints, Trajectory

WARN_SIGMA = 3.0
VAGUE_SCALE = 0.015
MANY_REJECTED = 0.25
DRIFT_M = 0.05
LEAST_APART_M = 0.01


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
    refuse_unseen(problem, fit)
    tested, covariance = covariances.tested, covariances.told
    verdicts = judged(problem, estimate, tested)
    refuse_contradiction(problem, verdicts)
    share = 1.0 - float(fit.kept.mean())
    scale_sigma = _scale_sigma(problem, estimate, covariance)
    scale.require_known(problem, scale_sigma)
    return Solution(
        trajectory=trajectory(problem, estimate, np.sqrt(np.maximum(covariance.places, 0.0))),
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
        own=estimate.own,
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


def trajectory(problem: Problem, estimate: Estimate, sigma: Floats | None = None) -> Trajectory:
    """Solved frames, whose places are good to `sigma` (f, 3), and those between them: interpolated within a pass, with a sigma that
    grows with the gap."""
    table = problem.frames.facts.frames
    frames, poses, sigmas = [], [], []
    for chunk in problem.passes():
        if not len(chunk):
            continue
        known = problem.used[chunk]
        own = table.of_pass(table.passes[int(known[0])])
        wanted = own[(own >= known[0]) & (own <= known[-1])]
        frames.append(wanted)
        poses.append(_between(wanted, known, estimate.poses[chunk]))
        if sigma is not None:
            gap = np.abs(wanted[:, None] - known).min(axis=1)[:, None]
            sigmas.append(_columns(wanted, known, sigma[chunk]) + DRIFT_M * gap)
    order = np.argsort(np.concatenate(frames), kind="stable")
    spread = np.concatenate(sigmas)[order] if sigma is not None else None
    return Trajectory(np.concatenate(frames)[order], np.concatenate(poses)[order], spread)


def _between(wanted: Ints, known: Ints, poses: Floats) -> Floats:
    filled = np.tile(np.eye(4), (len(wanted), 1, 1))
    filled[:, :3, :3] = rotations_at(wanted, known, poses[:, :3, :3])
    filled[:, :3, 3] = _columns(wanted, known, poses[:, :3, 3])
    exact = np.isin(wanted, known)
    filled[exact] = poses
    return filled


def _columns(wanted: Ints, known: Ints, values: Floats) -> Floats:
    return np.stack([np.interp(wanted, known, column) for column in values.T], axis=1)


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
    yield from (told(verdict) for verdict in verdicts if verdict.off > WARN_SIGMA)
    if share > MANY_REJECTED:
        yield f"{share:.0%} of the observations did not fit and were left out"


def _rejected(problem: Problem, fit: Fit) -> Iterator[Rejected]:
    observations = problem.observations
    for number in np.flatnonzero(~fit.kept).tolist():
        room, name = problem.name_of(int(observations.keys[number]))
        yield Rejected(room, name, int(observations.frames[number]), observations.views[observations.view[number]].name)
