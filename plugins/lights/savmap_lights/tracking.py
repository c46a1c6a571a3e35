"""Lamps through the sequence: a search in space, for the camera's path is known from what was tracked before.

A sweep through heights finds the plane of the lamps (paper, section III.D). There, ends that point the same way and
fall on one another in many frames are ends; what hides a lamp for some frames, or a mask that ends in its midst, falls
on nothing.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from savmap.plugin import Feature, Floats, Ints, RowFacts, Track, Trajectory, project, sightings, track_of
from savmap_lights.features import is_by_mask
from savmap_lights.space.ends import Fitted, Rays, fit
from savmap_lights.space.lamps import lamps_of, lit_stretches
from savmap_lights.space.line import LEAST_FRAMES, SAME_LINE_M, Marks, level_of, line_of, marks_of, no_lamp
from savmap_lights.space.partial import completed
from savmap_lights.space.places import Aisle, Lamp, Place
from savmap_lights.space.scatter import scatter
from savmap_lights.space.ties import point_of
from savmap_lights.space.unmapped import Light, lights_beside, shining

MAX_SLOPE = 3.0
LEAST_FITTING, MOST_FIT = 2, 0.5
OTHER_PLANE_M, SURELY_OFF = 0.3, 5.0
PATH_M = 0.007
SEEN_TO, BESIDE = "seen to, mm", "light beside, mm"
BY_MASK, MOSTLY = "measured in masks alone, %", 0.75


def track_lamps(features: Sequence[Feature], facts: RowFacts, start: Trajectory) -> list[Track]:
    """Tracks "light 3 / end 0" and "light 3 / end 1" (towards +x, or, of strips across the aisle, +z) of strips, "light
    3 / centre" of compact lamps. The pixels of strips' ends are those of their middle height.

    Lamps are those of the line nearest above the camera's path, numbered along x from 1.
    Raises StructureError when no lamp is seen in at least three frames.
    """
    observed = sightings(features, facts, start, upwards=True, max_slope=MAX_SLOPE)
    marks = marks_of(observed)
    if len(np.unique(marks.sightings.frames)) < LEAST_FRAMES:
        raise no_lamp()
    level = level_of(marks)
    line = line_of(marks, level)
    observed = sightings(completed(features, observed, level, line), facts, start, upwards=True, max_slope=MAX_SLOPE)
    marks = marks_of(observed)
    marks = marks.where(np.abs(marks.sideways(level) - line) <= SAME_LINE_M)
    glimpses = observed.where(observed.of_part("glimpse"))
    lit = lit_stretches(observed.where(observed.of_part("middle")), level, line, facts)
    lamps = lamps_of(Aisle(marks, level, line, lit, glimpses.at(level), glimpses.frames, facts, start))
    if not lamps:
        raise no_lamp()
    tracks = _tracks(lamps, marks, level, line, facts, start)
    complete = _complete(tracks, lamps)
    mapped = [lamps[number - 1] for number in complete]
    return _numbered(tracks, complete, mapped, shining(observed, level, line, mapped))


def _tracks(
    lamps: Sequence[Lamp], marks: Marks, level_m: float, line_z: float, facts: RowFacts, path: Trajectory
) -> list[Track]:
    """The lamps' tracks, of the marks that fit, moved to the lamps' middle height."""
    named = [(number, part, place) for number, lamp in enumerate(lamps) for part, place in lamp.items()]
    rays, index = _rays(named, marks, level_m, facts)
    fitted = fit(rays, level_m)
    across_m = (
        marks.sightings.origins[index, 2] + (fitted.heights[rays.lamp] - rays.height) * marks.sightings.slopes[index, 1]
    )
    agree, wider = scatter(across_m, rays.sigma, rays.place, fitted.kept)
    poses = dict(zip(path.frames.tolist(), path.world_from_rig, strict=True))
    tracks = []
    for number, (lamp, part, place) in enumerate(named):
        agreeing = np.flatnonzero((rays.place == number) & agree)
        fits = len(agreeing) >= MOST_FIT * (rays.place == number).sum()
        if len(agreeing) < LEAST_FITTING or not fits:
            continue
        features = [
            _at_middle(_widened(marks.sightings.features[index[k]], wider[k]), fitted, rays, k, line_z, poses, facts)
            for k in agreeing.tolist()
        ]
        track = track_of(lamp + 1, part, features)
        if _is_vaguely_off(track, float(fitted.heights[lamp]) - level_m, facts, path):
            continue
        if place.seen_to is not None:
            track = replace(track, place={**track.place, SEEN_TO: round(1000 * place.seen_to)})
        by_mask = float(np.mean([is_by_mask(feature) for feature in features]))
        if part == "centre" and by_mask >= MOSTLY:
            track = replace(track, place={**track.place, BY_MASK: round(100 * by_mask)})
        tracks.append(track)
    return tracks


def _is_vaguely_off(track: Track, off_m: float, facts: RowFacts, path: Trajectory) -> bool:
    """Whether a track seems to be on another plane than the lamps, without its rays being sure of that: no lamp."""
    if abs(off_m) <= OTHER_PLANE_M:
        return False
    _, covariance = point_of(track, facts, path)
    return abs(off_m) < SURELY_OFF * float(np.sqrt(covariance[1, 1]))


def _complete(tracks: Sequence[Track], lamps: Sequence[Lamp]) -> list[int]:
    """The numbers of the lamps that have all their tracks. Raises StructureError where none has."""
    numbers = [int(track.place[track.label]) for track in tracks]
    complete = [n for n in dict.fromkeys(numbers) if numbers.count(n) == len(lamps[n - 1])]
    if not complete:
        raise no_lamp()
    return complete


def _numbered(
    tracks: Sequence[Track], complete: Sequence[int], lamps: Sequence[Lamp], lights: Sequence[Light]
) -> list[Track]:
    """The tracks of the lamps that are complete, numbered anew, each with the place of light beside it that may be a
    lamp too."""
    of_lamp = [[track for track in tracks if track.place[track.label] == number] for number in complete]
    x_of_light = lights_beside(lamps, [max(len(track.frames) for track in group) for group in of_lamp], lights)
    numbered = []
    for index, group in enumerate(of_lamp):
        light = {BESIDE: round(1000 * x_of_light[index])} if index in x_of_light else {}
        for track in group:
            name = f"{track.label} {index + 1} / {track.place['part']}"
            numbered.append(replace(track, name=name, place={**track.place, track.label: index + 1, **light}))
    return numbered


def _rays(named: Sequence[tuple[int, str, Place]], marks: Marks, level_m: float, facts: RowFacts) -> tuple[Rays, Ints]:
    """The rays to all places along x, and the index of each one's mark."""
    observed = marks.sightings
    index = np.concatenate([place.marks for _, _, place in named])
    number = np.concatenate([np.full(len(place.marks), k) for k, (_, _, place) in enumerate(named)])
    lamp = np.concatenate([np.full(len(place.marks), k) for k, _, place in named])
    outward = np.concatenate([np.full(len(place.marks), place.outward[0]) for _, _, place in named])
    slope = observed.slopes[index, 0]
    edge = -outward * np.sign(slope).astype(np.int64)
    focal = np.array([facts.views[observed.features[k].view].camera[0, 0] for k in index.tolist()])
    pixels = np.array([np.sqrt(observed.features[k].covariance[0, 0, 0]) for k in index.tolist()])
    above = level_m - observed.origins[index, 1]
    sigma = np.hypot(PATH_M, pixels / focal * above * (1 + slope**2 + observed.slopes[index, 1] ** 2))
    return Rays(number, lamp, observed.origins[index, 0], observed.origins[index, 1], slope, edge, sigma), index


def _at_middle(
    feature: Feature,
    fitted: Fitted,
    rays: Rays,
    ray: int,
    line_z: float,
    poses: dict[int, Floats],
    facts: RowFacts,
) -> Feature:
    """A feature moved along the line by as much as the edge that is seen lies nearer or further than the lamp's middle
    would."""
    if not rays.edge[ray] or not fitted.half_m:
        return feature
    middle = np.array([fitted.places[rays.place[ray]], fitted.heights[rays.lamp[ray]], line_z])
    edge = middle - np.array([rays.edge[ray] * fitted.half_m * rays.slope[ray], 0.0, 0.0])
    pose, view = poses[feature.frame], facts.views[feature.view]
    turn = pose[:3, :3] @ view.rig_from_view
    points = (np.stack([middle, edge]) - pose[:3, 3]) @ turn
    pixels = project(points, view.camera)
    return replace(feature, pixels=feature.pixels + pixels[0] - pixels[1])


def _widened(feature: Feature, wider: float) -> Feature:
    return replace(feature, covariance=feature.covariance * wider**2)
