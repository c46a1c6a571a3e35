"""Commands about maps that are made: scores, report, other formats, where a structure is."""

import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from savmap.cli.commands.options import FirstMap, MapFile, output_option, the_map, warn_of_earlier
from savmap.cli.speech import say, say_all, say_banner

if TYPE_CHECKING:
    from savmap.maps.exports import Exporter
    from savmap.types import SiteMap

OF_ROW = "row's own frame (metres: x along it to the right, y up, z out of the face)"
OF_SITE = "the site's frame (metres, y up)"


def evaluate(
    map_file: MapFile,
    survey: Annotated[Path, typer.Argument(metavar="SURVEY", help="A survey file.")],
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    box_plot: Annotated[Path | None, typer.Option(help="Write a box plot of the errors by class (PNG).")] = None,
) -> None:
    """Score a map against a survey."""
    from savmap.report import evaluation
    from savmap.report.picture import write_box_plot
    from savmap.report.site_report import evaluate_files

    scores = evaluate_files(map_file, survey)
    if box_plot is not None:
        write_box_plot(scores, box_plot)
    say_all(json.dumps(evaluation.as_json(scores), indent=2) if as_json else evaluation.as_table(scores))


def report(
    map_file: MapFile,
    run_file: Annotated[
        Path | None, typer.Option("--run", metavar="FILE", help="The run.json of the same run.")
    ] = None,
    survey: Annotated[Path | None, typer.Option(help="A survey file to show errors against.")] = None,
    against: Annotated[
        Path | None, typer.Option(metavar="OLD", help="An earlier map, or its folder: tell what changed since.")
    ] = None,
    output: Annotated[Path, output_option("The HTML page to write.")] = Path("report.html"),
) -> None:
    """Write a map's report: one HTML page with plan, states, references, errors and times."""
    from savmap.report.site_report import write_report

    warn_of_earlier(against)
    write_report(map_file, output, run_file, survey, against)
    say(f"wrote {output}")


def export(
    map_file: MapFile,
    output: Annotated[Path, output_option("The file to write.")],
    name: Annotated[
        str | None,
        typer.Option(
            "--format", help="Such as csv or ply (default: by the file's ending); docs/exports.md has all of them."
        ),
    ] = None,
    row: Annotated[str | None, typer.Option(help="Only this row.")] = None,
    bom: Annotated[bool, typer.Option("--bom", help="Begin a CSV file with the mark of UTF-8, for Excel.")] = False,
) -> None:
    """Write a map in another format."""
    from savmap.errors import SiteError
    from savmap.maps.exports import export_map, format_of
    from savmap.maps.exports.frames import only_row
    from savmap.maps.map_file import read_map, require_other
    from savmap.plugin.manager import exporters, load_installed

    formats = exporters()
    name = name or format_of(output, formats)
    site_map = read_map(map_file)
    require_other(output, map_file)
    if row is not None:
        if row not in site_map.rows:
            raise SiteError(f"--row {row}: {map_file} has {', '.join(site_map.rows)}")
        site_map, note = only_row(site_map, row)
        if note:
            say(f"note: {note}")
    broken = "".join(f"; {reason}" for reason in load_installed().broken.values())
    if note := export_map(site_map, name, output, formats, broken, bom):
        say(f"note: {note}")
    say(f"wrote {output}")
    if frame := _frame_of(name, formats[name], site_map):
        say(f"coordinates are in {frame}")
    say_banner(site_map if row is None else replace(site_map, failed={}))


def _frame_of(name: str, exporter: "Exporter", site_map: "SiteMap") -> str:
    """What the coordinates of a format of the core or an app refer to (docs/exports.md); empty of one that a plugin
    gives."""
    from savmap.maps.exports import OneFrame

    if not isinstance(exporter, OneFrame):
        return ""
    if name in ("csv", "ply"):
        return OF_SITE if site_map.placements else f"the {OF_ROW}"
    if name == "geojson":
        return "longitude and latitude (WGS 84)"
    axes = "y up, as glTF has it" if name == "glb" else "z up"
    unaligned = "" if site_map.alignment else ", which is the map's own, for it is not aligned"
    return f"the world's frame (metres, {axes}){unaligned}"


def align(
    map_file: MapFile,
    places_file: Annotated[
        Path, typer.Argument(metavar="FILE", help="A site file with `align:`, or what stands there alone.")
    ],
    output: Annotated[Path, output_option("The map.json to write.")],
) -> None:
    """Say where a finished map stands in your own world, from places that are known in both."""
    from savmap.assembly import alignment_lines
    from savmap.jobs.api import align as align_map
    from savmap.maps.map_file import read_map, write_map

    notes: list[str] = []
    site_map = align_map(read_map(map_file), places_file, notes.append)
    write_map(site_map, output)
    say(f"wrote {output}")
    for line in (*alignment_lines(site_map), *(f"note: {note}" for note in notes)):
        say(line)


def find(
    map_file: FirstMap = None,
    *,
    name: Annotated[
        str,
        typer.Argument(metavar="NAME", help="What is written on it, such as A21-03, its id, or 'bay 2 level 3'."),
    ],
) -> None:
    """Say where in a map a structure is, or a place between structures."""
    from savmap.maps.map_file import read_map
    from savmap.maps.search import find_structures, places_within
    from savmap.report.site_report import places_of

    site_map = read_map(the_map(map_file, name))
    for hit in find_structures(site_map, name, lambda: places_of(site_map)):
        say(hit)
        if hit.slot is not None:
            say(f"  slot: {hit.slot}")
        for part in places_within(site_map, hit, places_of(site_map)):
            say(f"  {part}")
    say(
        f"x, y, z are in {'each' if len(site_map.rows) > 1 else 'the'} {OF_ROW} unless another is named; "
        "+- is one standard deviation"
    )
    say_banner(site_map)


def measure(
    map_file: FirstMap = None,
    *,
    first: Annotated[str, typer.Argument(metavar="FROM", help="A vertex, such as 'upright 1 / right / bottom'.")],
    second: Annotated[str, typer.Argument(metavar="TO", help="Another; 'A: ...' says the row.")],
) -> None:
    """Say how far two vertices of a map are apart, and how sure that is."""
    from savmap.jobs import api
    from savmap.maps.map_file import read_map

    site_map = read_map(the_map(map_file, second))
    distance = api.measure(site_map, first, second)
    say(distance)
    frame = f"the {OF_ROW}" if distance.first.row == distance.second.row else OF_SITE
    say(f"x, y, z are in {frame}; +- is one standard deviation")
    say_banner(site_map)
