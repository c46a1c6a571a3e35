"""The page from a report: records put into templates, with style and script, written whole."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from markupsafe import Markup

from savmap.files.atomic import write_bytes
from savmap.report.box_plot import box_plot
from savmap.report.evaluation import mean_absolute_error, named_counts
from savmap.report.numbers import centimetres, duration, fixed
from savmap.report.orthophotos import photo_view
from savmap.report.page.footage import FootageView, footage_views
from savmap.report.page.site_plan import site_plan
from savmap.report.page.summary import Report, Summary, summaries, total_counts
from savmap.report.page.tables import (
    Table,
    alignment_facts,
    alignment_table,
    class_table,
    distance_table,
    footage_table,
    is_tie_off,
    openings_table,
    pair_table,
    reference_table,
    row_errors,
    row_table,
    stage_styles,
    stage_table,
    tie_table,
    time_table,
)
from savmap.report.page.uncertainty import hints, sigma_table
from savmap.report.row_views import drawn_in, row_view
from savmap.report.scene import Figure
from savmap.report.templating import rendered_page
from savmap.types import Picture, Placement, Score, pool


def write_page(report: Report, path: Path) -> None:
    """Write the report as one HTML file, whole or not at all. Raises OutputError."""
    write_bytes(path, page_text(report).encode())


def page_text(report: Report) -> str:
    """The page as HTML."""
    rows, log, alignment = summaries(report), report.log, report.site_map.alignment
    score = pool(report.evaluation.rows.values()) if report.evaluation else None
    ties, anchors = report.site_map.matches, {row.name: row.anchor for row in rows}
    return rendered_page(
        "page.html.jinja",
        report=report,
        tiles=tiles(report, rows, score),
        rows=row_table(rows),
        footage=footage_table(rows),
        failed=[row for row in rows if row.row is None],
        sections=[section(row) for row in rows],
        plan=site_plan(rows, report.site_map),
        unplaced=[row.name for row in rows if row.name not in report.site_map.placements],
        references=reference_table(rows),
        sigmas=sigma_table(rows),
        changes=Markup(report.changes.section(report.viewer)) if report.changes else "",
        alignment=alignment_table(alignment) if alignment else None,
        stands=alignment_facts(alignment) if alignment else None,
        pairs=pair_table(ties) if ties else None,
        ties=tie_table(ties, anchors) if ties else None,
        errors=class_table(score) if score else None,
        boxes=box_plot(report.evaluation) if report.evaluation else None,
        distances=distance_table(score.distances) if score else None,
        row_errors=row_errors(rows) if score else None,
        stages=stage_table(log) if log else None,
        stage_styles=stage_styles(log) if log else None,
        times=time_table(rows, log) if log else None,
    )


Facts = tuple[tuple[str, str], ...]
PICTURES: tuple[Picture, ...] = ("face", "plan")


@dataclass(frozen=True, eq=False)
class Section:
    """One row: what is known of it, the figures of its solve, its pictures, and its openings."""

    summary: Summary
    facts: Facts
    solve: Facts
    figures: tuple[Figure, ...]
    footage: tuple[FootageView, ...] = ()
    openings: Table | None = None


def section(row: Summary) -> Section:
    """A row's section, with the pictures in which something of it is drawn."""
    words = hints(row)
    figures = [
        row_view(row.row, row.drawings, picture, words, row.anchor)
        for picture in PICTURES
        if row.row and drawn_in(row.drawings, picture)
    ]
    if row.row and row.photo:
        figures.insert(1, photo_view(row.name, row.photo, row.drawings, words, row.anchor))
    footage = footage_views(row.row, row.stills) if row.row else ()
    solve = tuple(
        (name.replace("_", " "), fixed(value, 6) if isinstance(value, float) else str(value))
        for name, value in (row.row.report if row.row else {}).items()
    )
    return Section(row, _facts(row), solve, tuple(figures), footage, openings_table(row))


def tiles(report: Report, rows: Sequence[Summary], score: Score | None) -> Facts:
    """What the reader wants to know first: of the rows, the structures, the errors (`score`: all rows'), the
    references, the run."""
    mapped = [row for row in rows if row.row]
    failed = len(rows) - len(mapped)
    warned = sum(1 for row in mapped if row.warnings)
    with_verdict = sum(1 for row in mapped if row.row and row.row.verdict)
    lengths = [row.length_m for row in mapped if row.length_m is not None]
    references, off = sum(len(row.references) for row in mapped), sum(row.references_off for row in mapped)
    ties, ties_off = report.site_map.matches, sum(1 for tie in report.site_map.matches if is_tie_off(tie))
    facts = [("rows mapped", f"{len(mapped)} of {len(rows)}")]
    facts += [("failed", str(failed))] if failed else []
    facts += [("trusted / to be checked", f"{with_verdict - warned} / {warned}")] if with_verdict else []
    facts += [(label, str(count)) for label, count in total_counts(rows).items()]
    facts += [("length of all rows", f"{sum(lengths):.1f} m")] if lengths else []
    if score:
        facts += [("mean absolute error", f"{centimetres(mean_absolute_error(score))} cm")]
        facts += [("missing / spurious", f"{sum(score.missing.values())} / {sum(score.spurious.values())}")]
    facts += [("references, contradicted", f"{references}, {off}")] if references else []
    facts += [("ties between rows, off by > 3 \u03c3", f"{len(ties)}, {ties_off}")] if ties else []
    if report.log is not None:
        facts += [("time on the clock", duration(report.log.wall_s))]
        kept = sum(1 for row in report.log.rows.values() if row.status == "kept")
        facts += [("kept from earlier", str(kept))] if kept else []
    return tuple(facts)


def _facts(row: Summary) -> Facts:
    if row.row is None:
        return ()
    passes = ", ".join(dict.fromkeys(row.row.frames.passes))
    facts = [("structures", named_counts(row.counts))]
    facts += [("length", f"{row.length_m:.3f} m")] if row.length_m is not None else []
    facts += [("place in the site", _placed(row.place))] if row.place else []
    facts += [("frames", f"{len(row.row.trajectory.frames)} placed of {len(row.row.frames)}; {passes}")]
    references = f"{len(row.references)}, {row.references_off} contradicted"
    facts += [("references", references)] if row.references else []
    if row.score:
        facts += [("mean absolute error", f"{centimetres(row.error_m)} cm")]
        facts += [("missing; spurious", f"{named_counts(row.score.missing)}; {named_counts(row.score.spurious)}")]
    return tuple(facts)


def _placed(place: Placement) -> str:
    x, z, heading = (float(sigma) for sigma in np.sqrt(np.diag(place.covariance)))
    metres = f"x {fixed(place.x_m, 3)} \u00b1 {fixed(x, 3)} m, z {fixed(place.z_m, 3)} \u00b1 {fixed(z, 3)} m"
    return f"{metres}, heading {fixed(place.heading_deg, 2)} \u00b1 {fixed(heading, 2)}\u00b0"
