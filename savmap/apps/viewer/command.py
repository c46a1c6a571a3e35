"""The command `savmap view`."""

from pathlib import Path
from typing import Annotated

import typer

from savmap.cli.commands.options import warn_of_earlier
from savmap.cli.speech import say


def view(
    source: Annotated[Path, typer.Argument(metavar="FOLDER", help="The folder of a map, or its map.json.")] = Path(
        "out"
    ),
    serve: Annotated[
        bool, typer.Option("--serve", help="Serve it to this machine's browser until Ctrl+C, for large sites.")
    ] = False,
    live: Annotated[
        bool, typer.Option("--live", help="Serve a page that follows a session of `savmap live` in this folder.")
    ] = False,
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="The port of --serve and --live (0: one that is free).")
    ] = 0,
    survey: Annotated[Path | None, typer.Option(help="A survey file to show errors against.")] = None,
    against: Annotated[
        Path | None, typer.Option(metavar="OLD", help="An earlier map, or its folder, to show with it.")
    ] = None,
    fresh: Annotated[bool, typer.Option("--fresh", help="Write the page anew.")] = False,
    show: Annotated[bool, typer.Option("--open/--no-open", help="Open it in the browser.")] = True,
) -> None:
    """Look at a map in the browser: 3D, panoramas, search, measuring. Writes view.html where that of this map is not
    there."""
    import webbrowser

    from savmap.apps.viewer import api
    from savmap.apps.viewer.serve import ViewServer

    if live:
        follow(source, port, show)
        return
    for given in (source, against):
        warn_of_earlier(given)
    page_view = api.view(source, survey=survey, against=against, fresh=fresh, show=False)
    if page_view.written:
        say(f"wrote {page_view.page}")
    if not serve:
        if not show or not page_view.open():
            say(f"open {page_view.page} in a browser")
        return
    with ViewServer(page_view.page, port) as server:
        say(f"{server.address} shows {page_view.page}; Ctrl+C ends it")
        if show:
            webbrowser.open(server.address)
        server.run()


def follow(folder: Path, port: int, show: bool) -> None:
    """Serve the page of a live session until the user ends it."""
    import webbrowser

    from savmap.apps.viewer.live import LiveServer
    from savmap.errors import OutputError

    if not folder.is_dir():
        raise OutputError(f"{folder}: is no folder; give the one that `savmap live -o` writes into")
    with LiveServer(folder, port) as server:
        say(f"{server.address} follows {folder}; Ctrl+C ends it")
        if show:
            webbrowser.open(server.address)
        server.run()
