"""Pallets in the factor graph: each a Pose2 on the floor, and a factor of our own for each outline.

The factor binds a frame's pose and a pallet's: every pixel on the outline is to be on the hull of the projected cuboid. The floor is
y = 0 in the row's frame, by convention, so a pallet's height, tilt and roll are no unknowns.
"""

from collections.abc import Sequence

import gtsam
import numpy as np

from savmap.graph import Constraints, KeySpace, frame_key, image_measurements
from savmap.types import Floats, RowFacts, Track, Trajectory, ViewSpec
from savmap_pallets.fitting import Sighting, cameras, fitted, poses_of, spread
from savmap_pallets.outline import Camera, with_slopes
from savmap_pallets.tracking import sightings_of

SIGMA_PX = 3.0
HUBER = 1.345
FAR_M, FAR_RAD = 1.0, 0.5


def constrain(tracks: Sequence[Track], facts: RowFacts, start: Trajectory, size: Floats, room: str) -> Constraints:
    """A variable a pallet, from where the held path `start` puts it, and a factor a sighting."""
    keys, graph = KeySpace(room), gtsam.NonlinearFactorGraph()
    own: dict[int, gtsam.Pose2] = {}
    known = poses_of(start)
    for track in tracks:
        key = keys.pose2(int(track.place["pallet"]))
        sightings = [seen for seen in sightings_of(track) if seen.frame in known]
        own[key] = first_pose(sightings, facts, start, size)
        graph.add(
            gtsam.PriorFactorPose2(key, own[key], gtsam.noiseModel.Diagonal.Sigmas(np.array([FAR_M, FAR_M, FAR_RAD])))
        )
        for seen in sightings:
            graph.add(outline_factor(seen, key, facts.views[seen.view], size))
    return Constraints(room, {}, image_measurements((), {}, facts.views), (), {}, factors=graph, variables=own)


def first_pose(sightings: Sequence[Sighting], facts: RowFacts, start: Trajectory, size: Floats) -> gtsam.Pose2:
    """Where a pallet is by the path that is held."""
    seen_by = cameras(sightings, facts, start)
    floor = np.concatenate([spread(seen, camera, size[1] / 2) for seen, camera in zip(sightings, seen_by, strict=True)])
    x, z = np.nanmedian(floor, axis=0)
    return gtsam.Pose2(*fitted(sightings, seen_by, size, np.array([x, -z])).tolist())


def outline_factor(seen: Sighting, key: int, spec: ViewSpec, size: Floats) -> gtsam.CustomFactor:
    """How far an outline's pixels are off the projected cuboid's hull, with the slopes by the frame's and the pallet's pose.

    All pixels of a sighting share one Huber loss, for they err together. `SIGMA_PX` is larger than a pixel's error for the same reason.
    """

    def error(own: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[Floats] | None) -> Floats:
        frame, pallet = own.keys()
        at = values.atPose2(pallet)
        camera = Camera(values.atPose3(frame).matrix(), spec)
        off, by_frame, by_pallet = with_slopes(seen.pixels, np.array([at.x(), at.y(), at.theta()]), size, camera)
        if jacobians is not None:
            jacobians[0], jacobians[1] = np.asfortranarray(by_frame), np.asfortranarray(by_pallet)
        return np.nan_to_num(off)

    count = len(seen.pixels)
    loss = gtsam.noiseModel.mEstimator.Huber.Create(HUBER * float(np.sqrt(count)))
    noise = gtsam.noiseModel.Robust.Create(loss, gtsam.noiseModel.Isotropic.Sigma(count, SIGMA_PX))
    return gtsam.CustomFactor(noise, [frame_key(seen.frame), key], error)
