"""Variables' keys: frames are shared by all rooms, every room has its own space of landmarks."""

import zlib
from collections.abc import Iterable
from dataclasses import dataclass

import gtsam

ORIGIN = int(gtsam.symbol("o", 0))
POSE2, VECTOR3 = "q", "v"
FRAME = ord("x")


def frame_key(frame: int) -> int:
    """Key of world_from_rig (Pose3) of a frame."""
    return int(gtsam.symbol("x", frame))


def is_frame(key: int) -> bool:
    """Whether a key is that of a frame's pose."""
    return bool(gtsam.symbolChr(key) == FRAME)


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
        return self._key("p", index)

    def pose2(self, index: int) -> int:
        """Key of a `gtsam.Pose2` of the room's own, such as where a thing stands on the floor, for `Constraints.own`."""
        return self._key(POSE2, index)

    def vector3(self, index: int) -> int:
        """Key of three numbers (3,) of the room's own, such as a size, for `Constraints.own`."""
        return self._key(VECTOR3, index)

    def _key(self, kind: str, index: int) -> int:
        space = zlib.crc32(self.room.encode()) & 0xFFFFFF
        return int(gtsam.symbol(kind, (space << 24) + index))

    def keys(self, names: Iterable[str]) -> dict[str, int]:
        """A key for each name, in order."""
        return {name: self.point(index) for index, name in enumerate(dict.fromkeys(names))}
