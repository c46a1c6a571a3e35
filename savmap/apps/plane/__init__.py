"""The path of any drive, and a picture of an upright wall beside it: no structure, no plugin, no network."""

from savmap.plugin.apps import App, Command

APP = App(
    commands={
        "plane": Command(f"{__name__}.command:plane", "Find the path of any drive, and picture a wall beside it.")
    }
)
