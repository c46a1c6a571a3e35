"""Lamps through the sequence: sightings put on the ceiling plane from the camera's first positions, then grouped.

Paper, section III.D. The height of the lamps is the one at which the sightings of all frames fall on one another best.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from savmap.errors import StructureError
from savmap.geometry.pinhole import project
from savmap.types import Feature, Floats, Ints, RowFacts, Track, Trajectory
from savmap.vision import peaks

MIN_SUPPORT = 3
MAX_SLOPE = 3.0
HEIGHTS_M = (0.5, 20.0)
SAME_LAMP_M = 0.3
SAME_LINE_M = 0.4
LEAST_SHARE = 0.4
SURE = 0.2
UPWARDS = 0.7
MARGIN_PX = 40

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Sightings:
    """Points seen above the camera: the features, their frames (n,), the camera's positions (n, 3), and the slopes
    (n, 2) of their rays: metres along x and z for each metre of height above the camera."""

    features: Sequence[Feature]
    frames: Ints
    origins: Floats
    slopes: Floats

    def where(self, keep: Mask) -> "Sightings":
        chosen = [feature for feature, kept in zip(self.features, keep, strict=True) if kept]
        return Sightings(chosen, self.frames[keep], self.origins[keep], self.slopes[keep])

    def at(self, height_m: float) -> Floats:
        """Where the rays meet the level `height_m`: (n, 2) x and z."""
        return self.origins[:, [0, 2]] + (height_m - self.origins[:, 1:2]) * self.slopes

    @property
    def certainty(self) -> Floats:
        """How sure the network was (n,): 0 at a probability of one half, 1 at one."""
        scores = np.array([feature.score for feature in self.features], dtype=np.float64)
        certainty: Floats = np.clip(2 * scores - 1, 0.01, 1) ** 2
        return certainty

    @property
    def is_centre(self) -> Mask:
        return np.array([feature.part == "centre" for feature in self.features], dtype=bool)


def track_lamps(features: Sequence[Feature], facts: RowFacts, start: Trajectory) -> list[Track]:
    """Tracks "light 3 / end 0" and "light 3 / end 1" (towards +x) of strips, "light 3 / centre" of compact lamps.

    Lamps are those of the line nearest above the camera's path, numbered along x from 1.
    Raises StructureError when no lamp is seen in at least three frames.
    """
    seen = _sightings(features, facts, start)
    height_m = _height(seen.where(seen.is_centre))
    seen, line_z = _nearest_line(seen, height_m)
    x = seen.at(height_m)[:, 0]
    lamps = peaks.peaks(x[seen.is_centre], SAME_LAMP_M, MIN_SUPPORT)
    hits = np.array([len(np.unique(seen.frames[seen.is_centre & (np.abs(x - lamp) <= SAME_LAMP_M)])) for lamp in lamps])
    shown = _shown(np.array([[lamp, height_m, line_z] for lamp in lamps]).reshape(-1, 3), facts, start)
    lamps = lamps[hits >= LEAST_SHARE * shown]
    if len(lamps) == 0:
        raise _no_lamp()
    return [track for number, at in enumerate(lamps, start=1) for track in _tracks(number, at, lamps, seen, x)]


def _no_lamp() -> StructureError:
    return StructureError(
        "no lamp was seen in three frames or more: does the ceiling view show lamps, and was the network trained on such?"
    )


def _sightings(features: Sequence[Feature], facts: RowFacts, start: Trajectory) -> Sightings:
    world_from_rig = dict(zip(start.frames.tolist(), start.world_from_rig, strict=True))
    kept = [feature for feature in features if feature.frame in world_from_rig]
    poses = np.array([world_from_rig[feature.frame] for feature in kept]).reshape(-1, 4, 4)
    rig_rays = np.array([facts.views[feature.view].rig_rays(feature.pixels[0]) for feature in kept]).reshape(-1, 3)
    rays = np.einsum("nij,nj->ni", poses[:, :3, :3], rig_rays)
    above = (rays[:, 1] > 0) & (np.hypot(rays[:, 0], rays[:, 2]) < MAX_SLOPE * rays[:, 1])
    slopes = rays[:, [0, 2]] / np.where(above, rays[:, 1], 1.0)[:, None]
    frames = np.array([feature.frame for feature in kept], dtype=np.int64)
    return Sightings(kept, frames, poses[:, :3, 3], slopes).where(above)


def _height(centres: Sightings) -> float:
    """The height at which the sightings of lamps' centres gather best, searched coarsely, then finely."""
    if len(centres.frames) < MIN_SUPPORT:
        raise _no_lamp()
    base = float(centres.origins[:, 1].mean())
    above = np.arange(*HEIGHTS_M, 0.05)
    best = above[np.argmax([_gathering(centres, base + height, 0.03 * height) for height in above])]
    fine = best + np.arange(-0.1, 0.1001, 0.005)
    return base + float(fine[np.argmax([_gathering(centres, base + height, 0.015 * height) for height in fine])])


def _gathering(seen: Sightings, height_m: float, width_m: float) -> float:
    """How many pairs of sightings, neighbours in x at a height, lie nearer than `width_m` along both axes, softly, each
    counted by how sure the network was.

    The width must grow with the height that is tried: otherwise the lowest, where all rays are close, always wins.
    """
    points, certainty = seen.at(height_m), seen.certainty
    order = np.argsort(points[:, 0], kind="stable")
    points, certainty = points[order], certainty[order]
    total = 0.0
    for step in (1, 2, 4, 8):
        near = np.exp(-0.5 * ((points[step:] - points[:-step]) / width_m) ** 2).prod(axis=1)
        total += float((near * certainty[step:] * certainty[:-step]).sum())
    return total


def _nearest_line(seen: Sightings, height_m: float) -> tuple[Sightings, float]:
    """The sightings of the line of lamps, parallel to x, that runs nearest above the camera, and its z."""
    z = seen.at(height_m)[:, 1]
    sure = seen.is_centre & (seen.certainty >= SURE)
    lines = peaks.peaks(z[sure], SAME_LINE_M, max(MIN_SUPPORT, int(sure.sum() / 10)))
    if len(lines) == 0:
        raise _no_lamp()
    nearest = float(lines[np.argmin(np.abs(lines - np.median(seen.origins[:, 2])))])
    return seen.where(np.abs(z - nearest) <= SAME_LINE_M), nearest


def _shown(points: Floats, facts: RowFacts, start: Trajectory) -> Ints:
    """In how many frames points (n, 3) lie well inside a view of it that looks up: (n,)."""
    count = np.zeros(len(points), dtype=np.int64)
    for frame, pose in zip(start.frames.tolist(), start.world_from_rig, strict=True):
        inside = np.zeros(len(points), dtype=bool)
        for name, spec in facts.views.items():
            looks_up = (pose[:3, :3] @ spec.rig_from_view)[1, 2] > UPWARDS
            if looks_up and spec.shows(frame) and name.startswith(facts.frames.passes[frame]):
                pixels = project((points - pose[:3, 3]) @ pose[:3, :3] @ spec.rig_from_view, spec.camera)
                room = np.array([spec.width, spec.height]) - 1
                inside |= ((pixels > MARGIN_PX) & (pixels < room - MARGIN_PX)).all(axis=1)
        count += inside
    return count


def _tracks(number: int, at: float, lamps: Floats, seen: Sightings, x: Floats) -> list[Track]:
    spacing = float(np.diff(lamps).min()) if len(lamps) > 1 else 2.0
    near = np.abs(x - at) < 0.5 * spacing
    ends = near & ~seen.is_centre
    sides = [ends & (x < at), ends & (x > at)]
    if min(int(side.sum()) for side in sides) >= MIN_SUPPORT:
        return [
            _track(f"light {number} / end {end}", number, f"end {end}", seen, side) for end, side in enumerate(sides)
        ]
    return [_track(f"light {number} / centre", number, "centre", seen, near & seen.is_centre)]


def _track(name: str, number: int, part: str, seen: Sightings, chosen: Mask) -> Track:
    own = seen.where(chosen)
    return Track(
        name=name,
        label=own.features[0].label,
        place={"light": number, "part": part},
        frames=own.frames,
        views=tuple(feature.view for feature in own.features),
        pixels=np.concatenate([feature.pixels for feature in own.features]),
        covariances=np.concatenate([feature.covariance for feature in own.features]),
    )
