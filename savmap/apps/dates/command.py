"""The command `savmap compare`."""

from pathlib import Path
from typing import Annotated

import typer

from savmap.cli.commands.options import output_option, warn_of_earlier
from savmap.cli.speech import say


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
    from savmap.apps.dates.comparison.texts import comparison_lines, unsaid_text
    from savmap.apps.dates.files import compare_files
    from savmap.apps.viewer.beside import PAGE, viewed
    from savmap.errors import ChangedError, NothingComparedError
    from savmap.maps.map_file import map_in

    for source in (old, new):
        warn_of_earlier(source)
    view = map_in(new).with_name(PAGE) if in_viewer else None
    comparison = compare_files(old, new, level, output, json_file, view)
    if view is not None:
        viewed(new, fresh=True, against=old, comparison=comparison)
    for line in comparison_lines(comparison):
        say(line)
    for path in filter(None, (output, json_file, view)):
        say(f"wrote {path}")
    if exit_code and comparison.changed and comparison.compared:
        raise ChangedError(f"{new}: not as {old} has it")
    if exit_code and (unsaid := unsaid_text(comparison)):
        raise NothingComparedError(f"{new}: cannot be compared with {old}: {unsaid}")
