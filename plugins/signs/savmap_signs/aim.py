"""Which way to look: at the upper and at the lower half of the face, and along the aisle both ways, where signs hang across it.

The cart's motion brings every sign of a face before a view; what a view must have is height, and pixels enough for small signs.
"""

from collections.abc import Mapping

from savmap.geometry.pinhole import angles_from_rotation, rig_from_view
from savmap.types import Floats, ViewPlan, ViewSpec
from savmap.vision.view_planning import LEVEL, Manual, PassPreview
from savmap_signs.reading import advice
from savmap_signs.settings import Settings

HFOV_DEG, PITCH_DEG = 90.0, 25.0
FACE = (("signs upper", 0.0, PITCH_DEG), ("signs lower", 0.0, -PITCH_DEG))
ALONG = (("signs ahead", 90.0, PITCH_DEG), ("signs behind", -90.0, PITCH_DEG))


def aim_at_signs(
    pass_preview: PassPreview, manual: Mapping[str, Manual], attitude: Floats | None, config: Settings
) -> ViewPlan:
    """The views of a pass. `attitude`: world_from_rig (3, 3) of its first key frame, if known."""
    every = config.every or pass_preview.apart()
    rig_from_world = attitude.T if attitude is not None else pass_preview.rig_from_manhattan
    wanted = FACE + ALONG if config.along else FACE
    specs = [_spec(name, rig_from_world, yaw, pitch, every) for name, yaw, pitch in wanted]
    note = advice() if config.read else None
    views = tuple(manual[one.name].over(one) if one.name in manual else one for one in specs)
    return ViewPlan(views, notes=(note,) if note else ())


def _spec(name: str, rig_from_world: Floats, yaw: float, pitch: float, every: int) -> ViewSpec:
    """The view turned by `yaw` to the right of straight at the face, raised by `pitch`."""
    angles = angles_from_rotation(rig_from_world @ LEVEL @ rig_from_view(yaw, pitch, 0.0))
    return ViewSpec(name, *angles, hfov_deg=HFOV_DEG, every=every)
