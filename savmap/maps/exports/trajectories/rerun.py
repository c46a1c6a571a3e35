"""Maps as recordings of rerun."""

from pathlib import Path
from typing import Any

from savmap.errors import visible
from savmap.maps.exports import require_library
from savmap.maps.exports.frames import Element, elements
from savmap.maps.exports.trajectories.drawn import LINE_M, Colour, coloured, segments, texts, title
from savmap.maps.exports.trajectories.passes import PassFrames, passes
from savmap.types import SiteMap


def write_rerun(site: SiteMap, path: Path) -> None:
    """`map/ROW/PLUGIN/ID` as line strips with a label, attributes and standard deviations; `drive/ROW/PASS` with its
    path, and its pose over the video's time. Needs the extra `rerun`."""
    require_library("rerun", "rerun")
    import rerun

    recording = rerun.RecordingStream("savmap", recording_id="savmap")
    recording.save(str(path))
    recording.log("/", rerun.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    for element, colour in coloured(elements(site)):
        _structure(rerun, recording, element, colour)
    for each in passes(site):
        _drive(rerun, recording, each)
    recording.disconnect()


def _structure(rerun: Any, recording: Any, element: Element, colour: Colour) -> None:
    place = ["map", visible(element.row), visible(element.plugin), visible(element.structure.id)]
    ends = segments(element.structure)
    strips = rerun.LineStrips3D(
        ends, colors=[colour] * len(ends), radii=LINE_M / 2, labels=[title(element)] * len(ends), show_labels=False
    )
    recording.log(place, strips, rerun.AnyValues(**texts(element)), static=True)


def _drive(rerun: Any, recording: Any, each: PassFrames) -> None:
    place = ["drive", visible(each.row), visible(each.name)]
    recording.log(
        [*place, "path"], rerun.LineStrips3D([each.world_from_rig[:, :3, 3]], colors=[(120, 120, 120)]), static=True
    )
    for stamp, pose in zip(each.stamps_s.tolist(), each.world_from_rig, strict=True):
        recording.set_time("video", duration=stamp)
        recording.log([*place, "rig"], rerun.Transform3D(translation=pose[:3, 3], mat3x3=pose[:3, :3]))
