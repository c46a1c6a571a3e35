"""Frames that were solved far from those before and after them: too little was seen in them, and a camera does not
leap.

Such a frame fits its own few measurements wherever it is, so that no residual shows it; but it bends what others see
there, and pictures laid on a plane from such a place cover it.
"""

from dataclasses import replace

import numpy as np

from savmap.graph.problem import Problem, frames_bound
from savmap.types import Floats, Ints

LEAP, USUAL_QUANTILE = 6.0, 0.75
ALONE = 2


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
    astray = [problem.used[of_pass[_alone(problem, poses, of_pass, usual)]] for of_pass in problem.passes()]
    return np.concatenate([np.zeros(0, np.int64), *astray])


def without_frames(problem: Problem, frames: Ints) -> Problem:
    """The problem without what was measured in some frames; itself where a landmark was measured in these alone, or a
    plugin's factor binds one of them."""
    kept = ~np.isin(problem.measurements.frames, frames)
    if (
        set(problem.measurements.keys[kept]) != set(problem.measurements.keys)
        or np.isin(frames, frames_bound(problem)).any()
    ):
        return problem
    return replace(problem, measurements=problem.measurements.take(kept))


def _alone(problem: Problem, poses: Floats, of_pass: Ints, least: float) -> Ints:
    """Indices (k,) into a pass's frames of those in short runs between leaps of at least `least`."""
    if len(of_pass) <= 2 * ALONE + 1:
        return np.zeros(0, np.int64)
    stamps = problem.camera.facts.frames.stamps_s[problem.used[of_pass]]
    steps = np.linalg.norm(np.diff(poses[of_pass, :3, 3], axis=0), axis=1)
    times = np.diff(stamps) / max(float(np.median(np.diff(stamps))), 1e-9)
    paces = steps / np.maximum(times, 1.0)
    leaps = paces > max(LEAP * float(np.quantile(paces, USUAL_QUANTILE)), least)
    run = np.concatenate([[0], np.cumsum(leaps)])
    return np.flatnonzero(np.bincount(run)[run] <= ALONE)
