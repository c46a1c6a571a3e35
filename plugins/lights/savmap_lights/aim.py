"""Which way to look: straight up, wide enough for two lamps. Paper, section III.B."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from savmap.geometry.pinhole import angles_from_rotation
from savmap.types import Detection, Floats, View, ViewPlan, ViewSpec
from savmap.vision.field_of_view import fit_count
from savmap.vision.view_planning import Manual, PassPreview
from savmap_lights.features import touches_border

HFOV_DEG = 110.0
WORLD_FROM_VIEW = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])


def aim_at_ceiling(
    pass_preview: PassPreview,
    see: Callable[[View], list[Detection]],
    manual: Mapping[str, Manual],
    attitude: Floats | None,
    every: int | None = None,
) -> ViewPlan:
    """The view "ceiling" of a pass, in each of `every` frames: its optical axis is the building's vertical, its x axis the
    aisle's where known."""
    apart = every or pass_preview.apart()
    rig_from_world = attitude.T if attitude is not None else pass_preview.rig_from_manhattan
    yaw, pitch, roll = angles_from_rotation(rig_from_world @ WORLD_FROM_VIEW)
    spec = ViewSpec("ceiling", yaw, pitch, roll, HFOV_DEG, every=apart)
    fitted = fit_count(
        pass_preview, spec, lambda view: whole(see(view)), at_least=2, manual=manual.get("ceiling", Manual())
    )
    return ViewPlan((fitted.spec,), notes=(fitted.warning,) if fitted.warning else ())


def whole(detections: Sequence[Detection]) -> int:
    """How many lamps are seen whole: not cut by the frame."""
    return sum(not touches_border(detection.mask) for detection in detections)
