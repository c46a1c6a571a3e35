"""What `savmap map` is asked to do, checked before anything heavy begins."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from savmap import site as sites
from savmap.errors import OutputError, SiteError
from savmap.io.sitefile import load_site
from savmap.rooms import Room, installed, open_rooms

VIDEO_SUFFIXES = (".mp4", ".mov", ".m4v", ".mkv", ".insv", ".avi")


@dataclass(frozen=True)
class Job:
    """One `savmap map`: the site, where it was read, which plugins, where to write, a map whose camera path is known."""

    site: sites.Site
    source: Path
    plugins: Sequence[str]
    output: Path
    earlier: Path | None = None


def job_for(
    source: Path,
    plugins: Sequence[str] | None,
    output: Path,
    camera_height_m: float | None = None,
    side: str | None = None,
    earlier: Path | None = None,
) -> Job:
    """The job that the command line describes. `source` is a site file, or a video (or folder of pictures).

    Raises SiteError for a bad site file or options that do not fit it.
    """
    if source.is_dir() or source.suffix.lower() in VIDEO_SUFFIXES:
        site = video_site(source, camera_height_m, side)
        return Job(site, source, plugins or list(installed()), output, earlier)
    if camera_height_m is not None or side is not None:
        raise SiteError(
            f"{source}: --camera-height and --side go with a video; a site file has `references` and `side`"
        )
    site = load_site(source)
    names = plugins or list(site.plugins) or list(installed())
    return Job(site, source, names, output, earlier)


def video_site(video: Path, camera_height_m: float | None, side: str | None) -> sites.Site:
    """A site of one row and one pass."""
    if side not in (None, "left", "right"):
        raise SiteError(f"--side {side}: it is `left` or `right`, the hand the face is on as one drives along")
    if camera_height_m is not None and not 0.1 < camera_height_m < 50:
        raise SiteError(f"--camera-height {camera_height_m}: metres are expected, between 0.1 and 50")
    height = {"camera_height_m": {"value": camera_height_m}} if camera_height_m is not None else {}
    one = {"video": video, "side": side}
    return sites.Site.model_validate({"references": height, "rows": {"row": {"passes": [one]}}})


def rooms_for(job: Job, row: str) -> Sequence[Room]:
    """The job's plugins, each with its settings for one row."""
    return open_rooms(job.plugins, lambda plugin: job.site.row_config(row, plugin), str(job.source))


def prepare(folder: Path) -> None:
    """Make the output folder. Raises OutputError when nothing can be written there."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / ".savmap-probe"
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise OutputError(f"{folder}: nothing can be written there: {error.strerror or error}") from None
