"""A section for each row, and the figures at the head of the page."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from savmap.evaluation import mean_absolute_error, pool
from savmap.report.page.figures import Figure
from savmap.report.page.numbers import centimetres, counted, duration, fixed
from savmap.report.page.rowviews import face_view, plan_view
from savmap.report.page.summary import Summary, all_counts, is_off
from savmap.report.page.ties import is_tie_off
from savmap.report.page.words import said_of
from savmap.report.record import Report
from savmap.types import Placement

Facts = tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Section:
    """One row: what is known of it, the figures of its solve, and its pictures."""

    summary: Summary
    facts: Facts
    solve: Facts
    pictures: tuple[Figure, ...]


def section(row: Summary) -> Section:
    """A row's section."""
    said = said_of(row.row, row.score) if row.row else {}
    pictures = tuple(one for one in (face_view(row, said), plan_view(row, said)) if one is not None)
    return Section(row, _facts(row), _solve(row), pictures)


def tiles(report: Report, rows: Sequence[Summary]) -> Facts:
    """What one wants to know first: of the rows, the structures, the errors, the references, the run."""
    mapped = [row for row in rows if row.row]
    failed = len(rows) - len(mapped)
    counts = all_counts(rows)
    lengths = [row.length_m for row in mapped if row.length_m is not None]
    references = [own for row in mapped for own in row.references]
    off = sum(1 for own in references if is_off(own))
    ties, tie_off = report.site_map.matches, sum(1 for own in report.site_map.matches if is_tie_off(own))
    found: list[tuple[str, str]] = [("rows mapped", f"{len(mapped)} of {len(rows)}")]
    found += [("failed", str(failed))] if failed else []
    found += [(label, str(count)) for label, count in counts.items()]
    found += [("length of all rows", f"{sum(lengths):.1f} m")] if lengths else []
    if report.evaluation:
        score = pool(report.evaluation.rows.values())
        found += [("mean absolute error", f"{centimetres(mean_absolute_error(score))} cm")]
        found += [("missing / spurious", f"{sum(score.missing.values())} / {sum(score.spurious.values())}")]
    found += [("references, off by > 3 \u03c3", f"{len(references)}, {off}")] if references else []
    found += [("ties between rows, off by > 3 \u03c3", f"{len(ties)}, {tie_off}")] if ties else []
    return (*found, *_run_tiles(report))


def _run_tiles(report: Report) -> Facts:
    log = report.log
    if log is None:
        return ()
    memory = max((row.peak_mb for row in log.rows.values()), default=0.0)
    kept = sum(1 for row in log.rows.values() if row.status == "kept")
    found = [("time on the clock", duration(log.wall_s)), ("workers", str(log.jobs))]
    found += [("kept from earlier", str(kept))] if kept else []
    return (*found, *([("memory of a worker, at most", f"{memory:.0f} MB")] if memory else []))


def _facts(row: Summary) -> Facts:
    if row.row is None:
        return ()
    passes = ", ".join(dict.fromkeys(row.row.frames.passes))
    off = sum(1 for own in row.references if is_off(own))
    found = [("structures", counted(row.counts))]
    found += [("length", f"{row.length_m:.3f} m")] if row.length_m is not None else []
    found += [("place in the site", _placed(row.place))] if row.place else []
    found += [("frames", f"{len(row.row.trajectory.frames)} placed of {len(row.row.frames)}; {passes}")]
    found += [("references", f"{len(row.references)}, {off} off by more than 3 \u03c3")] if row.references else []
    if row.score:
        found += [("mean absolute error", f"{centimetres(row.error_m)} cm")]
        found += [("missing; spurious", f"{counted(row.score.missing)}; {counted(row.score.spurious)}")]
    return tuple(found)


def _placed(place: Placement) -> str:
    x, z, heading = np.sqrt(np.diag(place.covariance))
    metres = (
        f"{axis} {fixed(value, 3)} \u00b1 {fixed(float(sigma), 3)} m"
        for axis, value, sigma in (("x", place.x_m, x), ("z", place.z_m, z))
    )
    return ", ".join(metres) + f", heading {fixed(place.heading_deg, 2)} \u00b1 {fixed(float(heading), 2)}\u00b0"


def _solve(row: Summary) -> Facts:
    figures = row.row.report if row.row else {}
    return tuple(
        (name.replace("_", " "), fixed(value, 6) if isinstance(value, float) else str(value))
        for name, value in figures.items()
    )
