"""Lamps through the sequence: a search in space, for the camera's path is known from what was tracked before.

A sweep through heights finds the plane of the lamps (paper, section III.D). There, ends that point the same way and fall on one another
in many frames are ends; what hides a lamp for some frames, or a mask that ends in its midst, falls on nothing.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from savmap.plugin import (
    Feature,
    Floats,
    Ints,
    RowFacts,
    Track,
    Trajectory,
    project,
    sightings,
    track_of,
)
from savmap.vision import peaks
from savmap_lights.space.ends import Fitted, Rays, fit
from savmap_lights.space.line import LEAST_FRAMES, SAME_LINE_M, Marks, level_of, line_of, marks_of, no_lamp

Mask = NDArray[np.bool_]

MAX_SLOPE = 3.0
SAME_END_M = 0.12
SAME_LAMP_M = 0.3
LEAST_SHARE = 0.45
LEAST_SEEN = 4
MIDDLES = 2
SHORTEST_M = 0.1
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
    marks = marks.where(np.abs(marks.aside(level) - line) <= SAME_LINE_M)
    middles = seen.where(seen.of_part("middle")).at(level)
    middles = middles[np.abs(middles[:, 1] - line) <= SAME_LINE_M, 0]
    lamps = lamps_of(marks, level, middles, facts, start)
    if not lamps:
        raise no_lamp()
    return _tracks(lamps, marks, level, line, facts, start)


def lamps_of(marks: Marks, level_m: float, middles: Floats, facts: RowFacts, path: Trajectory) -> list[Lamp]:
    """The lamps of a line by the kind that most marks are of: strips along it, strips across it, or compact lamps."""
    outward = marks.outward
    counts = [
        int((outward[:, 0] != 0).sum()),
        int((outward[:, 1] != 0).sum()),
        2 * int((outward == 0).all(axis=1).sum()),
    ]
    kind = int(np.argmax(counts))
    if kind == 0:
        return _along(*(_places(marks, level_m, (sign, 0), path, facts) for sign in (-1, 1)), middles)
    if kind == 1:
        return _across(*(_places(marks, level_m, (0, sign), path, facts) for sign in (-1, 1)))
    return [{"centre": place} for place in _places(marks, level_m, (0, 0), path, facts)]


def _places(marks: Marks, level_m: float, outward: tuple[int, int], path: Trajectory, facts: RowFacts) -> list[Place]:
    """Where marks that point the same way agree, in most of the frames that look at it from where some do."""
    own = np.flatnonzero((marks.outward == np.array(outward)).all(axis=1))
    x = marks.seen.at(level_m)[own, 0]
    width = SAME_LAMP_M if outward == (0, 0) else SAME_END_M
    found = []
    for at in peaks.peaks(x, width, LEAST_FRAMES):
        chosen = own[np.abs(x - at) <= width]
        if _is_steady(marks, chosen, path, facts):
            found.append(Place(float(at), outward, _one_a_frame(marks, chosen, level_m, float(at))))
    return found


def _one_a_frame(marks: Marks, chosen: Ints, level_m: float, x: float) -> Ints:
    """Of several marks in one frame the nearest to a place."""
    away = np.abs(marks.seen.at(level_m)[chosen, 0] - x)
    order = np.lexsort((away, marks.seen.frames[chosen]))
    _, first = np.unique(marks.seen.frames[chosen][order], return_index=True)
    return np.asarray(chosen[order][first])


def _is_steady(marks: Marks, chosen: Ints, path: Trajectory, facts: RowFacts) -> bool:
    """Whether enough frames see a place, of those whose view was rendered and that passed between the outermost that do."""
    frames = np.unique(marks.seen.frames[chosen])
    views = {marks.seen.features[index].view for index in chosen.tolist()}
    passes = facts.frames.passes
    between = 0
    for view in views:
        own = [frame for frame in frames.tolist() if view.startswith(passes[frame])]
        between += sum(
            facts.views[view].shows(frame) and own[0] <= frame <= own[-1] and view.startswith(passes[frame])
            for frame in path.frames.tolist()
            if own
        )
    return len(frames) >= LEAST_FRAMES and len(frames) >= LEAST_SHARE * between


def _along(starts: Sequence[Place], stops: Sequence[Place], middles: Floats) -> list[Lamp]:
    """Strips along the line: each start with the next stop, before the next start, where something lit was seen between them. What
    is lit beside a start or a stop that has no partner is a strip with one end in sight."""
    lamps: list[Lamp] = []
    ends = sorted([*starts, *stops], key=lambda place: place.x - place.outward[0] * SHORTEST_M / 4)
    for number, here in enumerate(ends):
        before = ends[number - 1] if number else None
        after = ends[number + 1] if number + 1 < len(ends) else None
        if here.outward[0] < 0 and after is not None and after.outward[0] > 0:
            if ((middles > here.x) & (middles < after.x)).sum() >= MIDDLES and after.x - here.x >= SHORTEST_M:
                lamps.append({"end 0": here, "end 1": after})
        elif here.outward[0] < 0:
            lamps += _open(here, "end 0", middles[(middles > here.x) & (middles < (after.x if after else np.inf))])
        elif before is None or before.outward[0] > 0:
            lamps += _open(here, "end 1", middles[(middles < here.x) & (middles > (before.x if before else -np.inf))])
    return lamps


def _open(place: Place, part: str, lit: Floats) -> list[Lamp]:
    """A strip of which one end is in sight, as far as it was seen."""
    lit = np.sort(lit)
    if len(lit) < LEAST_SEEN:
        return []
    furthest = lit[-MIDDLES] if place.outward[0] < 0 else lit[MIDDLES - 1]
    return [{part: replace(place, seen_to=float(furthest))}] if abs(furthest - place.x) > SHORTEST_M else []


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
        if len(own) < LEAST_FRAMES:
            continue
        features = [
            _at_middle(marks.seen.features[index[k]], fitted, rays, int(k), line_z, poses, facts) for k in own.tolist()
        ]
        track = track_of(lamp + 1, part, features)
        known = place.seen_to is None
        tracks.append(track if known else replace(track, place={**track.place, SEEN_TO: round(1000 * place.seen_to)}))
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
    sigma = pixels / focal * above * (1 + slope**2 + seen.slopes[index, 1] ** 2)
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
