"""Options that several commands have."""

from pathlib import Path
from typing import Annotated

import typer

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
Output = Annotated[
    Path, typer.Option("-o", "--output", parser=where, metavar="FOLDER", help="Folder for the results, or a URL.")
]


def map_of(path: Path | None) -> Path | None:
    """The map file that an argument names, itself or by its folder."""
    from savmap.maps.map_file import map_in

    return None if path is None else map_in(path)


MapFile = Annotated[
    Path, typer.Argument(metavar="MAP", callback=map_of, help="A map.json, or the folder that holds it.")
]


def names_of(text: str | None) -> list[str] | None:
    """The names between the commas of an option; None where it is not given."""
    return [name.strip() for name in text.split(",") if name.strip()] if text is not None else None
