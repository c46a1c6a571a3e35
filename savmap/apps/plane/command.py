"""The command `savmap plane`."""

import os
from pathlib import Path
from typing import Annotated

import typer

from savmap.cli.commands.options import Output
from savmap.cli.speech import say


def plane(
    video: Annotated[Path, typer.Argument(metavar="VIDEO", help="A panoramic video, or a folder of pictures.")],
    side: Annotated[str, typer.Option(help="left or right: the hand the wall is on as one goes along.")],
    distance: Annotated[float, typer.Option(min=0.05, help="How far the camera is from the wall, m.")],
    output: Output = Path("out"),
) -> None:
    """Find the path of a drive past any upright wall, and make a picture of the wall without perspective. No structure
    is looked for, and no plugin is needed; the map has the path alone."""
    from savmap.apps.plane.wall import map_plane
    from savmap.cli.console import Console
    from savmap.site.job import side_of

    with Console(Path(os.devnull)) as console:
        result = map_plane(video, side_of(side), distance, output, console)
    say(f"the path of {len(result.path.frames)} key frames is {result.length_m:.2f} m long")
    say(f"wrote {output / 'map.json'}")
    if result.photo is not None:
        say(f"wrote {output / 'plane.jpg'}: {1000 * result.photo.pixel_m:g} mm a pixel")
