"""Which way to look: straight at the face, widely, and along the aisle both ways, where signs hang across it."""

from collections.abc import Mapping

from savmap.geometry.pinhole import angles_from_rotation, rig_from_view
from savmap.stages.aim import LEVEL, Manual, Scout
from savmap.types import Aim, Floats, ViewSpec
from savmap_signs.reading import advice
from savmap_signs.settings import Settings

FACE, AHEAD, BEHIND = "signs face", "signs ahead", "signs behind"
FACE_HFOV_DEG, ALONG_HFOV_DEG, ALONG_PITCH_DEG = 120.0, 90.0, 10.0


def aim_at_signs(scout: Scout, manual: Mapping[str, Manual], attitude: Floats | None, config: Settings) -> Aim:
    """The views of a pass. `attitude`: world_from_rig (3, 3) of its first key frame, if known."""
    every = config.every or scout.apart()
    rig_from_world = attitude.T if attitude is not None else scout.rig_from_manhattan
    wanted = [(FACE, 0.0, 0.0, FACE_HFOV_DEG)]
    if config.along:
        wanted += [(AHEAD, 90.0, ALONG_PITCH_DEG, ALONG_HFOV_DEG), (BEHIND, -90.0, ALONG_PITCH_DEG, ALONG_HFOV_DEG)]
    specs = [_spec(name, rig_from_world, yaw, pitch, hfov, every) for name, yaw, pitch, hfov in wanted]
    note = advice() if config.read else None
    views = tuple(manual[one.name].over(one) if one.name in manual else one for one in specs)
    return Aim(views, notes=(note,) if note else ())


def _spec(name: str, rig_from_world: Floats, yaw: float, pitch: float, hfov: float, every: int) -> ViewSpec:
    """The view turned by `yaw` to the right of straight at the face, raised by `pitch`."""
    angles = angles_from_rotation(rig_from_world @ LEVEL @ rig_from_view(yaw, pitch, 0.0))
    return ViewSpec(name, *angles, hfov_deg=hfov, every=every)
