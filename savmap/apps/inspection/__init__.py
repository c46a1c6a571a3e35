"""Inspections: what the plugins find in a finished map, as records, a page for people, and files for programs."""

from savmap.plugin.apps import App, Command

APP = App(
    commands={
        "inspect": Command(f"{__name__}.command:inspect", "Say what in a map keeps the limits of an inspection.")
    },
)
