"""A map in formats that other programs read.

A format is a function `(SiteMap, Path)`: the core's are named in `FORMATS`, others are those of apps and plugins
(`savmap.plugin.manager.exporters`). Libraries that one format alone needs are imported by its function, and are extras.
"""

from codecs import BOM_UTF8
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

from savmap.errors import OutputError, PluginError, SavmapError, SiteError, format_error
from savmap.files.atomic import write_with
from savmap.types import SiteMap

Exporter = Callable[[SiteMap, Path], None]

FORMATS = {
    "csv": f"{__name__}.vertices:write_csv",
    "ply": f"{__name__}.vertices:write_ply",
    "glb": f"{__name__}.models.glb:write_glb",
    "geojson": f"{__name__}.plans.geojson:write_geojson",
}
"""The core's formats by name: where each one's function is."""


def format_of(path: Path, formats: Collection[str]) -> str:
    """The name of the format that a file's ending tells. Raises SiteError, which names the formats, where it tells
    none."""
    for name in (ending.removeprefix(".").lower() for ending in reversed(path.suffixes)):
        if name in formats:
            return name
    raise SiteError(f"{path}: its ending tells no format; give one with --format: {', '.join(sorted(formats))}")


@dataclass(frozen=True)
class OneFrame:
    """An exporter ("module:function") that is imported when it writes, and is given rows of one frame (CSV, whose lines
    say their frame: all)."""

    target: str

    def __call__(self, site: SiteMap, path: Path) -> None:
        module, _, function = self.target.partition(":")
        getattr(import_module(module), function)(site, path)


def export_map(
    site_map: SiteMap, name: str, path: Path, formats: Mapping[str, Exporter], remark: str = "", bom: bool = False
) -> str:
    """Write a map in the format of this name, whole or not at all, without rows that have no place where it needs one
    frame: a note names them. Raises SiteError for an unknown format, PluginError for an exporter that fails,
    OutputError. remark: what to add where the format is unknown. bom: begin with the mark of UTF-8, of CSV alone."""
    from savmap.maps.exports.frames import in_one_frame

    if name not in formats:
        raise SiteError(f"format {name}: known formats are {', '.join(sorted(formats))}{remark}")
    if bom and not name.endswith("csv"):
        raise SiteError(f"--bom is for CSV, not for {name}")
    site, note = in_one_frame(site_map) if isinstance(formats[name], OneFrame) and name != "csv" else (site_map, "")

    def write(part: Path) -> None:
        formats[name](site, part)
        if bom:
            part.write_bytes(BOM_UTF8 + part.read_bytes())

    try:
        write_with(write, path)
        return note
    except SavmapError:
        raise
    except (Exception, SystemExit) as error:
        raise PluginError(f"exporter `{name}` failed: {format_error(error)}") from error


def require_library(module: str, extra: str) -> None:
    """Raise OutputError where a library that a format needs is not installed. `extra`: the extra of savmap that has
    it."""
    try:
        import_module(module)
    except ImportError as error:
        raise OutputError(f"this format needs {module}: pip install 'savmap[{extra}]'") from error
