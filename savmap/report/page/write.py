"""The page from a report: records put into templates, with style and script, written whole."""

import base64
import hashlib
from pathlib import Path
from typing import Any

from markupsafe import Markup

from savmap.files.atomic import write_bytes
from savmap.report.box_plot import box_plot
from savmap.report.page.alignment import alignment_facts, alignment_table
from savmap.report.page.comparison import row_changes
from savmap.report.page.errors import class_table, distance_table, row_errors
from savmap.report.page.sections import section, tiles
from savmap.report.page.site_plan import site_plan, without_place
from savmap.report.page.summary import Report, Summary, summaries
from savmap.report.page.tables import footage_table, reference_table, row_table
from savmap.report.page.ties import pair_table, tie_table
from savmap.report.page.times import stage_styles, stage_table, time_table
from savmap.report.page.uncertainty import sigma_table
from savmap.report.templating import rendered, resource
from savmap.types import Alignment, Score, pool


def write_page(report: Report, path: Path) -> None:
    """Write the report as one HTML file, whole or not at all. Raises OutputError."""
    write_bytes(path, page_text(report).encode())


def page_text(report: Report) -> str:
    """The page. It loads nothing, and only its own script may run in it (by its digest)."""
    rows = summaries(report)
    score = pool(report.evaluation.rows.values()) if report.evaluation else None
    script = resource("page.js")
    return rendered(
        "page.html.jinja",
        report=report,
        style=Markup(resource("figure.css") + resource("page.css")),
        script=Markup(script),
        digest=base64.b64encode(hashlib.sha256(script.encode()).digest()).decode(),
        tiles=tiles(report, rows, score),
        rows=row_table(rows),
        footage=footage_table(rows),
        failed=[row for row in rows if row.row is None],
        sections=[section(row) for row in rows],
        plan=site_plan(rows, report.site_map),
        unplaced=without_place(rows, report.site_map),
        references=reference_table(rows),
        sigmas=sigma_table(rows),
        changes=row_changes(report.comparison) if report.comparison else None,
        **_aligned(report.site_map.alignment),
        **_ties(report, rows),
        **_errors(report, rows, score),
        **_times(report, rows),
    )


def _aligned(alignment: Alignment | None) -> dict[str, Any]:
    if alignment is None:
        return {"alignment": None}
    return {"alignment": alignment_table(alignment), "stands": alignment_facts(alignment)}


def _errors(report: Report, rows: tuple[Summary, ...], score: Score | None) -> dict[str, Any]:
    if report.evaluation is None or score is None:
        return {"errors": None}
    return {
        "errors": class_table(score),
        "boxes": box_plot(report.evaluation),
        "distances": distance_table(score.apart),
        "row_errors": row_errors(rows),
    }


def _times(report: Report, rows: tuple[Summary, ...]) -> dict[str, Any]:
    if report.log is None:
        return {"stages": None}
    return {
        "stages": stage_table(report.log),
        "stage_styles": stage_styles(report.log),
        "times": time_table(rows, report.log),
    }


def _ties(report: Report, rows: tuple[Summary, ...]) -> dict[str, Any]:
    ties = report.site_map.matches
    anchors = {row.name: row.anchor for row in rows}
    return {"pairs": pair_table(ties), "ties": tie_table(ties, anchors)} if ties else {"pairs": None}
