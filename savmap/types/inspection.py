"""Records of an inspection: what is found of a map's structures, how it stands to a limit, and what is shown of it."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from math import erf, isfinite, sqrt
from typing import Literal

import numpy as np

from savmap.types.common import Floats, Measured, array_record, require

Grade = Literal["red", "amber", "unknown", "green"]
GRADES: tuple[Grade, ...] = ("red", "amber", "unknown", "green")
"""From the worst on."""
SURE = 0.95
LIKELY = 0.5
"""Probabilities: red is what is surely bad, green what is surely in order, amber what is likely not."""


@dataclass(frozen=True)
class Finding:
    """One check of a row and its result.

    `code` names the check, `subjects` are the ids of what it is about. `value`, `sigma` and `limit` are in `unit`, None
    where nothing was measured; `probability` (0..1) is that the value lies beyond `limit`, or that the finding is true.
    `action`: what a person should do; `place` (x, y, z), m in the row's frame: where. `limit_key`, `limit_source`:
    which of the plugin's limits it is, and where that comes from. `over_m`: the length that a value in "mm/m", or as a
    share (no unit), is of.
    """

    code: str
    title: str
    grade: Grade = "unknown"
    subjects: tuple[str, ...] = ()
    value: float | None = None
    sigma: float | None = None
    limit: float | None = None
    unit: str = ""
    probability: float | None = None
    action: str = ""
    place: tuple[float, float, float] | None = None
    limit_key: str = ""
    limit_source: str = ""
    over_m: float | None = None

    def __post_init__(self) -> None:
        numbers = (self.value, self.sigma, self.limit, self.probability, self.over_m, *(self.place or ()))
        require(all(number is None or isfinite(number) for number in numbers), self, "its numbers must be finite")
        require(self.grade in GRADES, self, f"`grade` must be one of {', '.join(GRADES)}: {self.grade!r}")
        require(self.probability is None or 0 <= self.probability <= 1, self, "probability must be from 0 to 1")
        require(not any("\n" in text for text in (self.code, self.title, self.action)), self, "texts must be one line")


Cell = str | int | float | None


@dataclass(frozen=True)
class FindingTable:
    """A table that goes with an inspection: its name, which is a file's and the same in all rows, a title, columns with
    their units ("clear_width_m"), and lines of as many cells."""

    name: str
    title: str
    columns: tuple[str, ...]
    lines: tuple[tuple[Cell, ...], ...]

    def __post_init__(self) -> None:
        require(all(len(line) == len(self.columns) for line in self.lines), self, "each line has a cell a column")
        require(bool(re.fullmatch("[a-z0-9-]+", self.name)), self, f"`{self.name}`: a name is small letters and -")


@dataclass(frozen=True, eq=False)
@array_record
class CloseUp:
    """A part of a row that an inspector wants to see: the structure's id, what stands under the picture, and the lower
    left and upper right corner (2, 3) m of the part, in the row's frame."""

    subject: str
    title: str
    corners: Floats

    def __post_init__(self) -> None:
        require(self.corners.shape == (2, 3) and bool(np.isfinite(self.corners).all()), self, "corners (2, 3), finite")
        require(bool((np.ptp(self.corners[:, :2], axis=0) > 0).all()), self, "it has no width or no height")


@dataclass(frozen=True)
class RowInspection:
    """What a plugin says of its structures of a row: findings (what is in order, too), tables, parts to be shown, and
    what it does not check, one line each. `applied`: keys of limits that were applied, beside those that findings
    name."""

    findings: tuple[Finding, ...] = ()
    tables: tuple[FindingTable, ...] = ()
    close_ups: tuple[CloseUp, ...] = ()
    unchecked: tuple[str, ...] = ()
    applied: tuple[str, ...] = ()


@dataclass(frozen=True)
class AppliedLimit:
    """A limit that was applied: its key with the plugin's name, what it is about, its value in words, its source."""

    name: str
    meaning: str
    value: str
    source: str


@dataclass(frozen=True)
class Inspection:
    """An inspection of a map: `rows` by row and plugin, and the limits that were applied."""

    rows: Mapping[str, Mapping[str, RowInspection]]
    limits: tuple[AppliedLimit, ...] = field(default=())

    def parts(self) -> Iterator[tuple[str, str, RowInspection]]:
        """Row, plugin, and what the plugin says of the row."""
        for row, plugins in self.rows.items():
            for plugin, part in plugins.items():
                yield row, plugin, part

    def findings(self) -> list[tuple[str, str, Finding]]:
        """All findings with their row and plugin: the worst first, of one grade the most probable."""
        placed = [(row, plugin, finding) for row, plugin, part in self.parts() for finding in part.findings]
        return sorted(placed, key=lambda item: severity(item[2]))

    def counts(self) -> dict[Grade, int]:
        """How many findings have each grade."""
        grades = [finding.grade for _, _, finding in self.findings()]
        return {grade: grades.count(grade) for grade in GRADES}


def severity(finding: Finding) -> tuple[int, float]:
    """The less, the worse: by grade, of one grade the most probable first."""
    return GRADES.index(finding.grade), -(finding.probability or 0.0)


def graded(measured: Measured, amber: float, red: float) -> tuple[Grade, float, float]:
    """The grade of a normally distributed value, the limit that it is about, and the probability of a value beyond it.

    Values from `amber` to `red` need attention, those beyond `red` are bad; where `red` is the smaller, small values
    are bad. red: a value beyond `red` has a probability of more than `SURE`; green: one beyond `amber` has one of less
    than 1 - `SURE`; amber: one beyond `amber` is likelier than not; unknown: else, for it is measured too uncertainly.
    Raises ValueError where the limits are equal.
    """
    require(amber != red, measured, "amber and red limit must differ")
    past_amber, past_red = (_beyond(measured, limit, red > amber) for limit in (amber, red))
    if past_red > SURE:
        return "red", red, past_red
    return grade_of(past_amber), amber, past_amber


def grade_of(probability: float) -> Grade:
    """The grade of what needs attention with a probability, and of which nothing says that it is bad."""
    if probability < 1 - SURE:
        return "green"
    return "amber" if probability > LIKELY else "unknown"


def _beyond(measured: Measured, limit: float, above: bool) -> float:
    """The probability that the value is above, or below, a limit."""
    excess = measured.value - limit if above else limit - measured.value
    if measured.sigma == 0:
        return float(excess > 0)
    return 0.5 * (1 + erf(excess / (sqrt(2) * measured.sigma)))
