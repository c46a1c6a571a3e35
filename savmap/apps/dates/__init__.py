"""Two dates of a place: what changed, and passes along rows that an earlier map has."""

from savmap.plugin.apps import App, Command

APP = App(
    commands={
        "compare": Command(f"{__name__}.command:compare", "Say what changed from one map of a place to a later one.")
    },
    dates=f"{__name__}.since",
)
