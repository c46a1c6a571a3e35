"""Commands that make maps: `savmap map`, and what goes before it."""

import os
import shlex
from contextlib import nullcontext
from pathlib import Path
from typing import Annotated

import typer

from savmap.cli.commands.options import Output, Plugins, Sets, names_of, output_option
from savmap.cli.speech import say
from savmap.files.urls import where


def map_(
    source: Annotated[
        Path, typer.Argument(metavar="SOURCE", parser=where, help="A site file, or a video for a first map.")
    ] = Path("site.yaml"),
    plugins: Plugins = None,
    output: Output = Path("out"),
    camera_height: Annotated[float | None, typer.Option(help="Camera height above the floor, m (for a video).")] = None,
    side: Annotated[str | None, typer.Option(help="left or right: the hand the face is on (for a video).")] = None,
    camera: Annotated[
        str | None,
        typer.Option(
            metavar="MODEL", help="panorama, pinhole, fisheye or fisheye-pair: what took the pictures (for a video)."
        ),
    ] = None,
    hfov: Annotated[
        float | None, typer.Option(help="Degrees between the left and the right border of its pictures.")
    ] = None,
    calibration: Annotated[
        Path | None, typer.Option(help="Its calibration by OpenCV, ROS or Kalibr, in place of --hfov.")
    ] = None,
    trajectory: Annotated[Path | None, typer.Option(help="A map, or its folder, whose camera path is known.")] = None,
    against: Annotated[
        Path | None,
        typer.Option(help="A map of the same place, or its folder: this pass is recognised in it and updates it."),
    ] = None,
    row: Annotated[
        str | None, typer.Option(help="The row of that map which the pass shows. Default: found out.")
    ] = None,
    preview: Annotated[bool, typer.Option(help="Only write pictures of the chosen views.")] = False,
    jobs: Annotated[
        int | None,
        typer.Option(
            min=0, help="Rows mapped at a time, each in a process of its own (0: in this one; default: as fits)."
        ),
    ] = None,
    cluster: Annotated[
        str | None, typer.Option(help="A Dask scheduler whose workers map the rows, such as tcp://host:8786.")
    ] = None,
    fresh: Annotated[
        bool, typer.Option(help="Do everything again, whatever an earlier run left in the folder.")
    ] = False,
    no_orthophotos: Annotated[
        bool, typer.Option("--no-orthophotos", help="Make no pictures of the rows' faces out of the frames.")
    ] = False,
    no_panoramas: Annotated[
        bool, typer.Option("--no-panoramas", help="Keep none of the panoramas to be looked at in the viewer.")
    ] = False,
    sets: Sets = None,
) -> None:
    """Map a site (default: site.yaml of this folder) or one video. What an earlier run left in the folder, if it still
    holds, is not done again."""
    from savmap.cli.mapping import failures_told, map_and_print, preview_and_print
    from savmap.site.job import camera_content, job_for
    from savmap.site.overrides import overrides_of

    off = {"orthophotos=false": no_orthophotos, "panoramas=false": no_panoramas}
    overrides = overrides_of([*(sets or []), *(setting for setting, chosen in off.items() if chosen)], os.environ)
    with nullcontext() if preview else failures_told(source, output):
        seen_by = camera_content(camera, hfov, calibration)
        job = job_for(
            source, names_of(plugins), output, camera_height, side, trajectory, overrides, against, row, seen_by
        )
        preview_and_print(job) if preview else map_and_print(job, jobs, fresh, cluster)


def init(
    videos: Annotated[list[Path] | None, typer.Argument(metavar="VIDEO", help="A row is made for each.")] = None,
    output: Annotated[Path, output_option("The site file to write.")] = Path("site.yaml"),
    force: Annotated[bool, typer.Option("--force", help="Overwrite a file that is there.")] = False,
) -> None:
    """Write a commented site file to start from."""
    from savmap.site.template import start

    site, schema = start(videos or [], output, force)
    say(f"wrote {site} and {schema}")
    say(f"say in {site.name} what you know of the site, then run `savmap check {shlex.quote(str(site))}`")


def check(
    source: Annotated[Path, typer.Argument(metavar="SITE", help="A site file.")] = Path("site.yaml"),
    plugins: Plugins = None,
    output: Output = Path("out"),
    trajectory: Annotated[Path | None, typer.Option(help="A map, or its folder, whose camera path is known.")] = None,
    pictures: Annotated[bool, typer.Option(help="Write a picture of the chosen views of each pass.")] = True,
    sets: Sets = None,
) -> None:
    """Say what is wrong with a site file, and what a run will take."""
    from savmap.cli.console import EchoMonitor
    from savmap.jobs.check import CheckError
    from savmap.jobs.check import check as check_site
    from savmap.site.overrides import overrides_of

    overrides = overrides_of(sets or [], os.environ)
    problems = check_site(source, names_of(plugins), output, EchoMonitor(), overrides, pictures, trajectory)
    if problems:
        raise CheckError(source, problems)


def demo(output: Output = Path("out/demo")) -> None:
    """Map the footage that ships with savmap and score it."""
    from savmap.cli.mapping import failures_told, map_and_print
    from savmap.demo import SITE
    from savmap.site.job import job_for

    with failures_told(SITE, output):
        map_and_print(job_for(SITE, None, output))
