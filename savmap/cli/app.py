"""The command line: commands that are imported when they are asked for, and how it is run."""

from collections.abc import Iterator, Mapping
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from savmap.cli.commands import COMMANDS, help_text, of_apps
from savmap.cli.endings import plain_endings
from savmap.plugin.apps import Command, target_of


class _Commands(Mapping[str, Any]):
    """Commands of the core and of apps by name, each imported when it is asked for."""

    def __getitem__(self, name: str) -> Any:
        return _command(name, {**of_apps(), **COMMANDS}[name])

    def __iter__(self) -> Iterator[str]:
        return iter({**COMMANDS, **of_apps()})

    def __len__(self) -> int:
        return len({**COMMANDS, **of_apps()})


class _Group(TyperGroup):
    def __init__(self, **attributes: Any) -> None:
        super().__init__(**attributes)
        self.commands = _Commands()  # type: ignore[assignment]  # no command is added

    def get_help(self, ctx: Any) -> str:
        return help_text()


def _new_app(**settings: Any) -> typer.Typer:
    return typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None, **settings)


def _command(name: str, command: Command) -> Any:
    target = target_of(command.target)
    if not isinstance(target, typer.Typer):
        single = _new_app()
        single.command(name)(target)
        target = single
    return typer.main.get_command(target)


app = _new_app(name="savmap", cls=_Group, no_args_is_help=True)


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


def main() -> None:
    """Run the command line. Expected errors end it with one line and their exit code (docs/exit-codes.md)."""
    with plain_endings():
        app()
