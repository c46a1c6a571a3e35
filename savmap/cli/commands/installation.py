"""Commands about savmap itself: which plugins it has, which files it takes."""

from typing import Annotated

import typer


def plugins() -> None:
    """List the installed plugins."""
    from savmap.cli import tools

    for line in tools.plugin_lines():
        typer.echo(line)


def schema(name: Annotated[str, typer.Argument(metavar="site|map", help="Which kind of file.")]) -> None:
    """Print the JSON Schema of site files or maps."""
    from savmap.cli import tools

    typer.echo(tools.schema(name), nl=False)
