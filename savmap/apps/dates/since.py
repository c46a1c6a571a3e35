"""What the core asks of this app (`savmap.plugin.apps.Dates`): passes along rows that an earlier map has, and what
changed since."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from savmap.apps.dates import page
from savmap.apps.dates.comparison.compare import LEVEL
from savmap.apps.dates.comparison.records import Comparison
from savmap.apps.dates.comparison.texts import comparison_lines
from savmap.apps.dates.files import compared
from savmap.apps.dates.returning import update
from savmap.apps.dates.returning.recognition import recognised as recognised
from savmap.apps.dates.returning.update import in_row as in_row
from savmap.maps.map_file import read_map
from savmap.types import RowMap, SiteMap


@dataclass(frozen=True)
class Since:
    """A comparison as the terminal and the report show it."""

    comparison: Comparison

    def lines(self) -> list[str]:
        """For the terminal."""
        return [*comparison_lines(self.comparison)]

    def section(self, viewer: str) -> str:
        """For the report, as HTML."""
        return page.report_section(self.comparison, viewer)


def updated(earlier: SiteMap, passes: Mapping[str, RowMap], made_by: Mapping[str, str]) -> tuple[SiteMap, Since]:
    """The earlier map with passes of its rows, by name. Raises StructureError."""
    site_map, comparison = update.updated(earlier, passes, made_by)
    return site_map, Since(comparison)


def changes_since(old_file: Path, new: SiteMap) -> Since:
    """What changed since the map of a file. Raises SavmapError."""
    return Since(compared(read_map(old_file), new, LEVEL))
