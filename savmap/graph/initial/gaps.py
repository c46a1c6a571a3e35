"""Where frames are missing: a video that was cut, or that dropped frames, makes the pictures contradict what is known of the row."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from savmap.graph.problem import Problem
from savmap.types import Ints

JUMP, LEAST_SHARED, LEAST_STEPS = 3.0, 3, 6
Sighting = tuple[int, int]


@dataclass(frozen=True)
class Step:
    """From one frame to the next that measured anything: seconds between them, how many landmarks both saw in one view, and the median of
    how far these moved, px (nan where they were few)."""

    before: int
    after: int
    seconds: float
    shared: int
    moved_px: float


def where_frames_are_missing(problem: Problem) -> str:
    """A sentence about the largest gap in a pass, by time, by how far things moved, or because nothing was seen both before and after it;
    empty where there is none."""
    found = max((gap for of_pass in problem.passes() for gap in _gaps(problem, of_pass)), default=None)
    return found[1] if found else ""


def _gaps(problem: Problem, of_pass: Ints) -> Iterator[tuple[float, str]]:
    """Gaps in a pass, each with how many times as large as usual it is."""
    steps = list(_steps(problem, of_pass))
    if len(steps) < LEAST_STEPS:
        return
    usual_s, usual_px = (
        float(np.nanmedian([getattr(step, name) for step in steps])) for name in ("seconds", "moved_px")
    )
    often = float(np.median([step.shared for step in steps])) >= LEAST_SHARED
    for step in steps:
        where = f"between frames {step.before} and {step.after} of {problem.camera.facts.frames.passes[step.before]}"
        at = f"{problem.camera.facts.frames.stamps_s[step.before]:.1f} s"
        if step.seconds > JUMP * usual_s:
            yield (
                step.seconds / usual_s,
                f"{step.seconds:.1f} s of frames are missing {where} (at {at}; usual: {usual_s:.2f} s)",
            )
        elif step.moved_px > JUMP * usual_px:
            times = step.moved_px / usual_px
            yield times, f"frames seem to be missing {where} (at {at}): things move {times:.0f} times as far as usual"
        elif often and not step.shared:
            yield JUMP, f"frames seem to be missing {where} (at {at}): nothing is seen in both"


def _steps(problem: Problem, of_pass: Ints) -> Iterator[Step]:
    stamps = problem.camera.facts.frames.stamps_s
    seen = [_sightings(problem, index) for index in of_pass.tolist()]
    for (before, first), (after, second) in pairwise(seen):
        both = sorted(first.keys() & second.keys())
        moved = [float(np.hypot(*(second[one] - first[one]))) for one in both]
        middle = float(np.median(moved)) if len(moved) >= LEAST_SHARED else float("nan")
        yield Step(before, after, float(stamps[after] - stamps[before]), len(both), middle)


def _sightings(problem: Problem, index: int) -> tuple[int, dict[Sighting, np.ndarray]]:
    """A frame's number, and the pixels (2,) of its landmarks by view and key."""
    measurements = problem.measurements
    rows = np.flatnonzero(problem.at_frame == index).tolist()
    pixels = {(int(measurements.view[row]), int(measurements.keys[row])): measurements.pixels[row] for row in rows}
    return int(problem.used[index]), pixels
