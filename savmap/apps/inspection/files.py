"""An inspection as files: the page, CSV for spreadsheets, JSON for programs."""

import csv
import io
from collections.abc import Iterable, Sequence
from dataclasses import asdict, replace
from itertools import product
from pathlib import Path
from typing import Any
from urllib.parse import quote

from savmap.apps.inspection.inspect import unchecked_of
from savmap.apps.inspection.page import InspectionPage, form_text, page_text, tables_of
from savmap.apps.inspection.sheets import write_sheets
from savmap.errors import OutputError
from savmap.files.atomic import write_bytes, write_text
from savmap.maps.exports.files import json_text
from savmap.maps.exports.marks import BETWEEN
from savmap.maps.exports.vertices import cell
from savmap.types import Finding, Inspection

FORMAT, VERSION = "savmap-inspection", 1
COLUMNS = (
    *("row", "plugin", "code", "grade", "title", "subjects", "value", "sigma", "limit", "unit", "probability"),
    *("action", "x_m", "y_m", "z_m", "limit_key", "limit_source", "over_m"),
)
DECIMALS = 5


def write_inspection(page: InspectionPage, path: Path, inputs: Sequence[Path] = ()) -> list[Path]:
    """Write the page, and, with the same beginning of their names, the form to fill in, findings as CSV and JSON, each
    table as CSV, and the sheets of pictures with a folder of them; the paths. Raises OutputError, also where one of the
    inputs would be written over."""
    if path.suffix.lower() not in (".html", ".htm"):
        raise OutputError(f"{path}: an inspection is an HTML page; name it .html")
    inspection = page.inspection
    form = path.with_name(f"{path.stem}-form.html")
    texts = {
        form: form_text(page),
        path.with_suffix(".csv"): _csv(COLUMNS, (_cells(*placed) for placed in inspection.findings())),
        path.with_suffix(".json"): json_text(_content(inspection)),
    }
    for (plugin, name), tables in tables_of(inspection).items():
        columns = list(dict.fromkeys(column for _, table in tables for column in table.columns))
        lines = [
            (row, *map(dict(zip(table.columns, line, strict=True)).get, columns))
            for row, table in tables
            for line in table.lines
        ]
        texts[path.with_name(f"{path.stem}-{plugin}-{name}.csv")] = _csv(("row", *columns), lines)
    for file, source in product((path, *texts), inputs):
        if file.exists() and source.exists() and file.samefile(source):
            raise OutputError(f"{file}: would be written, and is read; give the page another name")
    for file, text in texts.items():
        write_text(file, text)
    sheets, *pictures = write_sheets(page, path.with_name(f"{path.stem}-sheets.html")) or (None,)
    linked = replace(page, sheets=quote(sheets.name) if sheets else "", form=quote(form.name))
    write_bytes(path, page_text(linked).encode())
    return [path, *texts, *([sheets, pictures[0].parent] if sheets else [])]


def _cells(row: str, plugin: str, finding: Finding) -> Sequence[object]:
    place = finding.place or (None, None, None)
    named = (row, plugin, finding.code, finding.grade, finding.title, BETWEEN.join(finding.subjects))
    numbers = (finding.value, finding.sigma, finding.limit)
    by = finding.limit_key, finding.limit_source, finding.over_m
    return (*named, *numbers, finding.unit, finding.probability, finding.action, *place, *by)


def _csv(columns: Sequence[str], lines: Iterable[Sequence[object]]) -> str:
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(columns)
    table.writerows([_text(value) for value in line] for line in lines)
    return text.getvalue()


def _text(value: object) -> str:
    if isinstance(value, float):
        return f"{round(value, DECIMALS) + 0.0:g}"
    return "" if value is None else cell(value) if isinstance(value, str) else str(value)


def _content(inspection: Inspection) -> dict[str, Any]:
    """All of an inspection but pictures, for JSON."""
    return {
        "format": FORMAT,
        "version": VERSION,
        "counts": inspection.counts(),
        "findings": [
            dict(zip(COLUMNS, _cells(*placed), strict=True)) | {"subjects": list(placed[2].subjects)}
            for placed in inspection.findings()
        ],
        "tables": [
            {"row": row, "plugin": plugin, "name": table.name, "columns": table.columns, "lines": table.lines}
            for row, plugin, part in inspection.parts()
            for table in part.tables
        ],
        "limits": [asdict(limit) for limit in inspection.limits],
        "unchecked": list(unchecked_of(inspection)),
    }
