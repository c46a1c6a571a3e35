"""Records of a row while it is mapped: its frames, the camera's path and tracks of points."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from savmap.types.common import Floats, Ints, Place, array_record, require
from savmap.types.pictures import ViewSpec


@dataclass(frozen=True, eq=False)
@array_record
class Track:
    """One physical point, observed in many frames.

    `name` is its label in the map ("bay 3 / beam 2 / upper left"), `label` its class, `place` its position in the
    structure, as the plugin numbers it. frames (n,), views n names, pixels (n, 2), covariances (n, 2, 2) px^2.
    """

    name: str
    label: str
    place: Place
    frames: Ints
    views: tuple[str, ...]
    pixels: Floats
    covariances: Floats

    def __post_init__(self) -> None:
        count = len(self.frames)
        require(
            len(self.views) == count and self.pixels.shape == (count, 2),
            self,
            "frames, views and pixels differ in number",
        )
        require(self.covariances.shape == (count, 2, 2), self, "covariances must be (n, 2, 2)")


@dataclass(frozen=True, eq=False)
@array_record
class FrameTable:
    """The frames 0..n-1 of a row: `stamps_s` (n,) is the time in the frame's own video, `passes` (n) the name of its
    pass."""

    stamps_s: Floats
    passes: tuple[str, ...]

    def __post_init__(self) -> None:
        require(len(self.stamps_s) == len(self.passes), self, "stamps and passes differ in number")

    def __len__(self) -> int:
        return len(self.passes)

    def of_pass(self, name: str) -> Ints:
        """Numbers of the frames of one pass, in order."""
        return np.array([i for i, row_pass in enumerate(self.passes) if row_pass == name], dtype=np.int64)


@dataclass(frozen=True, eq=False)
@array_record
class Trajectory:
    """Poses `world_from_rig` (n, 4, 4) of the `frames` (n,) whose pose is known, in the row's frame, m, and the
    standard deviation of the positions (n, 3) m, where that is known."""

    frames: Ints
    world_from_rig: Floats
    sigma_m: Floats | None = None

    def __post_init__(self) -> None:
        require(self.world_from_rig.shape == (len(self.frames), 4, 4), self, "world_from_rig must be (n, 4, 4)")

    @classmethod
    def joined(cls, paths: "Sequence[Trajectory]") -> "Trajectory":
        """Paths of different frames as one, without standard deviations."""
        frames = np.concatenate([path.frames for path in paths])
        return cls(frames, np.concatenate([path.world_from_rig for path in paths]))


@dataclass(frozen=True, eq=False)
@array_record
class RowFacts:
    """What a plugin is told of its row: its name, the frames, the views by name, and for each pass which way the camera
    went along the face (+1: towards +x, -1: towards -x, 0: not known); and whether its camera may not see all
    around."""

    name: str
    frames: FrameTable
    views: Mapping[str, ViewSpec]
    travel: Mapping[str, int]
    sees_in_part: bool = False
