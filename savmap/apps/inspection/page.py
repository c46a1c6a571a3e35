"""The page of an inspection: counts, the worst findings with pictures, tables, limits, and what nobody checked."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path

from savmap.apps.inspection.inspect import unchecked_of
from savmap.apps.inspection.pictures import FacePictures
from savmap.apps.inspection.words import FindingText, text_of
from savmap.files.atomic import sha256
from savmap.report.numbers import fixed
from savmap.report.page.tables import Cell, Line, Table, heads, number_cell
from savmap.report.site_report import StructuresByRow, log_beside
from savmap.report.templating import jpeg_address, rendered_page
from savmap.types import Finding, FindingTable, Inspection, Orthophoto, SiteMap, Structure

WORST = 10
UNCHECKED = (
    "how far anything leans or is shifted across the aisle: one pass measures nothing at right angles to a face",
)
"""Whatever the plugins check."""
LINE_STYLES = {"red": "failed", "amber": "off"}


@dataclass(frozen=True, eq=False)
class InspectionPage:
    """What the page shows: the map, its inspection, orthophotos by row, places by row and plugin, the address of the
    sheets, where there are any, what is said of map and limits, names and values, and the address of the
    form to fill in."""

    site_map: SiteMap
    inspection: Inspection
    photos: Mapping[str, Orthophoto] = field(default_factory=dict)
    places: StructuresByRow = field(default_factory=dict)
    title: str = "Inspection"
    sheets: str = ""
    header: tuple[tuple[str, str], ...] = ()
    form: str = ""


@dataclass(frozen=True)
class WorstFinding:
    """A finding of the front page: what is written of it, and the address of its picture, "" for none."""

    text: FindingText
    picture: str


def page_text(page: InspectionPage) -> str:
    """The page as HTML."""
    counts = page.inspection.counts()
    return rendered_page(
        "inspection.html.jinja",
        __package__,
        page=page,
        tiles=[(grade, str(count)) for grade, count in counts.items()],
        worst=list(_worst(page)),
        findings=findings_table(page.inspection),
        tables=[_table(name, tables) for name, tables in tables_of(page.inspection).items()],
        never=UNCHECKED,
        unchecked=unchecked_of(page.inspection),
    )


FORM_COLUMNS = (
    *("row", "grade", "finding", "along row, m", "height, m", "value", "limit"),
    *("on site", "decision", "deadline", "remarks"),
)


def form_text(page: InspectionPage) -> str:
    """The form that an inspector fills in and puts a name to, as HTML: all that is not in order, with boxes."""
    return rendered_page(
        "inspection-form.html.jinja",
        __package__,
        page=page,
        tiles=list(page.inspection.counts().items()),
        findings=[text_of(row, finding) for row, finding in _poor(page.inspection)],
        unchecked=[*UNCHECKED, *unchecked_of(page.inspection)],
        heads=FORM_COLUMNS,
        lines=("site", "filmed on", "name", "qualification", "date of the inspection", "signature"),
    )


def _worst(page: InspectionPage) -> Iterator[WorstFinding]:
    """The worst that are not in order."""
    pictures: dict[str, FacePictures] = {}
    for row, finding in _poor(page.inspection)[:WORST]:
        if row in page.photos and row not in pictures:
            pictures[row] = FacePictures(page.photos[row])
        part = pictures[row].finding(finding, elements_of(page, row)) if row in pictures else None
        address = jpeg_address(part.content) if part else ""
        yield WorstFinding(text_of(row, finding), address)


def elements_of(page: InspectionPage, row: str) -> dict[str, Structure]:
    """Structures and named places of a row by id."""
    mapped = page.site_map.rows[row].structures if row in page.site_map.rows else {}
    groups = [*page.places.get(row, {}).values(), *mapped.values()]
    return {structure.id: structure for group in groups for structure in group}


def _poor(inspection: Inspection) -> list[tuple[str, Finding]]:
    """All that is not in order, with its row, the worst first."""
    return [(row, finding) for row, _, finding in inspection.findings() if finding.grade != "green"]


def findings_table(inspection: Inspection) -> Table:
    """A line for each finding, the worst first."""
    names = (
        "row",
        "'grade",
        "'finding",
        "along the row, m",
        "height, m",
        "'value",
        "'limit",
        "likely, %",
        "'what to do",
    )
    lines = []
    for row, _, finding in inspection.findings():
        text, (x, y, _) = text_of(row, finding), finding.place or (None, None, None)
        percent = None if finding.probability is None else 100 * finding.probability
        cells = (
            Cell(row),
            Cell(finding.grade, style=f"badge {finding.grade}"),
            Cell(finding.title, style="words"),
            number_cell(x, 2),
            number_cell(y, 2),
            Cell(text.value, finding.value, style="words"),
            Cell(text.limit, finding.limit, style="words", note=finding.limit_source),
            number_cell(percent, 0),
            Cell(finding.action, style="words"),
        )
        lines.append(Line(cells, LINE_STYLES.get(finding.grade, "")))
    caption = "All that was checked; the worst first. \u00b1: 1 standard deviation"
    return Table("findings", caption, heads(*names), tuple(lines), "only red and amber")


Key = tuple[str, str]


def tables_of(inspection: Inspection) -> dict[Key, list[tuple[str, FindingTable]]]:
    """The tables of all rows, by plugin and name: row and table."""
    tables: dict[Key, list[tuple[str, FindingTable]]] = {}
    for row, plugin, part in inspection.parts():
        for table in part.tables:
            tables.setdefault((plugin, table.name), []).append((row, table))
    return tables


def _table(key: Key, tables: Sequence[tuple[str, FindingTable]]) -> Table:
    """One table of all rows' lines; columns that only some rows have are empty in the others."""
    columns = list(dict.fromkeys(column for _, table in tables for column in table.columns))
    lines = []
    for row, table in tables:
        for line in table.lines:
            cells = dict(zip(table.columns, line, strict=True))
            lines.append(Line((Cell(row), *(_cell(cells.get(column)) for column in columns))))
    title = tables[0][1].title
    cells_of = zip(*(line.cells[1:] for line in lines), strict=True) if lines else [() for _ in columns]
    numeric = [all(cell.value is not None or not cell.text for cell in cells) for cells in cells_of]
    names = [column_words(column) for column in columns]
    marked = [name if number else f"'{name}" for name, number in zip(names, numeric, strict=True)]
    return Table(f"table-{'-'.join(key)}", title, heads("row", *marked), tuple(lines))


def column_words(name: str) -> str:
    """A column's name as people read it: "sigma_free_width_m" is "\u00b1 free width, m"."""
    words = name.replace("sigma_", "\u00b1 ").replace("probability", "how likely:").replace("_", " ")
    return re.sub(r" (mm?)$", r", \1", words).rstrip(":")


def _cell(value: str | float | None) -> Cell:
    if value is None:
        return Cell("")
    if isinstance(value, str):
        return Cell(value)
    return Cell(str(value) if isinstance(value, int) else fixed(value, 3), float(value))


NOT_RECORDED = "not recorded"
DIGITS = 12
"""Of the map's SHA-256, which tell it from any other."""
Fact = tuple[str, str]


def page_header(site_map: SiteMap, map_file: Path, limits: Path | None, drawing: Path | None) -> tuple[Fact, ...]:
    """What a signed inspection must name: the map, when and of what footage it was made, the limits, and who computed:
    names and values. The date and the footage are those of the run record beside the map, where it is of this map.
    Raises OutputError where the map file cannot be read."""
    log = log_beside(site_map, map_file)
    footage = {
        row: ", ".join(dict.fromkeys(file.name for file in run.footage.values()))
        for row, run in (log.rows.items() if log else ())
        if run.footage
    }
    return (
        ("map", f"{map_file} (SHA-256 {sha256(map_file)[:DIGITS]}\N{HORIZONTAL ELLIPSIS})"),
        ("mapped", " ".join(_mapped(site_map, log.ended[:10] if log else ""))),
        ("rows", ", ".join(site_map.rows)),
        ("footage", "; ".join(f"row {row}: {names}" for row, names in footage.items()) or NOT_RECORDED),
        ("limits", str(limits) if limits else "the usual ones"),
        ("drawing", str(drawing) if drawing else "none"),
        ("inspected with", f"savmap {version('savmap')}"),
    )


def _mapped(site_map: SiteMap, date: str) -> Iterator[str]:
    yield f"on {date}" if date else f"date {NOT_RECORDED}"
    yield f"with savmap {site_map.made_by['savmap']}" if "savmap" in site_map.made_by else ""
