"""A pallet's pose from its outlines and a camera path that is held: where the solve starts, and what tells pallets from other things."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from savmap.types import Floats, RowFacts, Trajectory
from savmap_pallets.outline import Camera, errors, with_slopes

TURNS_DEG = (0.0, 30.0, 60.0, 90.0, 120.0, 150.0)
SOME = 8
SOFT_PX = 1.5


@dataclass(frozen=True)
class Sighting:
    """One pallet's outline in one view of one frame: pixels (n, 2), and whether it is seen whole."""

    frame: int
    view: str
    pixels: Floats
    whole: bool


def cameras(sightings: Sequence[Sighting], facts: RowFacts, start: Trajectory) -> list[Camera]:
    """The camera of each sighting, whose frames must be among those of the path."""
    poses = poses_of(start)
    return [Camera(poses[seen.frame], facts.views[seen.view]) for seen in sightings]


def poses_of(path: Trajectory) -> Mapping[int, Floats]:
    """world_from_rig (4, 4) by frame."""
    return dict(zip(path.frames.tolist(), path.world_from_rig, strict=True))


def fitted(sightings: Sequence[Sighting], seen_by: Sequence[Camera], size: Floats, middle: Floats) -> Floats:
    """The pose (x, y, turn) of least soft error, near a place (x, y): each of six turns is tried on some of the sightings."""
    some = np.unique(np.linspace(0, len(sightings) - 1, SOME).astype(int))
    few, their = [sightings[k] for k in some], [seen_by[k] for k in some]
    tried = [_refined(few, their, size, np.array([*middle, np.radians(turn)]), 15) for turn in TURNS_DEG]
    pose, _ = _refined(sightings, seen_by, size, min(tried, key=lambda one: one[1])[0], 30)
    return np.array([pose[0], pose[1], pose[2] % np.pi])


def off_px(sightings: Sequence[Sighting], seen_by: Sequence[Camera], size: Floats, pose: Floats) -> list[Floats]:
    """Each sighting's errors (n,) px; infinite where the pallet would not be in front of the camera."""
    found = [errors(seen.pixels, pose, size, camera) for seen, camera in zip(sightings, seen_by, strict=True)]
    return [np.where(np.isnan(own), np.inf, own) for own in found]


def spread(sighting: Sighting, camera: Camera, height_m: float) -> Floats:
    """Where an outline's rays meet a level: (n, 2) x and z, m; NaN for rays that rise."""
    rays = camera.spec.rig_rays(sighting.pixels) @ camera.world_from_rig[:3, :3].T
    place = camera.world_from_rig[:3, 3]
    down = np.where(rays[:, 1] < -0.05, rays[:, 1], np.nan)
    reach = (height_m - place[1]) / down
    return np.asarray(place[[0, 2]] + reach[:, None] * rays[:, [0, 2]])


def _refined(
    sightings: Sequence[Sighting], seen_by: Sequence[Camera], size: Floats, pose: Floats, most: int
) -> tuple[Floats, float]:
    """The pose at the nearest minimum of the soft error, and that error."""

    def parts(at: Floats) -> list[tuple[Floats, Floats, Floats]]:
        return [with_slopes(seen.pixels, at, size, camera) for seen, camera in zip(sightings, seen_by, strict=True)]

    def error(at: Floats) -> Floats:
        return np.asarray(np.nan_to_num(np.concatenate([part[0] for part in parts(at)]), nan=50.0))

    def slopes(at: Floats) -> Floats:
        cos, sin = np.cos(at[2]), np.sin(at[2])
        own_from_floor = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
        return np.asarray(np.concatenate([part[2] for part in parts(at)]) @ own_from_floor)

    found = least_squares(error, pose, slopes, loss="soft_l1", f_scale=SOFT_PX, max_nfev=most)
    return found.x, float(found.cost)
