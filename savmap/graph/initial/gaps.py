"""Where frames are missing: a video that was cut, or that dropped frames, makes the pictures contradict what is known
of the row."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from savmap.graph.problem import Problem
from savmap.types import Floats, FrameTable, Track

JUMP, LEAST_SHARED, LEAST_STEPS = 3.0, 3, 6
FEWER = 6.0
"""By how many times a smaller share than usual is seen on both sides of a gap: detectors miss single lines in single
frames."""
Place = tuple[int | str, int | str]
"""A view and a landmark that was seen in it."""
Sightings = Mapping[Place, Floats]
"""The pixels (2,) of what a frame saw."""


@dataclass(frozen=True)
class Step:
    """From one frame to the next that measured anything: seconds between them, the share `shared` of the landmarks of
    the poorer frame that both saw, and the median of how far these moved, px (nan where they are few)."""

    before: int
    after: int
    seconds: float
    shared: float
    moved_px: float


def where_frames_are_missing(problem: Problem) -> str:
    """A sentence about the largest gap in a pass, by time, by how far things moved, or because nothing was seen both
    before and after it; empty where there is none."""
    frames, measurements = problem.camera.facts.frames, problem.measurements
    seen: dict[int, dict[Place, Floats]] = {frame: {} for frame in problem.used.tolist()}
    places = zip(measurements.view.tolist(), measurements.keys.tolist(), strict=True)
    for index, place, pixel in zip(problem.at_frame.tolist(), places, measurements.pixels, strict=True):
        seen[int(problem.used[index])][place] = pixel
    return _largest_gap(frames, seen)


def where_tracks_miss_frames(tracks: Sequence[Track], frames: FrameTable) -> str:
    """As `where_frames_are_missing`, from tracks alone: for a row whose problem cannot be built."""
    seen: dict[int, dict[Place, Floats]] = {}
    for track in tracks:
        for frame, view, pixel in zip(track.frames.tolist(), track.views, track.pixels, strict=True):
            seen.setdefault(frame, {})[view, track.name] = pixel
    return _largest_gap(frames, dict(sorted(seen.items())))


def _largest_gap(frames: FrameTable, seen: Mapping[int, Sightings]) -> str:
    """A sentence about the largest gap, and what to do, from what each frame saw, in order."""
    numbers = {name: [frame for frame in seen if frames.passes[frame] == name] for name in dict.fromkeys(frames.passes)}
    gaps = (gap for of_pass in numbers.values() for gap in _gaps(frames, {frame: seen[frame] for frame in of_pass}))
    largest = max(gaps, default=None)
    return f"{largest[1]}: see whether the video was cut there" if largest else ""


def _gaps(frames: FrameTable, seen: Mapping[int, Sightings]) -> Iterator[tuple[float, str]]:
    """Gaps in a pass, each with how many times as large as usual it is."""
    steps = [_step(frames, *pair) for pair in pairwise(seen.items())]
    if len(steps) < LEAST_STEPS:
        return
    usual_s, usual_px, usual_share = (
        float(np.nanmedian([getattr(step, name) for step in steps])) for name in ("seconds", "moved_px", "shared")
    )
    for step in steps:
        where = f"between frames {step.before} and {step.after} of {frames.passes[step.before]}"
        at = f"{frames.stamps_s[step.before]:.1f} s"
        if step.seconds > JUMP * usual_s:
            yield (
                step.seconds / usual_s,
                f"{step.seconds:.1f} s of frames are missing {where} (at {at}; usual: {usual_s:.2f} s)",
            )
        elif step.moved_px > JUMP * usual_px:
            times = step.moved_px / usual_px
            yield times, f"frames seem to be missing {where} (at {at}): things move {times:.0f} times as far as usual"
        elif FEWER * step.shared < usual_share:
            hardly = "hardly anything" if step.shared else "nothing"
            yield JUMP, f"frames seem to be missing {where} (at {at}): {hardly} is seen in both"


def _step(frames: FrameTable, start: tuple[int, Sightings], end: tuple[int, Sightings]) -> Step:
    (before, first), (after, second) = start, end
    both = [place for place in first if place in second]
    moved = [float(np.hypot(*(second[place] - first[place]))) for place in both]
    middle = float(np.median(moved)) if len(moved) >= LEAST_SHARED else float("nan")
    shared = len(both) / max(min(len(first), len(second)), 1)
    return Step(before, after, float(frames.stamps_s[after] - frames.stamps_s[before]), shared, middle)
