"""Options that several commands have."""

from pathlib import Path
from typing import Annotated, Any

import typer

from savmap.cli.speech import say
from savmap.files.urls import where

Plugins = Annotated[
    str | None,
    typer.Option(
        help="Comma-separated plugins; default: those that the site file names, or all that have what they need."
    ),
]
Sets = Annotated[
    list[str] | None, typer.Option("--set", help="KEY=VALUE: a key of the site file, such as rows.A.fps=5.")
]


def written_to(text: str) -> Path:
    """The path of an option that names what is written. Raises SiteError for the terminal, and as `where` does."""
    from savmap.errors import SiteError

    if text == "-":
        raise SiteError("-o -: nothing is written to the terminal; give a file or a folder")
    return where(text)


def output_option(says: str, metavar: str = "FILE") -> Any:
    """The option -o of a command."""
    return typer.Option("-o", "--output", parser=written_to, metavar=metavar, help=says)


Output = Annotated[Path, output_option("Folder for the results, or a URL.", "FOLDER")]


def map_of(path: Path | None) -> Path | None:
    """The map file that an argument names, itself or by its folder. Of a map that a run which failed left there, a line
    tells on standard error."""
    from savmap.maps.map_file import map_in

    if path is None:
        return None
    warn_of_earlier(path)
    return map_in(path)


def warn_of_earlier(source: Path | None) -> None:
    """A line on standard error where a map, or that of a folder, is of an earlier run than the last into that folder,
    which failed."""
    from savmap.maps.map_file import map_in
    from savmap.maps.run_record import failed_since

    if source is not None and (last := failed_since(map_in(source))):
        say(f"savmap: warning: {map_in(source)} is of an earlier run; the last one failed: {last.error}", err=True)


MapFile = Annotated[
    Path, typer.Argument(metavar="MAP", callback=map_of, help="A map.json, or the folder that holds it.")
]


FirstMap = Annotated[
    list[Path] | None,
    typer.Argument(metavar="MAP", help="A map.json, or the folder that holds it.", show_default="out/map.json"),
]
"""A map that may be left out before other arguments."""


def the_map(maps: list[Path] | None, last: str) -> Path:
    """The map of a command that may be given one before its other arguments, of which `last` is the last. Raises
    SiteError for several, and where the last argument is the map."""
    from savmap.errors import SiteError

    several = maps or [Path("out/map.json")]
    if len(several) > 1:
        raise SiteError(
            f"{several[1]}: one map is expected, then what is asked for; put names with blanks in quotation marks"
        )
    if not several[0].exists() and Path(last).exists():
        raise SiteError(
            f"{last}: the map comes first, before what is asked for: {last} {several[0] if maps else '...'}"
        )
    return map_of(several[0]) or several[0]


def names_of(text: str | None) -> list[str] | None:
    """The names between the commas of an option; None where it is not given."""
    return [name.strip() for name in text.split(",") if name.strip()] if text is not None else None
