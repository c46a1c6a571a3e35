"""The commands in the order of their use, and the help that lists them, for which none is imported."""

from collections.abc import Mapping
from typing import NamedTuple


class Command(NamedTuple):
    """A command: the function, or the Typer app, that it is ("module:name"), and its line of the help."""

    target: str
    help: str


_COMMANDS = "savmap.cli.commands"
COMMANDS: Mapping[str, Command] = {
    "map": Command(f"{_COMMANDS}.mapping:map_", "Map a site (default: site.yaml of this folder) or one video."),
    "live": Command(f"{_COMMANDS}.live:live", "Map a row while it is filmed, and say what to do better."),
    "plane": Command(f"{_COMMANDS}.mapping:plane", "Find the path of any drive, and picture a wall beside it."),
    "init": Command(f"{_COMMANDS}.mapping:init", "Write a commented site file to start from."),
    "check": Command(f"{_COMMANDS}.mapping:check", "Say what is wrong with a site file, and what a run will take."),
    "demo": Command(f"{_COMMANDS}.mapping:demo", "Map the footage that ships with savmap and score it."),
    "evaluate": Command(f"{_COMMANDS}.results:evaluate", "Score a map against a survey."),
    "report": Command(f"{_COMMANDS}.results:report", "Write a map's report: one HTML page."),
    "inspect": Command(f"{_COMMANDS}.results:inspect", "Say what in a map keeps the limits of an inspection."),
    "compare": Command(f"{_COMMANDS}.results:compare", "Say what changed from one map of a place to a later one."),
    "view": Command(f"{_COMMANDS}.results:view", "Look at a map in the browser: 3D, panoramas, search, measuring."),
    "export": Command(f"{_COMMANDS}.results:export", "Write a map in another format."),
    "align": Command(f"{_COMMANDS}.results:align", "Say where a finished map stands in your own world."),
    "import": Command(
        f"{_COMMANDS}.surveys:import_", "Make a survey file out of tables, drawings and building models."
    ),
    "find": Command(f"{_COMMANDS}.results:find", "Say where in a map a structure is, or a place between them."),
    "measure": Command(f"{_COMMANDS}.results:measure", "Say how far two vertices are apart, and how sure that is."),
    "plugins": Command(f"{_COMMANDS}.installation:plugins", "List the installed plugins."),
    "split": Command(f"{_COMMANDS}.sources:split", "Find the passes through aisles in a long recording."),
    "schema": Command(f"{_COMMANDS}.installation:schema", "Print the JSON Schema of site files or maps."),
    "simulate": Command("savmap.lab.commands:simulate", "Make footage of a made-up place, with its truth."),
    "train": Command("savmap.lab.commands:train", "Train or fine-tune a plugin's network (extra `train`)."),
    "adapt": Command("savmap.lab.commands:adapt", "Let a site teach a plugin's network (extra `train`)."),
    "label": Command("savmap.lab.commands:label", "Choose the views most worth labelling, and write them."),
    "plugin": Command(f"{_COMMANDS}.plugin:app", "For those who write plugins."),
}
HELP = """Usage: savmap [OPTIONS] COMMAND [ARGS]...

  Metric, semantic wireframe maps of structured places from panoramic video.

Options:
  --version  Print the version.
  --help     Show this message and exit.

Commands:
"""


def help_text() -> str:
    """What `savmap --help` prints."""
    return HELP + "\n".join(f"  {name:9} {command.help}" for name, command in COMMANDS.items())
