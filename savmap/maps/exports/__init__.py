"""A map in formats that other programs read.

A format is a function `(SiteMap, Path)` in a module of this package, named in `FORMATS`. Libraries that one format
alone needs are imported by its function, and are extras.
"""

from codecs import BOM_UTF8
from collections.abc import Callable, Collection, Mapping
from importlib import import_module
from pathlib import Path

from savmap.errors import OutputError, PluginError, SavmapError, SiteError, format_error
from savmap.files.atomic import write_with
from savmap.types import SiteMap

Exporter = Callable[[SiteMap, Path], None]

FORMATS = {
    "csv": "vertices:write_csv",
    "ply": "vertices:write_ply",
    "tum": "trajectories:write_tum",
    "colmap": "trajectories:write_colmap",
    "nerfstudio": "trajectories:write_nerfstudio",
    "mcap": "recordings:write_mcap",
    "rosbag2": "recordings:write_rosbag2",
    "rrd": "recordings:write_rerun",
    "glb": "models.glb:write_glb",
    "usda": "models.usd:write_usda",
    "usdc": "models.usd:write_usdc",
    "ifc": "models.ifc:write_ifc4",
    "ifc4x3": "models.ifc:write_ifc4x3",
    "dxf": "models.dxf:write_dxf",
    "nav2": "plans.nav2:write_nav2",
    "lif": "plans.fleets:write_lif",
    "vda5050-zones": "plans.fleets:write_zone_set",
    "open-rmf": "plans.open_rmf:write_building",
    "geojson": "plans.geojson:write_geojson",
    "imdf": "plans.imdf:write_imdf",
}
"""Formats that come with savmap, by name: the module and the function."""


ENDINGS = {".lif.json": "lif", ".building.yaml": "open-rmf"}
"""Formats by endings of files that are not the formats' names."""


def format_of(path: Path, formats: Collection[str]) -> str:
    """The name of the format that a file's ending tells. Raises SiteError, which names the formats, where it tells
    none."""
    names = [name for ending, name in ENDINGS.items() if path.name.lower().endswith(ending)]
    for name in (*names, path.suffix.removeprefix(".").lower()):
        if name in formats:
            return name
    raise SiteError(f"{path}: its ending tells no format; give one with --format: {', '.join(sorted(formats))}")


def core_exporters() -> dict[str, Exporter]:
    """The formats that come with savmap, by name. A module is imported when its format is written."""
    return {name: _exporter(place) for name, place in FORMATS.items()}


def _exporter(place: str) -> Exporter:
    module, _, function = place.partition(":")

    def write(site: SiteMap, path: Path) -> None:
        getattr(import_module(f"{__name__}.{module}"), function)(site, path)

    return write


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
    site, note = in_one_frame(site_map) if name in FORMATS and name != "csv" else (site_map, "")

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
