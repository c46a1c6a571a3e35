"""The inspection of a row of racks."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from savmap.types import CloseUp, FaceDepths, Finding, JointCovariance, Measured, RowInspection, Structure
from savmap.types.inspection import Grade, severity
from savmap_shelves.inspection.acceptance import acceptance_findings
from savmap_shelves.inspection.fit import fit_findings, fit_table, fits_of, lost_table, without_levels
from savmap_shelves.inspection.limits import ShelvesLimits
from savmap_shelves.inspection.occupancy import LEAST_HEIGHT_M, occupancies_of, over_edge, slot_table
from savmap_shelves.inspection.shapes import BOW, LEAN, SAG
from savmap_shelves.report.slots import edge

NEW_LEAN = "out_of_plumb_permille"
"""The limit of a lean of a new rack: one of which a drawing is given."""
NOT_MEASURED = {
    LEAN: "whether uprights are plumb: map with the setting `plumb` of `shelves`",
    BOW: "whether uprights are straight: map with the setting `plumb` of `shelves`",
    SAG: "whether beams sag: map with the setting `plumb` of `shelves`",
}
NEVER = (
    "dents, cracks, twists and corrosion of uprights, beams and bracing",
    "locks of beams, anchors and base plates",
    "load signs, upright protectors and guard rails",
    "damage of decks and of what stands on them",
    "whether the racks were loaded when they were filmed, on which leans and sags depend",
    f"openings lower than {LEAST_HEIGHT_M:g} m, and goods on the floor in front of uprights",
)
"""What no map of racks tells."""
LOWEST_M, AROUND_M = 2.0, 0.2
"""Of an upright, what is shown: its height from the floor, and what is to its left and right."""
NO_DRAWING = "deviations from a drawing: none was given (--drawing)"
NO_LOADS = "which loads fit: no `load_units` are among the limits"
NO_PICTURES = "what is in the slots: the folder of the map has no pictures of the row (stages, face-*.jpg)"


def inspect(
    structures: Sequence[Structure],
    places: Sequence[Structure],
    joint: JointCovariance | None,
    limits: ShelvesLimits,
    survey: Mapping[str, Any] | None,
    depths: FaceDepths | None,
    plugin: str,
) -> RowInspection:
    """What keeps the limits. `places`: the plugin's. Raises OutputError for a drawing that is malformed."""
    levels = [place for place in places if place.label == "level"]
    fits = fits_of(levels, limits)
    occupied = occupancies_of(levels, depths) if depths is not None else []
    drawn = list(acceptance_findings(structures, joint, limits, survey, plugin)) if survey is not None else []
    measured = {key for structure in structures for key in NOT_MEASURED if key in structure.attributes}
    unchecked = [*NEVER, *(line for key, line in NOT_MEASURED.items() if key not in measured)]
    unchecked += [NO_DRAWING] if survey is None else []
    unchecked += without_levels(limits.load_units) if fits else [NO_LOADS]
    unchecked += [] if depths is not None else [NO_PICTURES]
    of_fits = (fit_table(fits), lost_table(fits)) if fits else ()
    of_lean = (*([NEW_LEAN] if survey is not None else []), LEAN)
    return RowInspection(
        (*_deformations(structures, limits, of_lean), *fit_findings(fits), *over_edge(occupied), *drawn),
        (*([slot_table(occupied)] if occupied else []), *of_fits),
        tuple(_close_ups(structures)),
        tuple(unchecked),
        (*(of_lean if LEAN in measured else ()), *(("load_units", "clearances") if fits else ())),
    )


def _close_ups(structures: Sequence[Structure]) -> Iterator[CloseUp]:
    """The lowest part of each upright, which trucks hit."""
    for upright in structures:
        if upright.label == "upright":
            (left, right), z = (edge(upright, 0, side).value for side in ("left", "right")), edge(upright, 2).value
            low, high = (left - AROUND_M, 0.0, z), (right + AROUND_M, LOWEST_M, z)
            yield CloseUp(upright.id, upright.id, np.array([low, high]))


def _deformations(structures: Sequence[Structure], limits: ShelvesLimits, of_lean: Sequence[str]) -> Iterator[Finding]:
    """How far uprights lean and are bowed, and beams sag, where that was measured. `of_lean`: the keys of the limits of
    a lean, of which that counts by which it is worse."""
    for structure in structures:
        lean, bow, sag = (structure.attributes.get(key) for key in (LEAN, BOW, SAG))
        length = float(np.ptp(structure.vertices[:, :2], axis=0).max())
        if isinstance(lean, Measured):
            finding = _finding(structure, "out-of-plumb", "leans along the aisle", "mm/m", length)
            worst = min((limits.graded(key, finding, lean) for key in of_lean), key=severity)
            yield _with_action(worst, "a plumb line", "the bay")
        if isinstance(bow, Measured):
            finding = _finding(structure, "upright-bow", "is bowed along the aisle", "mm/m", length)
            yield _with_action(limits.graded("bow_permille", finding, bow), "a straight edge", "the bay")
        if isinstance(sag, Measured):
            finding = _finding(structure, "beam-sag", "sags", "", length)
            share = Measured(sag.value / length, sag.sigma / length)
            yield _with_action(limits.graded("sag_share", finding, share), "a line", "it")


def _finding(structure: Structure, code: str, what: str, unit: str, length: float) -> Finding:
    """About a member's shape, without its value."""
    x, y, z = structure.vertices.mean(axis=0).tolist()
    title = f"{structure.id} {what}"
    return Finding(code, title, subjects=(structure.id,), unit=unit, place=(x, y, z), over_m=length)


def _with_action(finding: Finding, tool: str, unloaded: str) -> Finding:
    """What to do about a member out of shape, by grade."""
    actions: Mapping[Grade, str] = {
        "red": f"unload {unloaded}; measure it with {tool} before it is loaded again",
        "amber": f"measure it with {tool}, and have it set right if it is so",
        "unknown": f"measure it with {tool}",
    }
    return replace(finding, action=actions.get(finding.grade, ""))
