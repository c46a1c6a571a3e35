"""What `savmap map` is asked to do, checked before anything heavy begins."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from savmap import site as sites
from savmap.errors import OutputError, SiteError, SolveError
from savmap.io.files import reason
from savmap.io.sitefile import load_site
from savmap.rooms import Room, installed, open_rooms

VIDEO_ROW = "1"
LEAST_ROOM = 1 << 20
LEAST_HEIGHT_M, MOST_HEIGHT_M = 0.1, 50.0
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
    """A site of one row and one pass. Raises SiteError for options out of range."""
    if side not in (None, "left", "right"):
        raise SiteError(f"--side {side}: it is `left` or `right`, the hand the face is on as one drives along")
    if camera_height_m is not None and not LEAST_HEIGHT_M < camera_height_m < MOST_HEIGHT_M:
        raise SiteError(f"--camera-height {camera_height_m:g}: metres are expected{_in_metres(camera_height_m)}")
    height = {"camera_height_m": {"value": camera_height_m}} if camera_height_m is not None else {}
    one = {"video": video, "side": side}
    return sites.Site.model_validate({"references": height, "rows": {VIDEO_ROW: {"passes": [one]}}})


def _in_metres(height: float) -> str:
    for unit, size in (("cm", 0.01), ("mm", 0.001)):
        if 1 < size * height < 10:
            return f"; {height:g} {unit} are {size * height:g}"
    return f", between {LEAST_HEIGHT_M:g} and {MOST_HEIGHT_M:g}"


def require_ready(job: Job) -> None:
    """Refuse at once what would fail after minutes of work.

    Raises PluginError or SiteError for a plugin or its settings, VideoError for a video or time range, OutputError for a
    survey that cannot be read, SolveError where nothing that was given could fix the scale.
    """
    from savmap.io.clip import time_range
    from savmap.io.survey import read_survey
    from savmap.io.video import probe
    from savmap.observe import clip_of

    for name, row in job.site.rows.items():
        rooms_for(job, name)
        for clip in map(clip_of, row.passes):
            time_range(clip, probe(clip.path, clip.images_fps).duration_s)
        if job.earlier is None and not _tells_scale(job, name):
            raise SolveError(
                f"row {name}: the map's scale is not known; give the camera's height (--camera-height with a video) "
                "or another reference in a site file (see docs/site-file.md)"
            )
    if job.site.survey is not None:
        read_survey(job.site.survey)


def _tells_scale(job: Job, row: str) -> bool:
    """Whether anything is given that might fix the scale: a reference, or what a plugin's settings say."""
    known = job.site.row_references(row)
    settings = any(job.site.row_config(row, plugin) for plugin in job.plugins)
    return bool(known.camera_height_m or known.lengths or known.points or known.markers or settings)


def rooms_for(job: Job, row: str) -> Sequence[Room]:
    """The job's plugins, each with its settings for one row."""
    return open_rooms(job.plugins, lambda plugin: job.site.row_config(row, plugin), str(job.source))


def prepare(folder: Path) -> None:
    """Make the output folder. Raises OutputError when nothing can be written there, or next to nothing."""
    probe = folder / ".savmap-probe"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe.write_bytes(bytes(LEAST_ROOM))
    except OSError as error:
        raise OutputError(f"{folder}: nothing can be written there: {reason(error)}") from None
    finally:
        with suppress(OSError):
            probe.unlink(missing_ok=True)
