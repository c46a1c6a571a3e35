"""Long recordings in which a cart weaves through aisles: their passes, found from few of their frames."""

from savmap.plugin.apps import App, Command

APP = App(
    commands={"split": Command(f"{__name__}.command:split", "Find the passes through aisles in a long recording.")},
)
