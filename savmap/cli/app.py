"""The command line: its commands in their order, and how it is run. Everything heavy is imported when it is needed."""

import sys
from collections.abc import Callable, Mapping
from typing import Annotated

import typer

from savmap.cli.commands import installation, mapping, plugin, results, sources, surveys
from savmap.cli.endings import plain_endings

COMMANDS: Mapping[str, Callable[..., None]] = {
    "map": mapping.map_,
    "init": mapping.init,
    "check": mapping.check,
    "demo": mapping.demo,
    "evaluate": results.evaluate,
    "report": results.report,
    "compare": results.compare,
    "view": results.view,
    "export": results.export,
    "align": results.align,
    "import": surveys.import_,
    "find": results.find,
    "measure": results.measure,
    "plugins": installation.plugins,
    "split": sources.split,
    "schema": installation.schema,
    "simulate": sources.simulate,
    "train": sources.train,
    "adapt": sources.adapt,
    "label": sources.label,
}
GROUPS = {"plugin": plugin.app}

app = typer.Typer(
    name="savmap",
    help="Metric, semantic wireframe maps of structured places from panoramic video.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
for name, command in COMMANDS.items():
    app.command(name)(command)
for name, group in GROUPS.items():
    app.add_typer(group, name=name)


def _version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        typer.echo(f"savmap {version('savmap')}")
        raise typer.Exit


@app.callback()
def options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Metric, semantic wireframe maps of structured places from panoramic video."""


def _plugin_commands() -> None:
    """Let installed third-party plugins add commands, when the first argument is none of ours."""
    wanted = next((word for word in sys.argv[1:] if not word.startswith("-")), None)
    if wanted is not None and wanted not in COMMANDS.keys() | GROUPS.keys():
        from savmap.plugin.manager import register_commands

        register_commands(app)


def main() -> None:
    """Run the command line. Expected errors end it with one line and their exit code (docs/exit-codes.md)."""
    with plain_endings():
        _plugin_commands()
        app()
