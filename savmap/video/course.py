"""What speaks against a pass by how the camera went: there and back, cuts, missing frames, turns, and a face on the
wrong hand."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from savmap.types import Bools, Floats, MapWarning, array_record
from savmap.video.motion import Steps, wrapped

LEAST_RATE = 1.5
LEAST_STEPS = 8
BROKEN_SHARE, BROKEN, LEAST_LIKENESS = 0.62, 0.5, 0.25
GAP_STEPS, GAP_DEG = 3.5, 60.0
BACK_PACE, BACK_STEPS, BACK_DEG, BACK_SHARE = 0.2, 3, 20.0, 0.25
ONE_WAY = 0.5
TURNED_DEG, ASTRAY_DEG, ASTRAY_PACE, ASTRAY_MISFIT = 45.0, 50.0, 0.4, 0.25
STILL_PACE, STILL_SHARE, PAUSE_STEPS = 0.05, 0.5, 5
HANDS = {"left": 1, "right": -1}
CUTS_GAP = 6
SPLIT = "give each straight drive as a pass of its own (start_s, end_s; `savmap split` finds them)"


@dataclass(frozen=True, eq=False)
@array_record
class Course:
    """The `steps` of a pass along a face whose +x lay `way_deg` to the right of the panorama's centre at first; None:
    not known."""

    steps: Steps
    way_deg: float | None

    @cached_property
    def broken(self) -> Bools:
        """The steps (n,) whose two pictures have little in common."""
        usual = float(np.median(self.steps.likeness))
        limit = min(BROKEN, BROKEN_SHARE * usual) if usual > LEAST_LIKENESS else 0.0
        return np.asarray(self.steps.likeness < limit)

    @cached_property
    def heading_deg(self) -> Floats:
        """How far the rig has turned to the right (n,) since the first frame; what a break seems to turn is nothing."""
        turned = np.array([motion.turn for motion in self.steps.motions]) * self.steps.spans_s
        turned[self.broken] = 0.0
        return np.asarray(np.cumsum(turned) - turned / 2)

    @cached_property
    def pace(self) -> Floats:
        """Deg/s (n,) towards the face's +x; 0 at breaks, and where the way is not known."""
        if self.way_deg is None:
            return np.zeros(len(self.broken))
        return np.where(self.broken, 0.0, self.steps.pace(self.way_deg))

    @cached_property
    def swept(self) -> Floats:
        """By how many degrees what is abeam passes in each step (n,)."""
        return np.asarray(self.pace * self.steps.spans_s)

    @cached_property
    def usual(self) -> float:
        """The usual pace, deg/s, while the camera moves."""
        moving = np.abs(self.pace)[np.abs(self.pace) > LEAST_RATE]
        return float(np.median(moving)) if len(moving) else 0.0

    @property
    def towards(self) -> int:
        """+1 where most of the course goes towards the face's +x, -1 where it goes away from it; 0 where that is not
        clear."""
        whole = float(np.abs(self.swept).sum())
        return int(np.sign(self.swept.sum())) if abs(self.swept.sum()) > ONE_WAY * whole > 0 else 0

    def seconds(self, step: int) -> str:
        """The time in the video at which a step begins."""
        return f"{self.steps.stamps_s[step]:.1f} s"


def contradiction(course: Course, side: str | None) -> str:
    """Why a pass cannot be mapped as it was asked for, and what to do; "" where nothing is known against it."""
    if len(course.broken) < LEAST_STEPS:
        return ""
    backwards = _back(course)
    back, forth = sum(-swept for _, swept in backwards), float(np.abs(course.swept).sum())
    if backwards and back > BACK_SHARE * (forth - back):
        return f"{_turning(course, backwards[0][0])}: {SPLIT}"
    wanted = HANDS.get(side or "", 0)
    if wanted and course.towards and course.towards != wanted:
        fix = "correct the side, or give the view's angles"
        return f"the face that was looked at is not on the {side} as one drives along: {fix}"
    return ""


def warnings(course: Course) -> Iterator[MapWarning]:
    """What speaks against a map of the pass, without making it impossible."""
    if len(course.broken) < LEAST_STEPS:
        return
    yield from _breaks(course)
    if course.usual <= 0:
        return
    for step, swept in _back(course):
        figure, details = f"at {course.seconds(step)}", (f"{_turning(course, step)}, by {-swept:.0f} degrees",)
        yield MapWarning("camera-motion", figure=figure, details=details, size=-swept)
    yield from _turns(course)
    yield from _stands(course)


def _breaks(course: Course) -> Iterator[MapWarning]:
    """Missing frames, and cuts: those soon after one another as one, of a camera in somebody's hands, or covered."""
    spans = course.steps.spans_s
    long = spans > GAP_STEPS * float(np.median(spans))
    far = spans * course.usual > GAP_DEG
    missing = long & (course.broken | far)
    for step in np.flatnonzero(missing).tolist():
        span = float(spans[step])
        yield MapWarning("missing-frames", (), _span(course, step, step), details=("frames are missing",), size=span)
    cuts = np.flatnonzero(course.broken & ~missing)
    for group in np.split(cuts, np.flatnonzero(np.diff(cuts) > CUTS_GAP) + 1) if len(cuts) else ():
        first, last = int(group[0]), int(group[-1])
        if first == last:
            figure, line = f"at {course.seconds(first + 1)}", "the picture changes all at once"
            yield MapWarning("missing-frames", figure=figure, details=(f"{line}: a cut to another place",))
        else:
            line = "the picture changes again and again, as of a camera that is carried or covered"
            how = line, *_without(course, first, last)
            yield MapWarning("missing-frames", figure=_span(course, first, last), details=how)


def _span(course: Course, first: int, last: int) -> str:
    return f"from {course.seconds(first)} to {course.seconds(last + 1)}"


def _without(course: Course, first: int, last: int) -> Iterator[str]:
    """How to leave out steps that begin or end the pass; nothing where they lie amid it, or are all of it."""
    begins, ends = first <= CUTS_GAP, last >= len(course.broken) - 1 - CUTS_GAP
    if begins and not ends:
        yield f"begin the pass after that (`start_s`), at {course.seconds(last + 1)} or later"
    if ends and not begins:
        yield f"end the pass before that (`end_s`), at {course.seconds(first)} or earlier"


def _back(course: Course) -> list[tuple[int, float]]:
    """Runs of steps against the way of most, or of the first half: the first step, and how far, negative degrees."""
    most = course.towards or int(np.sign(course.swept[: len(course.swept) // 2].sum())) or 1
    against = most * course.pace < -max(BACK_PACE * course.usual, LEAST_RATE)
    runs = [(first, float(most * course.swept[first : last + 1].sum())) for first, last in _runs(against, BACK_STEPS)]
    return [(first, swept) for first, swept in runs if swept < -BACK_DEG]


def _turning(course: Course, step: int) -> str:
    """In words, how the camera begins to go back at a step."""
    cut = course.broken[max(step - 2, 0) : step + 1].any()
    before = "after a cut, or missing frames, " if cut else ""
    return f"{before}the camera goes back the way it came at {course.seconds(step)}"


def _turns(course: Course) -> Iterator[MapWarning]:
    """Where the rig turns so far that the views leave the face, or the camera leaves the row, with the step amid it."""
    turned = np.abs(course.heading_deg - float(np.median(course.heading_deg))) > TURNED_DEG
    for first, last in _runs(turned, BACK_STEPS)[:1]:
        details = ("the camera is turned away from the row", *_without(course, first, last))
        yield MapWarning("camera-motion", (), _span(course, first, last), None, (first + last + 1) // 2, details)
    for first, last in _runs(_astray(course), BACK_STEPS)[:1]:
        details = ("the camera leaves the row's direction", *_without(course, first, last))
        yield MapWarning("camera-motion", (), _span(course, first, last), None, (first + last + 1) // 2, details)


def _astray(course: Course) -> Bools:
    """The steps (n,) that clearly go across the row."""
    motions = course.steps.motions
    paces = np.array([sum(motion.sides) / 2 for motion in motions])
    clear = np.array([motion.misfit for motion in motions]) < ASTRAY_MISFIT * paces
    away = np.abs(
        wrapped(np.array([motion.way for motion in motions]) + course.steps.heading_deg - (course.way_deg or 0.0))
    )
    astray: Bools = clear & (paces > ASTRAY_PACE * course.usual) & (away > ASTRAY_DEG) & (away < 180 - ASTRAY_DEG)
    return astray & ~course.broken


def _stands(course: Course) -> Iterator[MapWarning]:
    """A camera that stands for most of the pass: one place then outweighs all others."""
    still = (np.abs(course.pace) < max(STILL_PACE * course.usual, LEAST_RATE / 2)) & ~course.broken
    pauses = _runs(still, PAUSE_STEPS)
    stood = sum(float(course.steps.spans_s[first : last + 1].sum()) for first, last in pauses)
    if stood > STILL_SHARE * float(course.steps.spans_s.sum()):
        first = max(pauses, key=lambda run: run[1] - run[0])[0]
        line = (
            f"the camera stands most of the pass: leave that out (`start_s`, `end_s`), first at {course.seconds(first)}"
        )
        yield MapWarning("camera-motion", figure=f"{stood:.0f} s", details=(line,), size=stood)


def _runs(flags: Bools, least: int) -> list[tuple[int, int]]:
    """First and last index of each run of at least so many true flags (n,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return [(int(a), int(b) - 1) for a, b in edges.reshape(-1, 2) if b - a >= least]
