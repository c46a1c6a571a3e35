"""Places of ends and centres along a line of lamps, at which marks of many frames agree."""

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
    """An end or a centre: x, m, at the lamps' level; the direction in which its lamp ends there; and the indices of its
    marks. `seen_to`: x to which its lamp was seen, where no other end is in sight."""

    x: float
    outward: tuple[int, int]
    marks: Ints
    seen_to: float | None = None


Lamp = dict[str, Place]
"""A lamp's places by their names: "end 0" and "end 1", one of these, or "centre"."""


@dataclass(frozen=True, eq=False)
class Aisle:
    """A line of lamps: its marks, height and z, m; the stretches (n, 2) of x that are lit; glimpses (k, 2), x and z m,
    of partly hidden lamps; and the glimpses' frames (k,)."""

    marks: Marks
    level_m: float
    line_z: float
    lit: Floats
    glimpses: Floats
    glimpsed: Ints
    facts: RowFacts
    path: Trajectory


def places_of(aisle: Aisle, outward: tuple[int, int]) -> list[Place]:
    """Places at which marks of one outward direction agree, in enough of the frames between the first and the last that
    show them."""
    marks = aisle.marks
    indices = np.flatnonzero((marks.outward == np.array(outward)).all(axis=1))
    x = marks.sightings.at(aisle.level_m)[indices, 0]
    width = SAME_LAMP_M if outward == (0, 0) else SAME_END_M
    places = []
    for peak in peaks.peaks(x, width, LEAST_FRAMES):
        chosen = indices[np.abs(x - peak) <= width]
        if _is_steady(aisle, chosen, float(peak)):
            places.append(Place(float(peak), outward, _nearest_per_frame(marks, chosen, aisle.level_m, float(peak))))
    return places


def shown(places: Sequence[Place], joined: Sequence[Place], aisle: Aisle) -> list[Place]:
    """The places that are seen in enough of the frames that could show them. A joint, near a place of `joined`, shows
    from below only."""
    points = np.array([[place.x, aisle.level_m, aisle.line_z] for place in places]).reshape(-1, 3)
    frames_in_view = frames_showing(points, aisle.facts, aisle.path, UPWARDS[:, 2])
    counts = [len(_frames_of(aisle, place.marks, place.x)) for place in places]
    return [
        place
        for place, frames, all_frames in zip(places, counts, frames_in_view.tolist(), strict=True)
        if frames >= LEAST_SHOWN * all_frames or any(abs(place.x - other.x) < JOINT_M for other in joined)
    ]


def _frames_of(aisle: Aisle, chosen: Ints, x: float) -> Ints:
    """The frames of the chosen marks, and those with a glimpse at their place."""
    glimpses = (np.abs(aisle.glimpses - np.array([x, aisle.line_z])) <= SAME_LAMP_M).all(axis=1)
    return np.union1d(aisle.marks.sightings.frames[chosen], aisle.glimpsed[glimpses])


def _nearest_per_frame(marks: Marks, chosen: Ints, level_m: float, x: float) -> Ints:
    """Of the chosen marks in each frame, the index of the one nearest to x."""
    away = np.abs(marks.sightings.at(level_m)[chosen, 0] - x)
    order = np.lexsort((away, marks.sightings.frames[chosen]))
    _, first = np.unique(marks.sightings.frames[chosen][order], return_index=True)
    return np.asarray(chosen[order][first])


def _is_steady(aisle: Aisle, chosen: Ints, x: float) -> bool:
    """Whether a place is seen in enough of the frames with a rendered view, between the first and the last frame that
    measured it."""
    sightings, facts = aisle.marks.sightings, aisle.facts
    measured = sightings.frames[chosen]
    frames = _frames_of(aisle, chosen, x)
    frames = frames[(frames >= measured.min()) & (frames <= measured.max())]
    passing = aisle.path.frames[(aisle.path.frames >= frames[0]) & (aisle.path.frames <= frames[-1])].tolist()
    views = {sightings.features[index].view for index in chosen.tolist()}
    rendered = [
        any(facts.views[view].shows(frame) and view.startswith(facts.frames.passes[frame]) for view in views)
        for frame in passing
    ]
    return len(frames) >= LEAST_SHARE * sum(rendered)
