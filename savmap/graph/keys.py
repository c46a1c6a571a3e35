"""Keys of the graph's variables: frames are shared by all plugins, every plugin has its own space of landmarks.

In a graph of several rows, the index of each key holds the row's number above its first 48 bits (`rekey`).
"""

import zlib
from collections.abc import Iterable
from dataclasses import dataclass

import gtsam

from savmap.types import Floats

ORIGIN = int(gtsam.symbol("o", 0))
FRAME, HEIGHT, POINT, POSE2, VECTOR3, TRANSFORM = "x", "m", "p", "q", "v", "t"
NAME_BITS, ROW_BITS = 24, 48
NO_ROW = 255

Variable = gtsam.Pose2 | Floats
"""A plugin's variable that is no landmark: a pose on the floor, or three numbers (3,)."""


def frame_key(frame: int) -> int:
    """Key of world_from_rig (Pose3) of a frame."""
    return int(gtsam.symbol(FRAME, frame))


def is_frame(key: int) -> bool:
    """Whether a key is that of a frame's pose."""
    return bool(gtsam.symbolChr(key) == ord(FRAME))


def camera_height_key(index: int) -> int:
    """Key of the unknown camera height of one reference (Point3, m, of which only y is used)."""
    return int(gtsam.symbol(HEIGHT, index))


@dataclass(frozen=True)
class KeySpace:
    """The keys of one plugin: a stable function of its name, so that plugins need not know one another."""

    plugin: str

    def point(self, index: int) -> int:
        """Key of the plugin's landmark number `index` (0 .. 2^24 - 1)."""
        return self._key(POINT, index)

    def pose2(self, index: int) -> int:
        """Key of a `gtsam.Pose2`, such as where an object stands on the floor, for `Constraints.variables`."""
        return self._key(POSE2, index)

    def vector3(self, index: int) -> int:
        """Key of three numbers (3,), such as a size, for `Constraints.variables`."""
        return self._key(VECTOR3, index)

    def holds(self, key: int) -> bool:
        """Whether a key is one of this plugin's."""
        kind, index = chr(gtsam.symbolChr(key)), int(gtsam.symbolIndex(key))
        return kind in (POINT, POSE2, VECTOR3) and index >> NAME_BITS == self._space

    @property
    def _space(self) -> int:
        return zlib.crc32(self.plugin.encode()) & 0xFFFFFF

    def _key(self, kind: str, index: int) -> int:
        return int(gtsam.symbol(kind, (self._space << NAME_BITS) + index))

    def keys(self, names: Iterable[str]) -> dict[str, int]:
        """A key for each name, in order."""
        return {name: self.point(index) for index, name in enumerate(dict.fromkeys(names))}


def rekey(key: int, row: int) -> int:
    """A row's key in the graph of several rows."""
    return key + (row << ROW_BITS)


def row_of(key: int) -> int:
    """The row of a key of the graph of several rows."""
    return int(gtsam.symbolIndex(key)) >> ROW_BITS


def width_of(key: int) -> int:
    """How many numbers a small step of a variable has: 6 for a frame's pose or a transform of rows, 3 for all
    others."""
    return 6 if chr(gtsam.symbolChr(key)) in (FRAME, TRANSFORM) else 3


def value_at(values: gtsam.Values, key: int) -> gtsam.Pose3 | Variable:
    """The value of a variable, of the type that its key names."""
    return values.atPose3(key) if is_frame(key) else variable_at(values, key)


def variable_at(values: gtsam.Values, key: int) -> Variable:
    """The same of a variable that is no frame's pose."""
    return values.atPose2(key) if gtsam.symbolChr(key) == ord(POSE2) else values.atPoint3(key)
