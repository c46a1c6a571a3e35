"""Records of trust: what speaks against a row's map, and the verdict that follows from it."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from savmap.types.common import require

DoubtKind = Literal["reference", "repeatability", "support", "shape", "camera", "motion", "residuals", "site"]
"""What a doubt comes from: a given value that the pictures contradict; odd and even frames that disagree; a structure
that few of the frames show that should; an implausible shape or place among its likes; what the footage is; how the
camera went; measurements that do not fit; rows that do not fit one another, or the places they were given."""

MOST_WORDS = 8
"""Of a headline."""
NAMED = 2
"""Of those that a doubt about several is about."""
COUNTED = {"reference": "references", "motion": "times", "camera": "passes", "site": "rows", "residuals": "classes"}
SIZE = re.compile(r"(\d+\.?\d*) (?:m|cm|mm|degrees) (?:off|apart)\b")
"""A figure of which the largest is the worst."""


@dataclass(frozen=True)
class Doubt:
    """Something that speaks against a part of a map: a `headline` of at most eight words that says what, without names,
    so that doubts of one cause have the same; one `figure` with its unit, "" where there is none; and an `action`, an
    imperative sentence that ends with a colon and the names that it is about, where it is about any. `details`: further
    lines, for those who ask.

    `structures`: ids of those that it is about, none where it is about the whole row. `place` (3,) m in the row's
    frame, and `frame`, the number of one that shows it best, where that is known. `minor`: it is told as a note, and is
    no reason to check the map."""

    kind: DoubtKind
    headline: str
    structures: tuple[str, ...] = ()
    place: tuple[float, float, float] | None = None
    frame: int | None = None
    minor: bool = False
    figure: str = ""
    action: str = ""
    details: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        words = len(self.headline.split())
        require(0 < words <= MOST_WORDS, self, f"`headline` must have 1 to {MOST_WORDS} words: {self.headline!r}")
        texts = (self.headline, self.figure, self.action, *self.details)
        require(not any("\n" in text for text in texts), self, "each of its texts must be one line")

    @property
    def line(self) -> str:
        """All but the details."""
        what = f"{self.headline}: {self.figure}" if self.figure else self.headline
        return f"{what}; {self.action}" if self.action else what

    @property
    def of_row(self) -> bool:
        """Whether it is about the whole row: about no structures, nor whether something is missing at a place."""
        return not self.structures and (self.place is None or self.kind not in ("shape", "support"))


def by_cause(doubts: Sequence[Doubt]) -> tuple[Doubt, ...]:
    """The doubts, those of one cause as one: they are of one kind and have the same headline. Its figure is how many
    they are, and the worst one's; its details are their lines."""
    causes: dict[tuple[str, str], list[Doubt]] = {}
    for doubt in doubts:
        causes.setdefault((doubt.kind, doubt.headline), []).append(doubt)
    return tuple(alike[0] if len(alike) == 1 else _as_one(alike) for alike in causes.values())


def _as_one(alike: Sequence[Doubt]) -> Doubt:
    sizes = [float(size[1]) if (size := SIZE.match(doubt.figure)) else None for doubt in alike]
    measured = [size for size in sizes if size is not None]
    worst = alike[sizes.index(max(measured))] if len(measured) == len(alike) else alike[0]
    structures = tuple(dict.fromkeys(name for doubt in alike for name in doubt.structures))
    each = all(len(doubt.structures) == 1 for doubt in alike)
    noun = "elements" if each else "places" if structures else COUNTED.get(alike[0].kind, "places")
    count = f"{len(structures) if each else len(alike)} {noun}"
    return replace(
        worst,
        structures=structures,
        figure=f"{count}, up to {worst.figure}" if len(measured) == len(alike) else count,
        action=_common_action(dict.fromkeys(doubt.action for doubt in alike)),
        details=tuple(dict.fromkeys(line for doubt in alike for line in (doubt.line, *doubt.details))),
    )


def _common_action(actions: Iterable[str]) -> str:
    """What to do about all: where actions differ in what they name alone, with the first names."""
    parts = [action.partition(": ") for action in actions]
    if len(parts) == 1 or len({head for head, _, _ in parts}) > 1:
        return "".join(parts[0])
    names, more = [name for _, _, name in parts[:NAMED]], len(parts) - NAMED
    return f"{parts[0][0]}: {', '.join(names)}{f' and {more} more' if more else ''}"


@dataclass(frozen=True)
class Verdict:
    """Whether a row's map may be used as it is: where nothing speaks against it, it is `trusted`; otherwise a person
    should `check` what the doubts name. `notes`, one line each: what the verdict rests on that nothing checks; they are
    no doubts."""

    doubts: tuple[Doubt, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def grade(self) -> Literal["trusted", "check"]:
        """In one word."""
        return "check" if self.doubts else "trusted"
