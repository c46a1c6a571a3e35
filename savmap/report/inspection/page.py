"""The page of an inspection: counts, the worst findings with pictures, tables, limits, and what nobody checked."""

import base64
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from savmap.report.inspection.inspect import unchecked_of
from savmap.report.inspection.pictures import FacePictures
from savmap.report.numbers import fixed
from savmap.report.page.tables import Cell, Line, Table, heads
from savmap.report.site_report import StructuresByRow
from savmap.report.templating import rendered_page
from savmap.types import Finding, FindingTable, Inspection, Orthophoto, SiteMap, Structure

WORST = 10
DECIMALS: Mapping[str, int] = {"mm": 1, "m": 3, "mm/m": 2, "": 4}
"""By unit; "" is a share, such as sag over span."""
LINE_STYLES = {"red": "failed", "amber": "off"}


@dataclass(frozen=True, eq=False)
class InspectionPage:
    """What the page shows: the map, its inspection, orthophotos by row, places by row and plugin, the address of the
    sheets, where there are any, and what is said of map and limits, names and values."""

    site_map: SiteMap
    inspection: Inspection
    photos: Mapping[str, Orthophoto] = field(default_factory=dict)
    places: StructuresByRow = field(default_factory=dict)
    title: str = "Inspection"
    sheets: str = ""
    header: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True)
class WorstFinding:
    """A finding of the front page: its row, its value in words, and the address of its picture, "" for none."""

    row: str
    finding: Finding
    measured: str
    picture: str


def page_text(page: InspectionPage) -> str:
    """The page as HTML."""
    counts = page.inspection.counts()
    return rendered_page(
        "inspection.html.jinja",
        page=page,
        tiles=[(grade, str(count)) for grade, count in counts.items()],
        worst=list(_worst(page)),
        findings=findings_table(page.inspection),
        tables=[_table(name, tables) for name, tables in tables_of(page.inspection).items()],
        unchecked=unchecked_of(page.inspection),
    )


def _worst(page: InspectionPage) -> Iterator[WorstFinding]:
    """The worst that are not in order."""
    pictures: dict[str, FacePictures] = {}
    poor = [(row, finding) for row, _, finding in page.inspection.findings() if finding.grade != "green"]
    for row, finding in poor[:WORST]:
        if row in page.photos and row not in pictures:
            pictures[row] = FacePictures(page.photos[row])
        content = pictures[row].finding(finding, elements_of(page, row)) if row in pictures else None
        address = f"data:image/jpeg;base64,{base64.b64encode(content).decode()}" if content else ""
        yield WorstFinding(row, finding, measured_text(finding), address)


def elements_of(page: InspectionPage, row: str) -> dict[str, Structure]:
    """Structures and named places of a row by id."""
    mapped = page.site_map.rows[row].structures if row in page.site_map.rows else {}
    groups = [*page.places.get(row, {}).values(), *mapped.values()]
    return {structure.id: structure for group in groups for structure in group}


def measured_text(finding: Finding) -> str:
    """The value, its standard deviation, the limit and the probability, in words."""
    decimals = DECIMALS.get(finding.unit, 2)
    parts = []
    if finding.value is not None:
        sigma = "" if finding.sigma is None else f" \u00b1 {fixed(finding.sigma, decimals)}"
        parts.append(f"{fixed(finding.value, decimals)}{sigma} {finding.unit}".strip())
    if finding.limit is not None:
        parts.append(f"limit {fixed(finding.limit, decimals)} {finding.unit}".strip())
    if finding.probability is not None:
        beyond = "beyond it" if finding.limit is not None else "true"
        parts.append(f"{beyond} with probability {_percent(finding.probability)}")
    return ", ".join(parts)


def _percent(probability: float) -> str:
    return f"{100 * min(max(probability, 0.0), 1.0):.0f} %"


def findings_table(inspection: Inspection) -> Table:
    """A line for each finding, the worst first."""
    names = ("row", "'grade", "'finding", "value", "\u03c3", "limit", "'unit", "P, %", "'what to do")
    lines = tuple(_line(row, finding) for row, _, finding in inspection.findings())
    return Table("findings", "All that was checked; the worst first", heads(*names), lines, "only red and amber")


def _line(row: str, finding: Finding) -> Line:
    decimals = DECIMALS.get(finding.unit, 2)
    numbers = [Cell(fixed(number, decimals), number) for number in (finding.value, finding.sigma, finding.limit)]
    percent = None if finding.probability is None else 100 * finding.probability
    cells = (
        Cell(row),
        Cell(finding.grade, style=f"badge {finding.grade}"),
        Cell(finding.title, style="words"),
        *numbers,
        Cell(finding.unit),
        Cell(fixed(percent, 0), percent),
        Cell(finding.action, style="words"),
    )
    return Line(cells, LINE_STYLES.get(finding.grade, ""))


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
    names = [column.replace("_", " ") for column in columns]
    marked = [name if number else f"'{name}" for name, number in zip(names, numeric, strict=True)]
    return Table(f"table-{'-'.join(key)}", title, heads("row", *marked), tuple(lines))


def _cell(value: str | float | None) -> Cell:
    if value is None:
        return Cell("")
    if isinstance(value, str):
        return Cell(value)
    return Cell(str(value) if isinstance(value, int) else fixed(value, 3), float(value))
