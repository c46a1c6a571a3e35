"""Records of trust: what speaks against a row's map, and the verdict that follows from it."""

from dataclasses import dataclass
from typing import Literal

from savmap.types.common import require

DoubtKind = Literal["reference", "repeatability", "support", "shape", "camera", "motion", "residuals", "site"]
"""What a doubt comes from: a given value that the pictures contradict; odd and even frames that disagree; a structure that few of the
frames show that should; an implausible shape or place among its likes; what the footage is; how the camera went; measurements that do
not fit; rows that do not fit one another, or the places they were given."""


@dataclass(frozen=True)
class Doubt:
    """Something that speaks against a part of a map: `what` says what and where in one line, with what to do.

    `structures`: ids of those that it is about, none where it is about the whole row. `place` (3,) m in the row's frame, and `frame`,
    the number of one that shows it best, where that is known. `minor`: it is told as a note, and is no reason to check the map."""

    kind: DoubtKind
    what: str
    structures: tuple[str, ...] = ()
    place: tuple[float, float, float] | None = None
    frame: int | None = None
    minor: bool = False

    def __post_init__(self) -> None:
        require(bool(self.what.strip()) and "\n" not in self.what, self, "`what` must be one line")


@dataclass(frozen=True)
class Verdict:
    """Whether a row's map may be used as it is: where nothing speaks against it, it is `trusted`; otherwise a person should `check`
    what the doubts name. `notes`, one line each: what the verdict rests on that nothing checks; they are no doubts."""

    doubts: tuple[Doubt, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def grade(self) -> Literal["trusted", "check"]:
        """In one word."""
        return "check" if self.doubts else "trusted"
