"""Deviations of a rack from its drawing, in EN 15620's terms: clear widths of bays, heights of beams, what is missing
and what is there in excess."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from savmap.plugin.inspection import Limit
from savmap.types import Finding, JointCovariance, Measured, Structure
from savmap_shelves.inspection.limits import ShelvesLimits
from savmap_shelves.mapping import MappedSection, sections_of, uprights_of
from savmap_shelves.report.evaluation import (
    SurveyedRow,
    Warp,
    align_beams,
    align_uprights,
    extents_of,
    holds_shelves,
    partners,
    read_row,
)
from savmap_shelves.report.slots import edge, gap, is_assumed

MM = 1000.0


@dataclass(frozen=True, eq=False)
class MappedRow:
    """The row's structures by id, the errors that they share, and the plugin's name in the map."""

    parts: Mapping[str, Structure]
    joint: JointCovariance | None
    plugin: str


def acceptance_findings(
    structures: Sequence[Structure],
    joint: JointCovariance | None,
    limits: ShelvesLimits,
    survey: Mapping[str, Any],
    plugin: str,
) -> Iterator[Finding]:
    """A finding for each bay and beam of a drawing that the map has too, and for what one of them lacks. Raises
    OutputError for a drawing that is malformed."""
    if not holds_shelves(survey):
        return
    surveyed = read_row(survey)
    row = MappedRow({part.id: part for part in structures}, joint, plugin)
    mapped = uprights_of(structures)
    pairs = align_uprights(surveyed.upright_intervals(), mapped.intervals)
    warp = Warp(surveyed.upright_intervals(), mapped.intervals, pairs)
    yield from _widths(surveyed, mapped.ids, pairs, row, limits)
    matched = dict(pairs)
    first, last = (min(matched), max(matched)) if matched else (0, -1)
    for k in range(first, last + 1):
        if k not in matched:
            yield _missing(f"upright {k + 1} of the drawing", None)
    for j, name in enumerate(mapped.ids):
        if j not in matched.values() and warp.inside(mapped.intervals[j]):
            yield _excess(row.parts[name])
    sections = sections_of(structures)
    for k, j in partners(surveyed.section_intervals(), extents_of(sections, warp)).items():
        yield from _beams(surveyed, k, sections[j], row, limits)


def _widths(
    surveyed: SurveyedRow, ids: Sequence[str], pairs: Sequence[tuple[int, int]], row: MappedRow, limits: ShelvesLimits
) -> Iterator[Finding]:
    """The clear width of each bay whose uprights are both matched, and have nothing between them."""
    truth = surveyed.section_intervals()
    for (i, j), (next_i, next_j) in pairwise(pairs):
        if (next_i - i, next_j - j) == (1, 1):
            left, right = row.parts[ids[j]], row.parts[ids[next_j]]
            width = gap(row.joint, row.plugin, (left, "right"), (right, "left"), 0)
            drawn = float(truth[i, 1] - truth[i, 0])
            title = f"clear width between {left.id} and {right.id}: {MM * drawn:.0f} mm in the drawing"
            place = tuple(((left.vertices + right.vertices) / 2).mean(axis=0).tolist())
            finding = Finding(
                "bay-width", title, subjects=(left.id, right.id), unit="mm", action="measure it by hand", place=place
            )
            yield limits.graded("bay_width_mm", finding, Measured(MM * (width.value - drawn), MM * width.sigma))


def _beams(
    surveyed: SurveyedRow, k: int, section: MappedSection, row: MappedRow, limits: ShelvesLimits
) -> Iterator[Finding]:
    """The heights of a bay's beams: the lowest above the floor, the others above the lowest that is matched."""
    truth, names = surveyed.beam_intervals(k), section.beams.ids
    pairs = align_beams(truth, section.beams.intervals)
    lowest: tuple[float, Structure] | None = None
    for i, j in pairs:
        beam, drawn = row.parts[names[j]], float(truth[i, 1])
        if lowest is None:
            lowest = drawn, beam
            height, (key, limit) = edge(beam, 1, "upper"), ("lowest_beam_mm", limits.lowest_beam_mm)
        else:
            height, drawn = gap(row.joint, row.plugin, (lowest[1], "upper"), (beam, "upper"), 1), drawn - lowest[0]
            key, limit = _of_height(limits, drawn)
        title = f"top of {beam.id}: {MM * drawn:.0f} mm above the {'floor' if lowest[1] is beam else 'lowest'} drawn"
        place = tuple(beam.vertices.mean(axis=0).tolist())
        finding = Finding(
            "beam-height",
            title,
            subjects=(beam.id,),
            unit="mm",
            action="measure it by hand",
            place=place,
            limit_key=key,
        )
        assumed = is_assumed(beam, "upper", row.plugin, row.joint)
        yield finding if assumed else limit.finding(finding, Measured(MM * (height.value - drawn), MM * height.sigma))
    for i in sorted(set(range(len(truth))) - {i for i, _ in pairs}):
        yield _missing(f"beam {i + 1} of bay {k + 1} of the drawing", None)
    for j in sorted(set(range(len(names))) - {j for _, j in pairs}):
        yield _excess(row.parts[names[j]])


def _of_height(limits: ShelvesLimits, height_m: float) -> tuple[str, Limit]:
    """The limit of a beam so high above the lowest, and its key."""
    share_mm = MM * limits.beam_height_share * abs(height_m)
    limit = limits.beam_height_mm
    if share_mm <= limit.amber:
        return "beam_height_mm", limit
    return "beam_height_share", Limit(amber=share_mm, red=2 * share_mm, source=limit.source)


def _missing(name: str, place: tuple[float, float, float] | None) -> Finding:
    return Finding(
        "missing-element", f"{name} is not in the map", "amber", action="look whether it is there", place=place
    )


def _excess(part: Structure) -> Finding:
    place = tuple(part.vertices.mean(axis=0).tolist())
    title = f"{part.id} is not in the drawing"
    return Finding("element-in-excess", title, "amber", (part.id,), action="look whether it is there", place=place)
