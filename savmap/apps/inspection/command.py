"""The command `savmap inspect`."""

from pathlib import Path
from typing import Annotated

import typer

from savmap.cli.commands.options import MapFile, output_option
from savmap.cli.speech import say, say_banner


def inspect(
    map_file: MapFile,
    limits: Annotated[
        Path | None, typer.Option(metavar="FILE", help="A file of limits; docs/inspection.md has all of them.")
    ] = None,
    drawing: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="A survey file, table, drawing or building model to compare with."),
    ] = None,
    output: Annotated[
        Path | None,
        output_option("The HTML page to write; CSV and JSON go beside it. Default: inspection.html beside the map."),
    ] = None,
) -> None:
    """Say what in a map keeps the limits of an inspection: a measuring aid for a person who may inspect."""
    from savmap.apps.inspection import api
    from savmap.apps.inspection.files import write_inspection
    from savmap.apps.inspection.page import InspectionPage, page_header
    from savmap.maps.map_file import read_map
    from savmap.maps.orthophoto_file import read_orthophotos
    from savmap.report.site_report import places_of

    site_map = read_map(map_file)
    inspection = api.inspect(site_map, limits, drawing=drawing, folder=map_file.parent)
    photos = read_orthophotos(site_map.rows, map_file.parent)
    inputs = [path for path in (map_file, limits, drawing) if path is not None]
    header = page_header(site_map, map_file, limits, drawing)
    page = InspectionPage(site_map, inspection, photos, places_of(site_map), header=header)
    written = write_inspection(page, output or map_file.with_name("inspection.html"), inputs)
    say(", ".join(f"{count} {grade}" for grade, count in inspection.counts().items()))
    for path in written:
        say(f"wrote {path}")
    say_banner(site_map)
