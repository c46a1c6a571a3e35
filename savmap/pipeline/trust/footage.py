"""Whether footage is what mapping takes it for: whole panoramas, of one drive along the face."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from savmap.errors import SavmapError, SolveError, StructureError, VideoError
from savmap.types import Floats, MapWarning, Panorama
from savmap.video.camera_kind import kind_of
from savmap.video.clip import Clip
from savmap.video.course import Course, contradiction, warnings
from savmap.video.motion import Steps


def require_panoramas(clip: Clip, keys: Sequence[Panorama]) -> tuple[MapWarning, ...]:
    """What speaks against a pass's pictures where its camera is one of whole panoramas. Raises VideoError where they
    are certainly none."""
    if clip.camera is not None:
        return ()
    other, warnings_found = kind_of(keys)
    if other:
        raise VideoError(f"{clip.path}: {other}")
    return tuple(replace(warning, subjects=(clip.path.name,)) for warning in warnings_found)


def require_course(
    name: str, clip: Clip, steps: Steps, attitude: Floats | None, side: str | None
) -> tuple[MapWarning, ...]:
    """What speaks against a pass by how a camera of whole panoramas went. Raises StructureError where that contradicts
    what was asked.

    `attitude`: world_from_rig (3, 3) at the start, where it is known; `side`: the hand that the face is on, where
    that is given."""
    if clip.camera is not None:
        return ()
    course = Course(steps, None if attitude is None else _bearing_deg(attitude[0]))
    against = contradiction(course, side)
    if against:
        raise StructureError(f"{clip.path}: {name}: {against}")
    return tuple(replace(warning, figure=f"{name}, {warning.figure}") for warning in warnings(course))


def _bearing_deg(direction: Floats) -> float:
    """How far to the right of the panorama's centre a direction (3,) of the rig frame lies, degrees."""
    return float(np.degrees(np.arctan2(direction[0], direction[2])))


def with_warnings(error: SavmapError, warnings_found: Sequence[MapWarning]) -> SavmapError:
    """An error of tracking or solving, with what speaks against the footage, which may be why."""
    if not warnings_found or type(error) not in (StructureError, SolveError):
        return error
    return type(error)(
        f"{error} (perhaps because of the footage: {'; '.join(warning.line for warning in warnings_found)})"
    )
