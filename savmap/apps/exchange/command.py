"""The command that makes a survey out of what surveyors write."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from savmap.cli.commands.options import map_of, output_option
from savmap.cli.speech import say

if TYPE_CHECKING:
    from savmap.types import SiteMap


def import_(
    files: Annotated[
        list[Path], typer.Argument(metavar="FILE", help="Tables (.csv, .tsv, .txt), drawings (.dxf), models (.ifc).")
    ],
    output: Annotated[Path, output_option("The survey file to write.")] = Path("survey.json"),
    map_file: Annotated[
        Path | None,
        typer.Option(
            "--map", metavar="MAP", callback=map_of, help="A map.json or its folder, which says where rows stand."
        ),
    ] = None,
    alignment: Annotated[
        Path | None,
        typer.Option("--align", metavar="FILE", help="With --map: your world's places, as for `savmap align`."),
    ] = None,
    place: Annotated[
        list[str] | None,
        typer.Option(
            metavar="ROW=X,Y,HEADING", help="Where a row's origin is in your world, m, degrees; may be repeated."
        ),
    ] = None,
    row: Annotated[str | None, typer.Option(help="The row of all that names none.")] = None,
    frame: Annotated[
        str | None,
        typer.Option(metavar="row|site|world", help="What positions refer to, where the file does not say it."),
    ] = None,
    unit: Annotated[
        str | None, typer.Option(help="Of lengths: m, dm, cm, mm, ft or in; default: what the file says.")
    ] = None,
    layer: Annotated[
        list[str] | None,
        typer.Option(
            "--layer", metavar="NAME=LABEL", help="What a layer, code, class or type is here, such as POSTS=upright."
        ),
    ] = None,
    columns: Annotated[
        list[str] | None,
        typer.Option(
            metavar="x=NAME,...", help="A table's columns, by name or number: row, id, label, vertex, x, y, z, text."
        ),
    ] = None,
) -> None:
    """Make a survey file out of tables, drawings and building models: what somebody measured, or planned."""
    from savmap.apps.exchange.api import import_survey
    from savmap.maps.survey import write_survey

    chosen = _pairs("--columns", [part for text in columns or () for part in text.split(",")])
    result = import_survey(
        files,
        _map_of(map_file, alignment),
        places=place or (),
        columns=chosen,
        labels=_pairs("--layer", layer or ()),
        unit=unit,
        row=row,
        frame=frame,
    )
    write_survey(result.survey, output)
    say(f"wrote {output}")
    for line in result.lines():
        say(line)


def _pairs(option: str, texts: Sequence[str]) -> dict[str, str]:
    """What NAME=VALUE say. Raises SiteError."""
    from savmap.errors import SiteError

    wrong = [text for text in texts if "=" not in text]
    if wrong:
        raise SiteError(f"{option} {wrong[0]}: should be NAME=VALUE")
    return {name.strip(): value.strip() for name, _, value in (text.rpartition("=") for text in texts)}


def _map_of(map_file: Path | None, alignment: Path | None) -> "SiteMap | None":
    """The map, aligned by what is known of the user's world where that is given. Raises SiteError."""
    from savmap.errors import SiteError
    from savmap.jobs.api import align
    from savmap.maps.map_file import read_map

    if alignment is not None and map_file is None:
        raise SiteError(f"--align {alignment}: says where a map stands: give --map, too")
    site_map = None if map_file is None else read_map(map_file)
    if site_map is None or alignment is None:
        return site_map
    return align(site_map, alignment, lambda note: say(f"note: {note}"))
