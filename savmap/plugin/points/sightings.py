"""From points seen in single frames to tracks of objects: rays put on a level plane, and grouped there."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from savmap.errors import StructureError
from savmap.geometry.pinhole import project
from savmap.types import Feature, Floats, Ints, RowFacts, Track, Trajectory
from savmap.vision import peaks

Mask = NDArray[np.bool_]
WITHIN = 0.7  # cosine of 45 degrees
BELOW = (-8.0, -0.3)  # where the floor is looked for, of a path that may be off by any scale
COARSE_STEP, FINE_STEP, FINE_REACH = 1.01, 1.002, 10  # of the levels that are tried, from height to height
COARSE, FINE = 0.012, 0.006  # of the height: how near sightings of one object fall there
NEIGHBOURS = 8
TOO_FLAT = 0.1  # rays nearly along the face say little of a place on it


@dataclass(frozen=True, eq=False)
class Sightings:
    """Points seen above the camera, or below it: the features, their frames (n,), the camera's positions (n, 3) m, and
    the slopes (n, 2) of their rays: metres along x and z for each metre upwards."""

    features: Sequence[Feature]
    frames: Ints
    origins: Floats
    slopes: Floats

    def where(self, keep: Mask) -> "Sightings":
        """Those for which a mask (n,) is true."""
        chosen = [feature for feature, kept in zip(self.features, keep, strict=True) if kept]
        return Sightings(chosen, self.frames[keep], self.origins[keep], self.slopes[keep])

    def at(self, level_m: float) -> Floats:
        """Where the rays meet the plane y = `level_m`: (n, 2) x and z, m."""
        return self.origins[:, [0, 2]] + (level_m - self.origins[:, 1:2]) * self.slopes

    def of_part(self, part: str) -> Mask:
        """Which of them are of a part (n,)."""
        return np.array([feature.part == part for feature in self.features], dtype=bool)

    @property
    def certainty(self) -> Floats:
        """How sure the network was (n,): 0 at a probability of one half, 1 at one."""
        scores = np.array([feature.score for feature in self.features], dtype=np.float64)
        certainty: Floats = np.clip(2 * scores - 1, 0.01, 1) ** 2
        return certainty


def sightings(
    features: Sequence[Feature], facts: RowFacts, path: Trajectory, upwards: bool, max_slope: float
) -> Sightings:
    """The points whose rays rise (or, unless `upwards`, fall) with at most `max_slope` metres aside for each metre;
    frames that are not in the path are left out."""
    world_from_rig = dict(zip(path.frames.tolist(), path.world_from_rig, strict=True))
    kept = [feature for feature in features if feature.frame in world_from_rig]
    poses = np.array([world_from_rig[feature.frame] for feature in kept]).reshape(-1, 4, 4)
    rig_rays = np.array([facts.views[feature.view].rig_rays(feature.pixels[0]) for feature in kept]).reshape(-1, 3)
    rays = np.einsum("nij,nj->ni", poses[:, :3, :3], rig_rays)
    climb = rays[:, 1] if upwards else -rays[:, 1]
    steep = (climb > 0) & (np.hypot(rays[:, 0], rays[:, 2]) < max_slope * climb)
    slopes = rays[:, [0, 2]] / np.where(steep, rays[:, 1], 1.0)[:, None]
    frames = np.array([feature.frame for feature in kept], dtype=np.int64)
    return Sightings(kept, frames, poses[:, :3, 3], slopes).where(steep)


def gathering_level(
    seen: Sightings,
    above_m: tuple[float, float],
    kinds: Ints | None = None,
    allowed: Callable[[float], Mask] | None = None,
) -> float:
    """The level y, m, at which sightings of different frames fall on one another best, searched between two heights
    above the camera (both negative: below it), coarsely, then finely: of objects at one height that is not known.
    Paper, section III.D.

    kinds (n,): only sightings of one kind may be of one object. allowed: which of them (n,) may be objects at a level.
    The tolerance grows with the height that is tried: else the nearest level, where all rays are close, would always
    have the best score.
    """
    base = float(seen.origins[:, 1].mean())
    nearest, furthest = sorted(above_m, key=abs)
    kinds = np.zeros(len(seen.frames), np.int64) if kinds is None else kinds

    def gathering(above: float, width: float) -> float:
        """Gaussian weights of the distances between sightings of one kind in different frames, summed over neighbours
        in x. The sigma is `width` times the height, and twice that along z."""
        places, total = seen.at(base + above), 0.0
        near = np.ones(len(places), np.bool_) if allowed is None else allowed(base + above)
        for kind in np.unique(kinds):
            chosen = np.flatnonzero(near & (kinds == kind))
            chosen = chosen[np.argsort(places[chosen, 0], kind="stable")]
            points, frames, certainty = places[chosen] / (width * above), seen.frames[chosen], seen.certainty[chosen]
            for step in range(1, min(NEIGHBOURS, len(points) - 1) + 1):
                distances = np.square(points[step:] - points[:-step]) @ np.array([1.0, 0.25])
                counts = np.exp(-0.5 * distances) * (frames[step:] != frames[:-step])
                total += float((counts * certainty[step:] * certainty[:-step]).sum())
        return total

    steps = int(np.log(furthest / nearest) / np.log(COARSE_STEP))
    above = nearest * COARSE_STEP ** np.arange(steps)
    best = above[np.argmax([gathering(height, COARSE) for height in above])]
    fine = best * FINE_STEP ** np.arange(-FINE_REACH, FINE_REACH + 1.0)
    return base + float(fine[np.argmax([gathering(height, FINE) for height in fine])])


def frames_showing(
    points: Floats, facts: RowFacts, path: Trajectory, direction: Floats, margin_px: float = 40.0
) -> Ints:
    """In how many frames each of the points (n, 3) m lies inside a view of it, `margin_px` from its border, that looks
    within 45 degrees of a direction (3,) of the row's frame: how often an object that is there could have been seen."""
    count = np.zeros(len(points), dtype=np.int64)
    for frame, pose in zip(path.frames.tolist(), path.world_from_rig, strict=True):
        inside = np.zeros(len(points), dtype=bool)
        for name, spec in facts.views.items():
            along = float((pose[:3, :3] @ spec.rig_from_view)[:, 2] @ direction)
            if along > WITHIN and spec.shows(frame) and name.startswith(facts.frames.passes[frame]):
                in_view = (points - pose[:3, 3]) @ pose[:3, :3] @ spec.rig_from_view
                pixels, size = project(in_view, spec.camera), np.array([spec.width, spec.height]) - 1
                inside |= ((pixels > margin_px) & (pixels < size - margin_px)).all(axis=1) & (in_view[:, 2] > 0)
        count += inside
    return count


def track_of(number: int, part: str, features: Sequence[Feature]) -> Track:
    """The track of one point of object `number`, from the point features that show it."""
    label = features[0].label
    return Track(
        name=f"{label} {number} / {part}",
        label=label,
        place={label: number, "part": part},
        frames=np.array([feature.frame for feature in features], dtype=np.int64),
        views=tuple(feature.view for feature in features),
        pixels=np.concatenate([feature.pixels for feature in features]),
        covariances=np.concatenate([feature.covariance for feature in features]),
    )


def tracks_on_floor(
    features: Sequence[Feature],
    facts: RowFacts,
    path: Trajectory,
    anchor: str,
    same_m: float,
    least_frames: int = 3,
    max_slope: float = 10.0,
    level_known: bool = True,
) -> list[Track]:
    """Tracks of objects that stand on the floor, numbered along x: a track for each part of each object.

    The floor is y = 0. Where nothing but this plugin gives the map's scale or height, the path is not in metres and
    above another level: with `level_known` False the floor is the level at which the rays of different frames meet
    best.

    The rays of the part `anchor` are put on the floor from the camera's path; those that agree in x within `same_m` are
    one object, and the other parts belong to the anchor of their instance. Raises StructureError where none is seen in
    `least_frames` frames.
    """
    feet = sightings([feature for feature in features if feature.part == anchor], facts, path, False, max_slope)
    level_m = 0.0 if level_known or len(feet.frames) < least_frames else gathering_level(feet, BELOW)
    x = feet.at(level_m)[:, 0]
    return _tracks(features, feet.features, x, same_m, least_frames)


def tracks_along_face(
    features: Sequence[Feature],
    facts: RowFacts,
    attitudes: Floats,
    anchor: str,
    same: float = 0.1,
    least_frames: int = 3,
) -> list[Track]:
    """Tracks of objects in one plane, the face, where nothing is known of the camera but its attitudes (n, 3, 3),
    world_from_rig: for the plugin that locates the camera. Numbered along x, a track for each part of each object.

    Lengths are in units of the camera's distance from the face, which is not known and must change little. Between two
    frames all anchors move by one step; the step on which most pairs of anchors agree is taken, or, of several, the one
    nearest to the last. Those whose place along the face, the camera's summed steps and their own bearing, agrees
    within `same` are one object. Each pass is aligned with the first one by its first object, so all must see that.
    Raises StructureError where none is seen in `least_frames` frames.
    """
    of_part = [feature for feature in features if feature.part == anchor]
    towards = [attitudes[each.frame] @ facts.views[each.view].rig_rays(each.pixels[0]) for each in of_part]
    rays = np.array(towards).reshape(-1, 3)
    ahead = rays[:, 2] < -TOO_FLAT
    anchors = [feature for feature, is_ahead in zip(of_part, ahead, strict=True) if is_ahead]
    bearings = rays[ahead, 0] / -rays[ahead, 2]  # along the face, in units of the camera's distance
    frames, x = np.array([feature.frame for feature in anchors], np.int64), np.full(len(anchors), np.inf)
    for name in dict.fromkeys(facts.frames.passes):
        numbers = facts.frames.of_pass(name)
        of_pass = np.isin(frames, numbers)
        positions = _positions([bearings[frames == frame] for frame in numbers], same)
        place = bearings[of_pass] + positions[np.searchsorted(numbers, frames[of_pass])]
        first = peaks.peaks(place, same, least_frames)[:1]
        x[of_pass] = place - first if len(first) else np.inf
    placed_anchors = np.flatnonzero(np.isfinite(x))
    return _tracks(features, [anchors[k] for k in placed_anchors], x[placed_anchors], same, least_frames)


def _positions(bearings: Sequence[Floats], same: float) -> Floats:
    """The camera's places (n,) along the face, from the bearings of what each frame shows."""
    positions, last = [0.0], 0.0
    for before, after in pairwise(bearings):
        steps = (before[:, None] - after[None]).ravel()
        if len(steps):
            agree = np.abs(steps[:, None] - steps[None]) < same / 2
            best = np.flatnonzero(agree.sum(axis=1) == agree.sum(axis=1).max())
            chosen = best[np.argmin(np.abs(steps[best] - last))]
            last = float(np.median(steps[agree[chosen]]))
        positions.append(positions[-1] + last)
    return np.array(positions)


def _tracks(
    features: Sequence[Feature], anchors: Sequence[Feature], x: Floats, same: float, least_frames: int
) -> list[Track]:
    """Tracks of all parts of the objects whose anchors agree in their places x (n,) along the row within `same`."""
    places = peaks.peaks(x, same, least_frames)
    if not len(places):
        raise StructureError(f"nothing was seen in {least_frames} frames: was the network trained on such?")
    seen: dict[tuple[int, str, int], list[Feature]] = {}
    for feature in features:
        seen.setdefault(_instance(feature), []).append(feature)
    tracks: list[Track] = []
    for number, place in enumerate(places, start=1):
        parts: dict[str, list[Feature]] = {}
        for anchor in (anchor for anchor, at in zip(anchors, x, strict=True) if abs(at - place) <= same):
            for feature in seen[_instance(anchor)]:
                parts.setdefault(feature.part, []).append(feature)
        tracks += [track_of(number, part, group) for part, group in parts.items()]
    return tracks


def _instance(feature: Feature) -> tuple[int, str, int]:
    return feature.frame, feature.view, feature.instance
