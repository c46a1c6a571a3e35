"""What the commands beside mapping do: what is installed, footage of made-up places, new networks; lines to print."""

import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from savmap.errors import ModelError, SiteError
from savmap.plugin.manager import exporters, installed, lacking, load_class


def plugin_lines() -> Iterator[str]:
    """What is installed: name, classes, model, hooks."""
    for name, point in installed().items():
        plugin = load_class(name)
        hooks = sorted(hook for hook in vars(plugin) if hasattr(getattr(plugin, hook), "savmap_impl"))
        yield f"{name}  ({point.value})"
        yield f"  classes  {', '.join(plugin.classes)}"
        yield f"  model    {plugin.model}"
        yield f"  network  {_network(plugin.model)}"
        yield f"  hooks    {', '.join(hooks)}"
        if missing := lacking(plugin):
            yield f"  lacks    {', '.join(missing)}, without which it does less: pip install them, or savmap's extra of its name"


def _network(model: Path) -> str:
    """Of what kind a plugin's network is, and on what it runs; what is wrong with it where it cannot be read."""
    from savmap.vision.networks.segmenter import Segmenter, shortened

    try:
        network = Segmenter(model)
    except ModelError as error:
        return str(error)
    return f"{network}; gives {shortened(network.names)}"


def schema(name: str) -> str:
    """The JSON Schema of a kind of file: "site", with the settings of all installed plugins, or "map". Raises SiteError."""
    from savmap.maps.schema import schema_text as map_schema_text
    from savmap.site.schema import schema_text

    if name == "map":
        return map_schema_text()
    if name == "site":
        return schema_text(installed())
    raise SiteError(f"schema {name}: there is one for `site` and one for `map`")


def export(map_file: Path, name: str, output: Path, row: str | None = None) -> Iterator[str]:
    """A map (or one `row` of it) in another format, written whole or not at all.

    Raises SiteError for a format or row that is not there, PluginError for an exporter that fails.
    """
    from savmap.maps.exports import export_map
    from savmap.maps.map_file import read_map

    site_map = read_map(map_file)
    if row is not None:
        if row not in site_map.rows:
            raise SiteError(f"--row {row}: {map_file} has {', '.join(site_map.rows)}")
        site_map = replace(site_map, rows={row: site_map.rows[row]})
    export_map(site_map, name, output, exporters())
    yield f"wrote {output}"


def find(map_file: Path, name: str) -> Iterator[str]:
    """Where in a map the things of a name are, or those on which it is written. Raises SiteError where there is none."""
    from savmap.maps.map_file import read_map
    from savmap.maps.search import find_structures

    yield from map(str, find_structures(read_map(map_file), name))


def split(recording: Path, output: Path, into: Path | None = None, sheet: Path | None = None) -> Iterator[str]:
    """The passes of a long recording as rows of a new site file, or added to one, with a contact sheet."""
    from savmap.cli.console import Console
    from savmap.split import split as find_and_write
    from savmap.split.contact_sheet import clock

    with Console(Path(os.devnull)) as console:
        result = find_and_write(recording, output, into, sheet, monitor=console)
    yield "pass     start       end   heading  sides        confidence"
    for number, row_pass in enumerate(result.passes, start=1):
        yield (
            f"{number:4d}  {clock(row_pass.start_s):>8}  {clock(row_pass.end_s):>8}  {row_pass.heading_deg:+6.0f}"
            f"    {' and '.join(row_pass.sides):<14} {row_pass.confidence:4.2f}"
        )
    yield f"wrote {into or output}: look through it before mapping"
    if sheet is not None:
        yield f"wrote {sheet}"
    yield (
        f"{result.frames_decoded} frames decoded for {result.frame_pairs} pairs of pictures, "
        f"{result.decoded_share:.0%} of the recording"
    )
