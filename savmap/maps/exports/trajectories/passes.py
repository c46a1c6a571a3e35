"""The located frames of a map, pass by pass, in the world's frame, and the names that their pictures have in
exports."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from savmap.errors import visible
from savmap.maps.exports.frames import drives
from savmap.maps.exports.marks import unique
from savmap.types import Floats, Ints, SiteMap, array_record

WIDTH_PX, HEIGHT_PX = 3840, 1920
"""Of a panorama, nominally: a map does not say how large its pictures were."""


@dataclass(frozen=True, eq=False)
@array_record
class PassFrames:
    """The located frames of one pass: numbers (n) in the row, times (n) s in the pass's video, world_from_rig (n, 4,
    4), z up; the rig's axes are x right, y down, z ahead. `folder`: row and pass as the name of a folder, of letters,
    digits, dots, dashes and underscores; no other pass of the map has it, nor one that differs by capitals alone."""

    row: str
    name: str
    folder: str
    numbers: Ints
    stamps_s: Floats
    world_from_rig: Floats

    def pictures(self) -> list[str]:
        """A file name for each frame's panorama: its time in the video, in milliseconds."""
        return [f"{self.folder}/{round(1000 * stamp):08d}.jpg" for stamp in self.stamps_s.tolist()]


def passes(site: SiteMap) -> list[PassFrames]:
    """All passes of all rows with located frames. Raises OutputError where rows have no common frame."""
    return list(_passes(site))


def _passes(site: SiteMap) -> Iterator[PassFrames]:
    found = drives(site)
    for drive, folder in zip(found, _folders([drive.row for drive in found]), strict=True):
        names = list(dict.fromkeys(drive.passes))
        for name, inner in zip(names, _folders(names), strict=True):
            here = np.array([other == name for other in drive.passes])
            frames = drive.frames[here], drive.stamps_s[here], drive.world_from_rig[here]
            yield PassFrames(drive.row, name, f"{folder}/{inner}", *frames)


def _folders(names: Sequence[str]) -> list[str]:
    return unique([plain(name) for name in names], key=str.casefold)


def plain(text: str) -> str:
    """A text as a part of a path: what is no letter or digit of ASCII, dot, dash or underscore becomes an
    underscore."""
    kept = "".join(
        letter if letter.isascii() and (letter.isalnum() or letter in ".-_") else "_" for letter in visible(text)
    )
    return kept.lstrip(".") or "_"
