"""The located frames of a map, pass by pass, in the world's frame, and the names that their pictures have in exports."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from savmap.errors import visible
from savmap.maps.exports.frames import drives
from savmap.types import Floats, Ints, SiteMap, array_record

WIDTH_PX, HEIGHT_PX = 3840, 1920
"""Of a panorama, nominally: a map does not say how large its pictures were."""


@dataclass(frozen=True, eq=False)
@array_record
class PassFrames:
    """The located frames of one pass: numbers (n) in the row, times (n) s in the pass's video, world_from_rig (n, 4, 4), z up; the rig's axes are
    x right, y down, z ahead."""

    row: str
    name: str
    numbers: Ints
    stamps_s: Floats
    world_from_rig: Floats

    @property
    def folder(self) -> str:
        """Row and pass as the name of a folder: letters, digits, dots, dashes and underscores."""
        return f"{plain(self.row)}/{plain(self.name)}"

    def pictures(self) -> list[str]:
        """A file name for each frame's panorama: its time in the video, in milliseconds."""
        return [f"{self.folder}/{round(1000 * stamp):08d}.jpg" for stamp in self.stamps_s.tolist()]


def passes(site: SiteMap) -> list[PassFrames]:
    """All passes of all rows with located frames. Raises OutputError where rows have no common frame."""
    return list(_passes(site))


def _passes(site: SiteMap) -> Iterator[PassFrames]:
    for drive in drives(site):
        for name in dict.fromkeys(drive.passes):
            here = np.array([other == name for other in drive.passes])
            yield PassFrames(drive.row, name, drive.frames[here], drive.stamps_s[here], drive.world_from_rig[here])


def plain(text: str) -> str:
    """A text as a part of a path: what is no letter or digit of ASCII, dot, dash or underscore becomes an underscore."""
    kept = "".join(
        letter if letter.isascii() and (letter.isalnum() or letter in ".-_") else "_" for letter in visible(text)
    )
    return kept.lstrip(".") or "_"
