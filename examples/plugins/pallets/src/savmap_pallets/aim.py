"""Which way to look: down at the floor between the camera and the face."""

from collections.abc import Mapping

import numpy as np

from savmap.geometry.pinhole import angles_from_rotation, rig_from_view
from savmap.types import Floats, ViewPlan, ViewSpec
from savmap.vision.view_planning import LEVEL, Manual, PassPreview

PITCH_DEG = -52.0


def aim_at_floor(
    pass_preview: PassPreview, manual: Mapping[str, Manual], attitude: Floats | None, hfov_deg: float, every: int
) -> ViewPlan:
    """The view "floor" of a pass: towards the face and down, from below the camera to the rack's foot.

    `attitude` is world_from_rig (3, 3) of the first key frame, which a plugin that finds the face gives. Without it the view looks
    straight down.
    """
    if attitude is None:
        world_from_view = LEVEL @ rig_from_view(0.0, -90.0, 0.0)
        rig_from_world = pass_preview.rig_from_manhattan
    else:
        world_from_view = LEVEL @ rig_from_view(0.0, PITCH_DEG, 0.0)
        rig_from_world = np.asarray(attitude.T)
    yaw, pitch, roll = angles_from_rotation(rig_from_world @ world_from_view)
    spec = ViewSpec("floor", yaw, pitch, roll, hfov_deg, every=every)
    return ViewPlan((manual.get("floor", Manual()).over(spec),))
