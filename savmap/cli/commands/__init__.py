"""The core's commands in the order of their use, those of apps, and the help that lists them, for which none is
imported."""

from collections.abc import Mapping

from savmap.plugin.apps import Command, apps

_COMMANDS = "savmap.cli.commands"
COMMANDS: Mapping[str, Command] = {
    "map": Command(f"{_COMMANDS}.mapping:map_", "Map a site (default: site.yaml of this folder) or one video."),
    "init": Command(f"{_COMMANDS}.mapping:init", "Write a commented site file to start from."),
    "check": Command(f"{_COMMANDS}.mapping:check", "Say what is wrong with a site file, and what a run will take."),
    "demo": Command(f"{_COMMANDS}.mapping:demo", "Map the footage that ships with savmap and score it."),
    "evaluate": Command(f"{_COMMANDS}.results:evaluate", "Score a map against a survey."),
    "report": Command(f"{_COMMANDS}.results:report", "Write a map's report: one HTML page."),
    "export": Command(f"{_COMMANDS}.results:export", "Write a map in another format."),
    "align": Command(f"{_COMMANDS}.results:align", "Say where a finished map stands in your own world."),
    "find": Command(f"{_COMMANDS}.results:find", "Say where in a map a structure is, or a place between them."),
    "measure": Command(f"{_COMMANDS}.results:measure", "Say how far two vertices are apart, and how sure that is."),
    "plugins": Command(f"{_COMMANDS}.installation:plugins", "List the installed plugins."),
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


def of_apps() -> Mapping[str, Command]:
    """The commands that installed apps bring, by name."""
    return {name: command for app in apps().values() for name, command in app.commands.items()}


def help_text() -> str:
    """What `savmap --help` prints."""
    lines = {name: f"  {name:9} {command.help}" for name, command in {**of_apps(), **COMMANDS}.items()}
    of_core, others = ([line for name, line in lines.items() if (name in COMMANDS) is core] for core in (True, False))
    return "\n".join([HELP + "\n".join(of_core), "", "With finished maps, and beside mapping:", *others])
