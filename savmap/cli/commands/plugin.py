"""`savmap plugin`: for those who write plugins."""

from pathlib import Path
from typing import Annotated

import typer

from savmap.cli.commands.options import output_option
from savmap.cli.speech import say

app = typer.Typer(
    help="For those who write plugins.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


@app.callback()
def plugin() -> None:
    """For those who write plugins."""


@app.command()
def new(
    name: Annotated[str, typer.Argument(metavar="NAME", help="What site files call it, such as pillars.")],
    output: Annotated[
        Path | None,
        output_option("A new folder (default: savmap-NAME).", "FOLDER"),
    ] = None,
    locates_camera: Annotated[
        bool,
        typer.Option("--locates-camera", help="A plugin that finds the face by itself and can be mapped alone."),
    ] = False,
) -> None:
    """Write the project of a new plugin: complete, to be installed, with tests that pass."""
    from savmap.plugin.scaffold import new_plugin

    for line in new_plugin(name, output, locates_camera):
        say(line)
