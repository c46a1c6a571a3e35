"""Outlines through the sequence: put on the floor from the camera's first path, grouped by place, and fitted as pallets."""

from collections import defaultdict
from collections.abc import Iterator, Sequence

import numpy as np
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from savmap.errors import StructureError
from savmap.types import Feature, Floats, RowFacts, Track, Trajectory
from savmap_pallets.features import SIGMA_PX, WHOLE
from savmap_pallets.fitting import Sighting, cameras, fitted, off_px, poses_of, spread
from savmap_pallets.outline import Camera

LEAST_POINTS = 8
LEAST_SIGHTINGS = 3
SAME_M = 0.2
GATE_PX = 3.0
LEAST_FIT = 0.6
BEHIND_M = 0.6
TOO_LARGE, TOO_SMALL = 1.25, 0.7


def track_pallets(features: Sequence[Feature], facts: RowFacts, start: Trajectory, size: Floats) -> list[Track]:
    """A track "pallet k" for each pallet between the camera's path and the face, numbered along x: all points on its outlines that
    fit a cuboid of `size` (3,). Raises StructureError where there is none."""
    sightings = list(_sightings(features, start))
    seen_by = cameras(sightings, facts, start)
    found: list[tuple[Floats, list[Sighting]]] = []
    for middle in _middles(sightings, seen_by, size):
        own = [
            k
            for k, (seen, camera) in enumerate(zip(sightings, seen_by, strict=True))
            if _near(seen, camera, middle, size)
        ]
        fit = _fit([sightings[k] for k in own], [seen_by[k] for k in own], size, middle)
        if fit is not None and all(np.hypot(*(fit[0] - other)[:2]) > size[2] / 2 for other, _ in found):
            found.append(fit)
    if not found:
        raise StructureError("no pallet was seen whole in three frames or more: does the floor view show any?")
    ordered = sorted(found, key=lambda one: float(one[0][0]))
    return [_track(number, kept) for number, (_, kept) in enumerate(ordered, start=1)]


def _sightings(features: Sequence[Feature], start: Trajectory) -> Iterator[Sighting]:
    known = poses_of(start)
    groups: dict[tuple[int, str, int], list[Feature]] = defaultdict(list)
    for one in features:
        if one.frame in known:
            groups[one.frame, one.view, one.instance].append(one)
    for (frame, view, _), own in groups.items():
        if len(own) >= LEAST_POINTS:
            yield Sighting(frame, view, np.concatenate([one.pixels for one in own]), own[0].part == WHOLE)


def _middles(sightings: Sequence[Sighting], seen_by: Sequence[Camera], size: Floats) -> list[Floats]:
    """Where things of a pallet's extent are seen whole: places (x, y), those seen most often first."""
    places = []
    for seen, camera in zip(sightings, seen_by, strict=True):
        floor = spread(seen, camera, size[1] / 2)
        if seen.whole and not np.isnan(floor).any() and _fits(floor, size):
            middle = (floor.min(axis=0) + floor.max(axis=0)) / 2
            if -BEHIND_M < middle[1] < camera.world_from_rig[2, 3]:
                places.append([middle[0], -middle[1]])
    if not places:
        return []
    points = np.array(places)
    _, group = connected_components(KDTree(points).sparse_distance_matrix(KDTree(points), SAME_M), directed=False)
    sizes = np.bincount(group)
    return [np.median(points[group == k], axis=0) for k in np.argsort(-sizes) if sizes[k] >= LEAST_SIGHTINGS]


def _fits(floor: Floats, size: Floats) -> bool:
    """Whether the largest extent of points (n, 2) on the floor is about a pallet's diagonal or length."""
    extent = max(float(np.ptp(floor @ np.array([np.cos(a), np.sin(a)]))) for a in np.radians([0, 30, 60, 90, 120, 150]))
    return TOO_SMALL * float(size[0]) < extent < TOO_LARGE * float(np.hypot(size[0], size[2]))


def _near(seen: Sighting, camera: Camera, middle: Floats, size: Floats) -> bool:
    """Whether an outline, whole or cut, lies about a place and no further than a pallet reaches."""
    floor = spread(seen, camera, size[1] / 2)
    away = np.hypot(floor[:, 0] - middle[0], floor[:, 1] + middle[1])
    return not np.isnan(away).any() and float(away.max()) < TOO_LARGE * float(np.hypot(size[0], size[2])) / 2 + SAME_M


def _fit(
    sightings: Sequence[Sighting], seen_by: Sequence[Camera], size: Floats, middle: Floats
) -> tuple[Floats, list[Sighting]] | None:
    """The pose, and what of the outlines fits it; None for what is no pallet."""
    if len(sightings) < LEAST_SIGHTINGS:
        return None
    pose = fitted(sightings, seen_by, size, middle)
    kept = []
    for seen, off in zip(sightings, off_px(sightings, seen_by, size, pose), strict=True):
        good = np.abs(off) < GATE_PX
        if good.mean() >= LEAST_FIT and good.sum() >= LEAST_POINTS:
            kept.append(Sighting(seen.frame, seen.view, seen.pixels[good], seen.whole))
    return (pose, kept) if len(kept) >= max(LEAST_SIGHTINGS, LEAST_FIT * len(sightings)) else None


def _track(number: int, kept: Sequence[Sighting]) -> Track:
    counts = [len(seen.pixels) for seen in kept]
    return Track(
        name=f"pallet {number}",
        label="pallet",
        place={"pallet": number},
        frames=np.repeat(np.array([seen.frame for seen in kept], np.int64), counts),
        views=tuple(seen.view for seen, count in zip(kept, counts, strict=True) for _ in range(count)),
        pixels=np.concatenate([seen.pixels for seen in kept]),
        covariances=np.tile(SIGMA_PX**2 * np.eye(2), (sum(counts), 1, 1)),
    )


def sightings_of(track: Track) -> list[Sighting]:
    """A track's outlines again, frame by frame and view by view."""
    groups: dict[tuple[int, str], list[int]] = defaultdict(list)
    for index, key in enumerate(zip(track.frames.tolist(), track.views, strict=True)):
        groups[key].append(index)
    return [Sighting(frame, view, track.pixels[own], True) for (frame, view), own in groups.items()]
