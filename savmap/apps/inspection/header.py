"""What a signed inspection must name: the map, when and of what footage it was made, the limits, and who computed."""

from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path

from savmap.files.atomic import sha256
from savmap.report.site_report import log_beside
from savmap.types import SiteMap

NOT_RECORDED = "not recorded"
DIGITS = 12
"""Of the map's SHA-256, which tell it from any other."""
Fact = tuple[str, str]


def page_header(site_map: SiteMap, map_file: Path, limits: Path | None, drawing: Path | None) -> tuple[Fact, ...]:
    """Names and values. The date and the footage are those of the run record beside the map, where it is of this map.
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
