"""Variables' keys: frames are shared by all rooms, every room has its own space of landmarks."""

import zlib
from collections.abc import Iterable
from dataclasses import dataclass

import gtsam

ORIGIN = int(gtsam.symbol("o", 0))


def frame_key(frame: int) -> int:
    """Key of world_from_rig (Pose3) of a frame."""
    return int(gtsam.symbol("x", frame))


def centre_key(frame: int) -> int:
    """Key of the camera's place in the world (Point3, m) at a frame."""
    return int(gtsam.symbol("c", frame))


def mast_key(index: int) -> int:
    """Key of the unknown camera height of one reference (Point3, m, of which only y is used)."""
    return int(gtsam.symbol("m", index))


@dataclass(frozen=True)
class KeySpace:
    """The keys of one room: a stable function of the room's name, so that rooms need not know one another."""

    room: str

    def point(self, index: int) -> int:
        """Key of the room's landmark number `index` (0 .. 2^24 - 1)."""
        space = zlib.crc32(self.room.encode()) & 0xFFFFFF
        return int(gtsam.symbol("p", (space << 24) + index))

    def keys(self, names: Iterable[str]) -> dict[str, int]:
        """A key for each name, in order."""
        return {name: self.point(index) for index, name in enumerate(dict.fromkeys(names))}
