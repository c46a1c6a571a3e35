"""The viewer: a page beside each map, in a browser or a notebook."""

from savmap.plugin.apps import App, Command

APP = App(
    commands={
        "view": Command(f"{__name__}.command:view", "Look at a map in the browser: 3D, panoramas, search, measuring.")
    },
    html=f"{__name__}.notebook:map_html",
    viewer=f"{__name__}.beside",
)
