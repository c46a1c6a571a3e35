"""The page from a report: templates filled, style and script put in, written whole."""

import base64
import hashlib
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from savmap.evaluation import pool
from savmap.files.atomic import write_bytes
from savmap.report.page.boxes import box_plot
from savmap.report.page.errors import class_table, distance_table, headline, row_errors
from savmap.report.page.rowtable import reference_table, row_table
from savmap.report.page.sections import section, tiles
from savmap.report.page.siteplan import site_plan, without_place
from savmap.report.page.spread import spread_table
from savmap.report.page.summary import Summary, summaries
from savmap.report.page.ties import pair_table, tie_table
from savmap.report.page.times import stage_looks, stage_table, time_table
from savmap.report.record import Report

_CONTROLS = dict.fromkeys(code for code in (*range(32), *range(127, 160)) if code not in (9, 10))


def write_page(report: Report, path: Path) -> None:
    """Write the report as one HTML file, whole or not at all. Raises OutputError."""
    write_bytes(path, page_text(report).encode("utf-8", "replace"))


def page_text(report: Report) -> str:
    """The page. It asks nothing of the network, and its script alone may run in it (by its digest)."""
    rows = summaries(report.site_map, report.drawings, report.log, report.evaluation)
    script = _resource("page.js")
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    text = (
        _environment()
        .get_template("page.html.jinja")
        .render(
            report=report,
            style=Markup(_resource("page.css")),
            script=Markup(script),
            digest=digest,
            tiles=tiles(report, rows),
            rows=row_table(rows),
            failed=[row for row in rows if row.row is None],
            sections=[section(row) for row in rows],
            plan=site_plan(rows, report.site_map),
            unplaced=without_place(rows, report.site_map),
            references=reference_table(rows),
            spread=spread_table(rows),
            **_tied(report, rows),
            **_scored(report, rows),
            **_timed(report, rows),
        )
    )
    return text.translate(_CONTROLS)


def _scored(report: Report, rows: tuple[Summary, ...]) -> dict[str, Any]:
    if report.evaluation is None:
        return {"errors": None}
    score = pool(report.evaluation.rows.values())
    return {
        "errors": class_table(report.evaluation),
        "error_headline": headline(score),
        "boxes": box_plot(report.evaluation),
        "distances": distance_table(score.apart),
        "row_errors": row_errors(rows),
    }


def _timed(report: Report, rows: tuple[Summary, ...]) -> dict[str, Any]:
    if report.log is None:
        return {"stages": None}
    return {
        "stages": stage_table(report.log),
        "stage_looks": stage_looks(report.log),
        "times": time_table(rows, report.log),
    }


def _tied(report: Report, rows: tuple[Summary, ...]) -> dict[str, Any]:
    ties = report.site_map.matches
    anchors = {row.name: row.anchor for row in rows}
    return {"pairs": pair_table(ties), "ties": tie_table(ties, anchors)} if ties else {"pairs": None}


@cache
def _environment() -> Environment:
    return Environment(
        loader=PackageLoader("savmap.report.page"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def _resource(name: str) -> str:
    return (files("savmap.report.page") / "templates" / name).read_text(encoding="utf-8")
