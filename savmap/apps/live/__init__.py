"""Mapping while one walks: a session takes frames as they come, says what to do better, and maps what it has seen."""

from savmap.plugin.apps import App, Command

APP = App(
    commands={"live": Command(f"{__name__}.command:live", "Map a row while it is filmed, and say what to do better.")},
)
