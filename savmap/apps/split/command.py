"""The command that finds passes in a recording."""

import os
from pathlib import Path
from typing import Annotated

import typer

from savmap.cli.commands.options import output_option
from savmap.cli.speech import say


def split(
    recording: Annotated[Path, typer.Argument(metavar="RECORDING", help="A long panoramic video.")],
    output: Annotated[Path, output_option("The site file to write.")] = Path("site.yaml"),
    into: Annotated[Path | None, typer.Option(help="Add the rows to this site file instead.")] = None,
    sheet: Annotated[Path | None, typer.Option(help="Write a contact sheet of the passes (PNG).")] = None,
) -> None:
    """Find the passes through aisles in a long recording, and write them into a site file to be confirmed."""
    from savmap.apps.split.contact_sheet import clock
    from savmap.apps.split.find import split as find_and_write
    from savmap.cli.console import Console

    with Console(Path(os.devnull)) as console:
        result = find_and_write(recording, output, into, sheet, monitor=console)
    say("pass     start       end   heading  sides        confidence")
    for number, row_pass in enumerate(result.passes, start=1):
        times = f"{clock(row_pass.start_s):>8}  {clock(row_pass.end_s):>8}  {row_pass.heading_deg:+6.0f}"
        say(f"{number:4d}  {times}    {' and '.join(row_pass.sides):<14} {row_pass.confidence:4.2f}")
    say(f"wrote {into or output}: look through it before mapping")
    if sheet is not None:
        say(f"wrote {sheet}")
    say(
        f"{result.frames_decoded} frames decoded for {result.frame_pairs} pairs of pictures, "
        f"of {result.frames} in the recording"
    )
