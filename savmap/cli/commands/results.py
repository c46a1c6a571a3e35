"""Commands about maps that are made: scores, report, other formats, where a structure is."""

import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from savmap.cli.commands.options import FirstMap, MapFile, output_option, the_map, warn_of_earlier
from savmap.cli.speech import say, say_all

if TYPE_CHECKING:
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
    from savmap.jobs import api
    from savmap.maps.map_file import read_map
    from savmap.maps.orthophoto_file import read_orthophotos
    from savmap.report.inspection import InspectionPage, page_header, write_inspection
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
    _say_banner(site_map)


def compare(
    old: Annotated[Path, typer.Argument(metavar="OLD", help="The earlier date: a map.json, or its folder.")],
    new: Annotated[Path, typer.Argument(metavar="NEW", help="The later date: a map.json, or its folder.")],
    output: Annotated[
        Path | None,
        output_option("Write an HTML page that shows both dates.", "PAGE"),
    ] = None,
    json_file: Annotated[
        Path | None, typer.Option("--json", metavar="FILE", help="Write all that was compared as JSON.")
    ] = None,
    in_viewer: Annotated[
        bool, typer.Option("--view", help="Write view.html beside NEW: both dates over one another, to be looked at.")
    ] = False,
    level: Annotated[
        float, typer.Option(min=1e-6, max=0.5, help="Share of false ones among the changes that is accepted.")
    ] = 0.1,
    exit_code: Annotated[
        bool,
        typer.Option("--exit-code", help="End with 13 if anything changed, with 14 where nothing could be compared."),
    ] = False,
) -> None:
    """Say what changed from one map of a place to a later one."""
    from savmap.errors import ChangedError, NothingComparedError
    from savmap.maps.comparison import comparison_lines, unsaid_text
    from savmap.maps.map_file import map_in
    from savmap.report.site_report import VIEW, compare_files

    for source in (old, new):
        warn_of_earlier(source)
    comparison = compare_files(old, new, level, output, json_file, in_viewer)
    for line in comparison_lines(comparison):
        say(line)
    for path in filter(None, (output, json_file, map_in(new).with_name(VIEW) if in_viewer else None)):
        say(f"wrote {path}")
    if exit_code and comparison.changed and comparison.compared:
        raise ChangedError(f"{new}: not as {old} has it")
    if exit_code and (unsaid := unsaid_text(comparison)):
        raise NothingComparedError(f"{new}: cannot be compared with {old}: {unsaid}")


def view(
    source: Annotated[Path, typer.Argument(metavar="FOLDER", help="The folder of a map, or its map.json.")] = Path(
        "out"
    ),
    serve: Annotated[
        bool, typer.Option("--serve", help="Serve it to this machine's browser until Ctrl+C, for large sites.")
    ] = False,
    live: Annotated[
        bool, typer.Option("--live", help="Serve a page that follows a session of `savmap live` in this folder.")
    ] = False,
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="The port of --serve and --live (0: one that is free).")
    ] = 0,
    survey: Annotated[Path | None, typer.Option(help="A survey file to show errors against.")] = None,
    against: Annotated[
        Path | None, typer.Option(metavar="OLD", help="An earlier map, or its folder, to show with it.")
    ] = None,
    fresh: Annotated[bool, typer.Option("--fresh", help="Write the page anew.")] = False,
    show: Annotated[bool, typer.Option("--open/--no-open", help="Open it in the browser.")] = True,
) -> None:
    """Look at a map in the browser: 3D, panoramas, search, measuring. Writes view.html where that of this map is not
    there."""
    import webbrowser

    from savmap.jobs import api
    from savmap.report.viewer.serve import ViewServer

    if live:
        follow(source, port, show)
        return
    for given in (source, against):
        warn_of_earlier(given)
    page_view = api.view(source, survey=survey, against=against, fresh=fresh, show=False)
    if page_view.written:
        say(f"wrote {page_view.page}")
    if not serve:
        if not show or not page_view.open():
            say(f"open {page_view.page} in a browser")
        return
    with ViewServer(page_view.page, port) as server:
        say(f"{server.address} shows {page_view.page}; Ctrl+C ends it")
        if show:
            webbrowser.open(server.address)
        server.run()


def follow(folder: Path, port: int, show: bool) -> None:
    """Serve the page of a live session until the user ends it."""
    import webbrowser

    from savmap.errors import OutputError
    from savmap.report.viewer.live import LiveServer

    if not folder.is_dir():
        raise OutputError(f"{folder}: is no folder; give the one that `savmap live -o` writes into")
    with LiveServer(folder, port) as server:
        say(f"{server.address} follows {folder}; Ctrl+C ends it")
        if show:
            webbrowser.open(server.address)
        server.run()


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
    if frame := _frame_of(name, site_map):
        say(f"coordinates are in {frame}")
    _say_banner(site_map if row is None else replace(site_map, failed={}))


def _frame_of(name: str, site_map: "SiteMap") -> str:
    """What the coordinates of a format of savmap's own refer to (docs/exports.md); empty of one that a plugin gives."""
    from savmap.maps.exports import FORMATS

    if name not in FORMATS:
        return ""
    if name in ("csv", "ply"):
        return OF_SITE if site_map.placements else f"the {OF_ROW}"
    if name in ("geojson", "imdf"):
        return "longitude and latitude (WGS 84)"
    axes = "y up, as glTF has it" if name == "glb" else "z up"
    unaligned = "" if site_map.alignment else ", which is the map's own, for it is not aligned"
    return f"the world's frame (metres, {axes}){unaligned}"


def _say_banner(site_map: "SiteMap") -> None:
    """What a file that was written of a map, or a figure of it, does not show: the rows that it lacks, and those that
    are to be checked first."""
    if site_map.banner:
        say(f"note: {site_map.banner} (`savmap view`, report.html)")


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
    _say_banner(site_map)


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
    _say_banner(site_map)
