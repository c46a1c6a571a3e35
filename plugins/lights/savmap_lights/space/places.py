"""Places of ends and centres along a line of lamps: where marks of many frames agree."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from savmap.plugin import UPWARDS, Floats, Ints, RowFacts, Trajectory, frames_showing
from savmap.vision import peaks
from savmap_lights.space.line import LEAST_FRAMES, Marks

SAME_END_M = 0.12
SAME_LAMP_M = 0.3
LEAST_SHARE, LEAST_SHOWN = 0.45, 0.3
JOINT_M = 0.15


@dataclass(frozen=True, eq=False)
class Place:
    """An end or a centre: where it is along x at the lamps' level, which way its lamp ends there, and its marks (indices);
    how far along x its lamp was seen, where that has no other end in sight."""

    x: float
    outward: tuple[int, int]
    marks: Ints
    seen_to: float | None = None


Lamp = dict[str, Place]
"""A lamp's places by their names: "end 0" and "end 1", one of these, or "centre"."""


@dataclass(frozen=True, eq=False)
class Aisle:
    """What was seen of a line of lamps: its marks, height and z, m, the stretches (n, 2) of x that are lit, places (k, 2) x and z of
    glimpses of what is partly hidden, and their frames (k,)."""

    marks: Marks
    level_m: float
    line_z: float
    lit: Floats
    glimpses: Floats
    glimpsed: Ints
    facts: RowFacts
    path: Trajectory


def places_of(aisle: Aisle, outward: tuple[int, int]) -> list[Place]:
    """Where marks that point the same way agree, in most of the frames between the first and the last that show them."""
    marks = aisle.marks
    own = np.flatnonzero((marks.outward == np.array(outward)).all(axis=1))
    x = marks.seen.at(aisle.level_m)[own, 0]
    width = SAME_LAMP_M if outward == (0, 0) else SAME_END_M
    found = []
    for at in peaks.peaks(x, width, LEAST_FRAMES):
        chosen = own[np.abs(x - at) <= width]
        if _is_steady(aisle, chosen, float(at)):
            found.append(Place(float(at), outward, _one_a_frame(marks, chosen, aisle.level_m, float(at))))
    return found


def shown(places: Sequence[Place], joined: Sequence[Place], aisle: Aisle) -> list[Place]:
    """The places that enough of all frames show that could. A joint, where a place of `joined` is near, shows from below only."""
    points = np.array([[place.x, aisle.level_m, aisle.line_z] for place in places]).reshape(-1, 3)
    could = frames_showing(points, aisle.facts, aisle.path, UPWARDS[:, 2])
    counts = [len(_frames_of(aisle, place.marks, place.x)) for place in places]
    return [
        place
        for place, frames, all_frames in zip(places, counts, could.tolist(), strict=True)
        if frames >= LEAST_SHOWN * all_frames or any(abs(place.x - other.x) < JOINT_M for other in joined)
    ]


def _frames_of(aisle: Aisle, chosen: Ints, x: float) -> Ints:
    """The frames of some marks, or that have a glimpse at their place."""
    glimpses = (np.abs(aisle.glimpses - np.array([x, aisle.line_z])) <= SAME_LAMP_M).all(axis=1)
    return np.union1d(aisle.marks.seen.frames[chosen], aisle.glimpsed[glimpses])


def _one_a_frame(marks: Marks, chosen: Ints, level_m: float, x: float) -> Ints:
    """Of several marks in one frame the nearest to a place."""
    away = np.abs(marks.seen.at(level_m)[chosen, 0] - x)
    order = np.lexsort((away, marks.seen.frames[chosen]))
    _, first = np.unique(marks.seen.frames[chosen][order], return_index=True)
    return np.asarray(chosen[order][first])


def _is_steady(aisle: Aisle, chosen: Ints, x: float) -> bool:
    """Whether enough frames show a place, of those whose view was rendered and that passed between the outermost that measured it."""
    seen, facts = aisle.marks.seen, aisle.facts
    measured = seen.frames[chosen]
    frames = _frames_of(aisle, chosen, x)
    frames = frames[(frames >= measured.min()) & (frames <= measured.max())]
    passing = aisle.path.frames[(aisle.path.frames >= frames[0]) & (aisle.path.frames <= frames[-1])].tolist()
    views = {seen.features[index].view for index in chosen.tolist()}
    rendered = [
        any(facts.views[view].shows(frame) and view.startswith(facts.frames.passes[frame]) for view in views)
        for frame in passing
    ]
    return len(frames) >= LEAST_SHARE * sum(rendered)
