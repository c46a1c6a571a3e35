"""Lamps through the sequence: a search in space, for the camera's path is known from what was tracked before.

A sweep through heights finds the plane of the lamps (paper, section III.D). There, ends that point the same way and fall on one another
in many frames are ends; what hides a lamp for some frames, or a mask that ends in its midst, falls on nothing.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from savmap.plugin import (
    UPWARDS,
    Feature,
    Floats,
    Ints,
    RowFacts,
    Sightings,
    Track,
    Trajectory,
    frames_showing,
    project,
    sightings,
    track_of,
)
from savmap.vision import peaks
from savmap_lights.space.ends import Fitted, Rays, fit
from savmap_lights.space.line import LEAST_FRAMES, SAME_LINE_M, Marks, level_of, line_of, marks_of, no_lamp
from savmap_lights.space.partial import completed

Mask = NDArray[np.bool_]

MAX_SLOPE = 3.0
SAME_END_M = 0.12
SAME_LAMP_M = 0.3
LEAST_SHARE, LEAST_SHOWN = 0.45, 0.3
JOINT_M = 0.15
LIT = 0.75
LEAST_OPEN_M = 0.3
SHORTEST_M = 0.1
LEAST_FITTING, MOST_FIT, OTHER_PLANE_M = 2, 0.5, 0.3
PATH_M = 0.007
SEEN_TO = "seen to, mm"


@dataclass(frozen=True, eq=False)
class Place:
    """An end or a centre: where it is along x at the lamps' level, which way its lamp ends there, and its marks (indices);
    how far along x its lamp was seen, where that has no other end in sight."""

    x: float
    outward: tuple[int, int]
    marks: Ints
    seen_to: float | None = None


Lamp = dict[str, Place]


def track_lamps(features: Sequence[Feature], facts: RowFacts, start: Trajectory) -> list[Track]:
    """Tracks "light 3 / end 0" and "light 3 / end 1" (towards +x, or, of strips across the aisle, +z) of strips, "light 3 / centre" of
    compact lamps. The pixels of strips' ends are those of their middle height.

    Lamps are those of the line nearest above the camera's path, numbered along x from 1.
    Raises StructureError when no lamp is seen in at least three frames.
    """
    seen = sightings(features, facts, start, upwards=True, max_slope=MAX_SLOPE)
    marks = marks_of(seen)
    if len(np.unique(marks.seen.frames)) < LEAST_FRAMES:
        raise no_lamp()
    level = level_of(marks)
    line = line_of(marks, level)
    seen = sightings(completed(features, seen, level, line), facts, start, upwards=True, max_slope=MAX_SLOPE)
    marks = marks_of(seen)
    marks = marks.where(np.abs(marks.aside(level) - line) <= SAME_LINE_M)
    glimpses = seen.where(seen.of_part("glimpse"))
    lit = lit_stretches(seen.where(seen.of_part("middle")), level, line, facts)
    lamps = lamps_of(Aisle(marks, level, line, lit, glimpses.at(level), glimpses.frames, facts, start))
    if not lamps:
        raise no_lamp()
    return _tracks(lamps, marks, level, line, facts, start)


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


def lamps_of(aisle: Aisle) -> list[Lamp]:
    """The lamps of a line by the kind that most marks are of: strips along it, strips across it, or compact lamps."""
    outward = aisle.marks.outward
    counts = [(outward[:, 0] != 0).sum(), (outward[:, 1] != 0).sum(), 2 * (outward == 0).all(axis=1).sum()]
    kind = int(np.argmax(counts))
    if kind == 0:
        starts, stops = (_places(aisle, (sign, 0)) for sign in (-1, 1))
        return _along(_shown(starts, stops, aisle), _shown(stops, starts, aisle), aisle.lit)
    if kind == 1:
        nears, fars = (_places(aisle, (0, sign)) for sign in (-1, 1))
        return _across(_shown(nears, (), aisle), _shown(fars, (), aisle))
    return [{"centre": place} for place in _shown(_places(aisle, (0, 0)), (), aisle)]


def lit_stretches(middles: Sightings, level_m: float, line_z: float, facts: RowFacts) -> Floats:
    """From where to where (n, 2) along x something on the line was seen lit."""
    places = middles.at(level_m)
    above = level_m - middles.origins[:, 1]
    focal = np.array([facts.views[feature.view].camera[0, 0] for feature in middles.features])
    spread = np.array([np.trace(feature.covariance[0]) for feature in middles.features])
    half = np.sqrt(spread) / np.maximum(focal, 1e-9) * above * (1 + np.square(middles.slopes).sum(axis=1))
    own = np.abs(places[:, 1] - line_z) <= SAME_LINE_M
    return np.stack([places[own, 0] - half[own], places[own, 0] + half[own]], axis=1)


def _places(aisle: Aisle, outward: tuple[int, int]) -> list[Place]:
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


def _shown(places: Sequence[Place], joined: Sequence[Place], aisle: Aisle) -> list[Place]:
    """The places that enough of all frames show that could. A joint, where a place of `joined` is near, shows from below only."""
    points = np.array([[place.x, aisle.level_m, aisle.line_z] for place in places]).reshape(-1, 3)
    could = frames_showing(points, aisle.facts, aisle.path, UPWARDS[:, 2])
    shown = [len(_frames_of(aisle, place.marks, place.x)) for place in places]
    return [
        place
        for place, frames, all_frames in zip(places, shown, could.tolist(), strict=True)
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


def _along(starts: Sequence[Place], stops: Sequence[Place], lit: Floats) -> list[Lamp]:
    """Strips along the line: each start with the stop that follows it, where it is lit between them. What is lit beside a start or a stop
    that has no partner is a strip with one end in sight."""
    lamps: list[Lamp] = []
    taken: list[Place] = []
    ends = sorted([*starts, *stops], key=lambda place: place.x - place.outward[0] * SHORTEST_M / 4)
    for here, after in pairwise(ends):
        if here.outward[0] < 0 < after.outward[0] and _is_lit(here.x, after.x, lit):
            lamps.append({"end 0": here, "end 1": after})
            taken += [here, after]
    for number, here in enumerate(ends):
        if not any(here is other for other in taken):
            beyond = [other.x for other in (ends[number + 1 :] if here.outward[0] < 0 else ends[:number])]
            limit = (min if here.outward[0] < 0 else max)(beyond, default=-here.outward[0] * np.inf)
            lamps += _open(here, limit, lit)
    return sorted(lamps, key=lambda lamp: min(place.x for place in lamp.values()))


def _is_lit(start: float, stop: float, lit: Floats) -> bool:
    """Whether most of a stretch was seen lit, at least as long as a strip may be."""
    inside = lit[(lit[:, 0] < stop) & (lit[:, 1] > start)]
    marks = np.linspace(start, stop, 41)[1:-1]
    covered = ((inside[:, :1] <= marks) & (marks <= inside[:, 1:])).any(axis=0)
    return bool(stop - start >= SHORTEST_M and covered.mean() >= LIT)


def _open(place: Place, limit: float, lit: Floats) -> list[Lamp]:
    """A strip of which one end is in sight, as far as it was seen lit without a break, at most to `limit`."""
    way = -place.outward[0]
    reach = 0.0
    stretches = np.sort(way * (lit - place.x), axis=1)
    for low, high in stretches[np.argsort(stretches[:, 0])]:
        if low <= reach + SHORTEST_M and high > reach:
            reach = min(float(high), way * (limit - place.x))
    part = "end 0" if way > 0 else "end 1"
    long = reach > LEAST_OPEN_M
    return [{part: replace(place, seen_to=place.x + way * reach)}] if long else []


def _across(nears: Sequence[Place], fars: Sequence[Place]) -> list[Lamp]:
    """Strips across the line: ends on either side at one place along it."""
    lamps: list[Lamp] = []
    for near in nears:
        beside = [far for far in fars if abs(far.x - near.x) <= SAME_LAMP_M]
        if beside:
            lamps.append({"end 0": near, "end 1": min(beside, key=lambda far: abs(far.x - near.x))})
    return lamps


def _tracks(
    lamps: Sequence[Lamp], marks: Marks, level_m: float, line_z: float, facts: RowFacts, path: Trajectory
) -> list[Track]:
    """The lamps' tracks, of the marks that fit, moved to the lamps' middle height."""
    named = [(number, part, place) for number, lamp in enumerate(lamps) for part, place in lamp.items()]
    rays, index = _rays(named, marks, level_m, facts)
    fitted = fit(rays, level_m)
    poses = dict(zip(path.frames.tolist(), path.world_from_rig, strict=True))
    tracks = []
    for number, (lamp, part, place) in enumerate(named):
        own = np.flatnonzero((rays.place == number) & fitted.kept)
        fits = len(own) >= MOST_FIT * (rays.place == number).sum()
        if len(own) < LEAST_FITTING or not fits or abs(fitted.heights[lamp] - level_m) > OTHER_PLANE_M:
            continue
        features = [
            _at_middle(marks.seen.features[index[k]], fitted, rays, int(k), line_z, poses, facts) for k in own.tolist()
        ]
        track = track_of(lamp + 1, part, features)
        if place.seen_to is not None:
            track = replace(track, place={**track.place, SEEN_TO: round(1000 * place.seen_to)})
        tracks.append(track)
    return _whole(tracks, lamps)


def _whole(tracks: Sequence[Track], lamps: Sequence[Lamp]) -> list[Track]:
    """The tracks of lamps that have all theirs, numbered anew."""
    numbers = [int(track.place[track.label]) for track in tracks]
    complete = [n for n in dict.fromkeys(numbers) if numbers.count(n) == len(lamps[n - 1])]
    if not complete:
        raise no_lamp()
    return [
        replace(
            track,
            name=f"{track.label} {complete.index(n) + 1} / {track.place['part']}",
            place={**track.place, track.label: complete.index(n) + 1},
        )
        for track, n in zip(tracks, numbers, strict=True)
        if n in complete
    ]


def _rays(named: Sequence[tuple[int, str, Place]], marks: Marks, level_m: float, facts: RowFacts) -> tuple[Rays, Ints]:
    """The rays to all places along x, and the index of each one's mark."""
    seen = marks.seen
    index = np.concatenate([place.marks for _, _, place in named])
    number = np.concatenate([np.full(len(place.marks), k) for k, (_, _, place) in enumerate(named)])
    lamp = np.concatenate([np.full(len(place.marks), k) for k, _, place in named])
    outward = np.concatenate([np.full(len(place.marks), place.outward[0]) for _, _, place in named])
    slope = seen.slopes[index, 0]
    edge = -outward * np.sign(slope).astype(np.int64)
    focal = np.array([facts.views[seen.features[k].view].camera[0, 0] for k in index.tolist()])
    pixels = np.array([np.sqrt(seen.features[k].covariance[0, 0, 0]) for k in index.tolist()])
    above = level_m - seen.origins[index, 1]
    sigma = np.hypot(PATH_M, pixels / focal * above * (1 + slope**2 + seen.slopes[index, 1] ** 2))
    return Rays(number, lamp, seen.origins[index, 0], seen.origins[index, 1], slope, edge, sigma), index


def _at_middle(
    feature: Feature,
    fitted: Fitted,
    rays: Rays,
    ray: int,
    line_z: float,
    poses: dict[int, Floats],
    facts: RowFacts,
) -> Feature:
    """A feature moved by as much as the edge that is seen lies above or below the lamp's middle."""
    if not rays.edge[ray] or not fitted.half_m:
        return feature
    middle = np.array([fitted.places[rays.place[ray]], fitted.heights[rays.lamp[ray]], line_z])
    edge = middle + np.array([0.0, rays.edge[ray] * fitted.half_m, 0.0])
    pose, view = poses[feature.frame], facts.views[feature.view]
    turn = pose[:3, :3] @ view.rig_from_view
    points = (np.stack([middle, edge]) - pose[:3, 3]) @ turn
    pixels = project(points, view.camera)
    return replace(feature, pixels=feature.pixels + pixels[0] - pixels[1])
