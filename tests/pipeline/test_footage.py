"""Footage on its way into a row's measurements: what is refused, what is warned of, and what errors say of it."""

from pathlib import Path

import numpy as np
import pytest

from savmap.errors import PluginFailedError, SiteError, SolveError, StructureError, VideoError
from savmap.pipeline.trust.footage import require_course, require_panoramas, with_warnings
from savmap.types import MapWarning, Panorama
from savmap.video.clip import Clip

from ..video.test_camera_kind import corridor, vr180
from ..video.test_course import course, drive

CUT = MapWarning("missing-frames", figure="pass 1, from 1.0 s to 3.0 s")
CLIP = Clip(Path("a.mp4"))
AHEAD = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
"""world_from_rig of a face whose +x lies ahead, in the panorama's centre."""


def keys(*pictures: np.ndarray) -> list[Panorama]:
    return [Panorama(number, 0.0, np.dstack([picture.astype(np.uint8)] * 3)) for number, picture in enumerate(pictures)]


def test_other_packings_name_the_file() -> None:
    with pytest.raises(VideoError, match=r"^a\.mp4: its left and right halves show the same"):
        require_panoramas(CLIP, keys(vr180(corridor())))
    assert require_panoramas(CLIP, keys(corridor())) == ()


def test_there_and_back_names_pass_and_time() -> None:
    steps = course([*drive(), *drive()[::-1]]).steps
    with pytest.raises(StructureError, match=r"^a\.mp4: pass 2: the camera goes back the way it came at \d\.\d s: "):
        require_course("pass 2", CLIP, steps, AHEAD, None)


def test_the_way_is_that_of_the_face() -> None:
    steps = course(drive()).steps
    assert require_course("pass 1", CLIP, steps, AHEAD, "left") == ()
    with pytest.raises(StructureError, match="not on the left"):
        require_course("pass 1", CLIP, steps, np.diag([-1.0, 1.0, -1.0]) @ AHEAD, "left")


def test_without_an_attitude_cuts_are_found_all_the_same() -> None:
    steps = course([*drive(0, 20), *drive(100, 20, hall=1), *drive(0, 20)[::-1]]).steps
    found = require_course("pass 1", CLIP, steps, None, "left")
    assert [warning.code for warning in found] == ["missing-frames", "missing-frames"]


@pytest.mark.parametrize("kind", [StructureError, SolveError])
def test_errors_say_what_of_the_footage_may_be_why(kind: type[StructureError] | type[SolveError]) -> None:
    error = with_warnings(kind("row A: the rest says -37.1 m"), [CUT])
    assert type(error) is kind
    assert str(error) == f"row A: the rest says -37.1 m (perhaps because of the footage: {CUT.line})"


def test_other_errors_stay_as_they_are() -> None:
    for error in (SiteError("no"), PluginFailedError("a", "b", "c"), StructureError("no")):
        assert with_warnings(error, [] if type(error) is StructureError else [CUT]) is error
