"""Which slots take which load units, with the probability that they do, and how much height is lost."""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import erf, floor, hypot, sqrt

from savmap.types import Finding, FindingTable, Measured, Structure
from savmap.types.inspection import SURE, Cell, Grade, grade_of
from savmap_shelves.inspection.limits import Clearance, LoadUnit, ShelvesLimits

ALLOWANCE_M = 0.02
"""A count of loads that a bay misses by less is tried: its probability tells."""
LIKELY = 0.5
UNLIMITED = "height not limited by the map"
Spare = tuple[float, float]


@dataclass(frozen=True)
class Fit:
    """A load unit in a slot: how many beside one another, the probability that they fit, and what width and height
    are left then, m (None: the width is not known, or the map has nothing above the slot)."""

    slot: Structure
    unit: LoadUnit
    count: int
    probability: float
    free_width: Measured | None
    free_height: Measured | None

    @property
    def too_wide(self) -> bool:
        """Whether the width that is left is surely negative, whatever the height is."""
        return self.free_width is not None and 1 - _positive(self.free_width) > SURE

    @property
    def note(self) -> str:
        """What of the slot's sizes the map does not measure."""
        return UNLIMITED if self.free_height is None else str(self.slot.attributes.get("assumed", ""))


def fits_of(levels: Sequence[Structure], limits: ShelvesLimits) -> list[Fit]:
    """Every load unit in every slot, such as "bay 3 / level 2" of the plugin's places."""
    return [_fit(level, unit, limits.clearances) for level in levels for unit in limits.load_units]


def _fit(slot: Structure, unit: LoadUnit, clearances: Sequence[Clearance]) -> Fit:
    width, height = _size(slot, "clear_width_m"), _size(slot, "clear_height_m")
    load_height = float(slot.vertices[:, 1].min())
    clearance = next((rule for rule in clearances if load_height <= rule.up_to_m), None)
    lateral, above = (clearance.beside_m, clearance.above_m) if clearance else (0.0, 0.0)
    count = unit.across or max(_count(width, unit.width_m, lateral), 1)
    needed = count * unit.width_m + (count + 1) * lateral
    free_width = None if width is None else Measured(width.value - needed, width.sigma)
    free_height = None if height is None else Measured(height.value - unit.height_m - above, height.sigma)
    sides = [_positive(free) for free in (free_width, free_height) if free is not None]
    probability = sides[0] * sides[-1] if len(sides) == 2 else sides[0] if sides else 0.0
    return Fit(slot, unit, count, probability if width else 0.0, free_width, free_height)


def _size(slot: Structure, name: str) -> Measured | None:
    size = slot.attributes.get(name)
    return size if isinstance(size, Measured) else None


def _count(width: Measured | None, unit_m: float, beside_m: float) -> int:
    """As many as a width takes, and one more where hardly anything is missing."""
    return 0 if width is None else max(floor((width.value + ALLOWANCE_M - beside_m) / (unit_m + beside_m)), 0)


def _positive(free: Measured) -> float:
    """The probability that a length is positive."""
    return float(free.value >= 0) if free.sigma == 0 else 0.5 * (1 + erf(free.value / (sqrt(2) * free.sigma)))


FIT_COLUMNS = (
    *("bay", "level", "load_unit", "count", "probability"),
    *("free_width_m", "sigma_free_width_m", "free_height_m", "sigma_free_height_m", "note"),
)


def fit_table(fits: Sequence[Fit]) -> FindingTable:
    """A line for each slot and load unit; no probability where nothing limits the height and the width does not rule it
    out."""
    lines = tuple(
        (
            *_numbers(fit.slot),
            fit.unit.name,
            fit.count,
            None if fit.free_height is None and not fit.too_wide else round(fit.probability, 4),
            *_cells(fit.free_width),
            *_cells(fit.free_height),
            fit.note,
        )
        for fit in fits
    )
    return FindingTable("fit", "Which slots take which load units", FIT_COLUMNS, lines)


def lost_table(fits: Sequence[Fit]) -> FindingTable:
    """The height that is lost in each bay: what is free above the highest load unit that each of its levels takes, of
    levels between two beams."""
    free: dict[int, dict[int, Measured]] = defaultdict(dict)
    for fit in fits:
        bay, level = _numbers(fit.slot)
        taken = level and fit.free_height is not None and fit.probability >= LIKELY
        if taken and fit.free_height and fit.free_height.value <= free[bay].get(level, fit.free_height).value:
            free[bay][level] = fit.free_height
    lines = tuple(
        (
            bay,
            len(levels),
            *_cells(Measured(sum(map(float, levels.values())), hypot(*(f.sigma for f in levels.values())))),
        )
        for bay, levels in free.items()
        if levels
    )
    return FindingTable("lost-height", "Height lost in each bay", ("bay", "levels", "lost_m", "sigma_lost_m"), lines)


def _numbers(slot: Structure) -> tuple[int, int]:
    return int(float(slot.attributes["bay"])), int(float(slot.attributes["level"]))


def _cells(size: Measured | None) -> tuple[Cell, Cell]:
    return (None, None) if size is None else (round(size.value, 4), round(size.sigma, 5))


def fit_findings(fits: Sequence[Fit]) -> Iterator[Finding]:
    """A finding for each slot that must take a load unit: green where it surely does, red where it surely does not; and
    for each level that must take one and that no bay has."""
    for fit in fits:
        if _numbers(fit.slot)[1] in fit.unit.levels:
            yield _fit_finding(fit)
    levels = {_numbers(fit.slot)[1] for fit in fits}
    for unit in dict.fromkeys(fit.unit for fit in fits):
        for level in sorted(set(unit.levels) - levels):
            title = f"{unit.name} on level {level}: no bay of the row has such a level"
            yield Finding("no-such-level", title, action="look whether the limits or the map are wrong")


def without_levels(units: Sequence[LoadUnit]) -> list[str]:
    """What is not checked of load units that nothing must take."""
    return [f"whether {unit.name} fits: the limits give it no `levels`" for unit in units if not unit.levels]


ACTIONS: Mapping[Grade, str] = {
    "red": "do not store it there",
    "amber": "measure the slot by hand before it is used",
    "unknown": "measure the slot by hand before it is used",
}


def _fit_finding(fit: Fit) -> Finding:
    grade, missing = _grade(fit)
    sizes = {"width": fit.free_width} if fit.too_wide else {"width": fit.free_width, "height": fit.free_height}
    side, free = min(
        ((side, size) for side, size in sizes.items() if size), key=lambda item: item[1].value, default=("", None)
    )
    left = f"{side} left" if free else "width not measured"
    note = f"; {fit.note}" if fit.note and not fit.too_wide else ""
    x, y, z = fit.slot.vertices.mean(axis=0).tolist()
    return Finding(
        "load-does-not-fit",
        f"{fit.count} x {fit.unit.name} in {fit.slot.id}: {left}{note}",
        grade,
        (fit.slot.id,),
        None if free is None else free.value,
        None if free is None else free.sigma,
        0.0,
        "m",
        missing,
        ACTIONS.get(grade, ""),
        (x, y, z),
        "load_units",
        "load unit and clearances of the limits",
    )


def _grade(fit: Fit) -> tuple[Grade, float]:
    """The grade, and the probability that the load unit does not fit."""
    if fit.too_wide and fit.free_width:
        return "red", 1 - _positive(fit.free_width)
    missing = 1 - fit.probability
    if fit.free_width is None or fit.slot.attributes.get("assumed"):
        return "unknown", missing
    return ("red" if missing > SURE else grade_of(missing)), missing
