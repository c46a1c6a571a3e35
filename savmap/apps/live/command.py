"""The command `savmap live`."""

import os
from pathlib import Path
from typing import Annotated

import typer

from savmap.cli.commands.options import Output, Plugins, Sets, names_of
from savmap.files.urls import where


def live(
    source: Annotated[
        Path | None,
        typer.Argument(metavar="SOURCE", parser=where, help="A panoramic video, a folder that grows, or a site file."),
    ] = None,
    plugins: Plugins = None,
    output: Output = Path("out"),
    camera: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Film with a camera: /dev/video0, rtsp://..., or what FFmpeg opens."),
    ] = None,
    against: Annotated[
        Path | None,
        typer.Option(help="A map of the same place, or its folder: the pass is recognised in it and updates it."),
    ] = None,
    row: Annotated[
        str | None,
        typer.Option(help="The row of a site file; default: its first. With --against and no site file: of that map."),
    ] = None,
    pace: Annotated[float, typer.Option(min=0, help="How fast a file is played; 0: as fast as it can be read.")] = 1.0,
    idle: Annotated[float, typer.Option(min=0.1, help="A folder is complete when nothing came for so long, s.")] = 10.0,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with what an earlier session measured.")] = False,
    split: Annotated[
        bool,
        typer.Option("--split", help="Several aisles: find the rows in the recording at the end, as `split` does."),
    ] = False,
    mcap: Annotated[
        bool, typer.Option("--mcap", help="Write maps and advice into live.mcap, for Foxglove. Needs the extra `ros`.")
    ] = False,
    camera_height: Annotated[float | None, typer.Option(help="Camera height above the floor, m (for a video).")] = None,
    side: Annotated[str | None, typer.Option(help="left or right: the hand the face is on (for a video).")] = None,
    sets: Sets = None,
) -> None:
    """Map a row while it is filmed: provisional maps, and what to do better; at the end, all that was recorded is
    mapped as `savmap map` does."""
    from savmap.apps.live.console import walk_and_print
    from savmap.apps.live.sources import frames_of, live_job, recorded_job
    from savmap.site.load import is_footage
    from savmap.site.overrides import overrides_of

    overrides = overrides_of([*(sets or [])], os.environ)
    names = names_of(plugins)
    footage = source or Path("site.yaml" if camera is None else "recording.mkv")
    mapped_row = row if against is not None and is_footage(footage) else None
    filmed_row = row if mapped_row is None else None
    if camera is not None:
        job = recorded_job(source, names, output, filmed_row, resume, camera_height, side, overrides)
    else:
        job = live_job(footage, names, output, filmed_row, camera_height, side, overrides)
    job = job if against is None else job.coming_back(against, mapped_row)
    walk_and_print(job, frames_of(job.clip, camera, pace, idle), resume and camera is None, split, mcap)
