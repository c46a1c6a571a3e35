"""What `savmap map` is asked to do, checked before anything heavy begins."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from savmap.errors import OutputError, PluginError, SiteError
from savmap.files.atomic import reason
from savmap.plugin.isolation import isolated
from savmap.plugin.manager import LoadedPlugin, lacking, load_installed, open_plugins
from savmap.site.load import draft_of, read_draft, site_of
from savmap.site.locations import SourceMap
from savmap.site.model import Site
from savmap.site.overrides import Override

VIDEO_ROW = "1"
LEAST_ROOM = 1 << 20
LEAST_HEIGHT_M, MOST_HEIGHT_M = 0.1, 50.0
VIDEO_SUFFIXES = (".mp4", ".mov", ".m4v", ".mkv", ".insv", ".avi")


@dataclass(frozen=True)
class Job:
    """One `savmap map`: the site, where it was read, which plugins, where to write, a map whose camera path is known,
    where the site's keys were given, and a line where nobody named plugins."""

    site: Site
    source: Path
    plugins: Sequence[str]
    output: Path
    earlier: Path | None = None
    places: SourceMap = field(default_factory=lambda: SourceMap("options"))
    note: str = ""


def job_for(
    source: Path,
    plugins: Sequence[str] | None,
    output: Path,
    camera_height_m: float | None = None,
    side: str | None = None,
    earlier: Path | None = None,
    overrides: Sequence[Override] = (),
) -> Job:
    """The job that the command line describes. `source` is a site file, or a video (or folder of pictures); `overrides` are
    set in either.

    Raises SiteError for a bad site file or options that do not fit it.
    """
    if source.is_dir() or source.suffix.lower() in VIDEO_SUFFIXES:
        content = video_content(source, camera_height_m, side)
        draft = draft_of(content, SourceMap(str(source)), Path(), overrides)
        site = site_of(draft)
        names, note = chosen_plugins(site, plugins)
        return Job(site, source, names, output, earlier, draft.places, note)
    if camera_height_m is not None or side is not None:
        raise SiteError(
            f"{source}: --camera-height and --side go with a video; a site file has `references` and `side`"
        )
    draft = read_draft(source, overrides)
    site = site_of(draft)
    names, note = chosen_plugins(site, plugins)
    return Job(site, source, names, output, earlier, draft.places, note)


def chosen_plugins(site: Site, named: Sequence[str] | None) -> tuple[Sequence[str], str]:
    """The plugins of a job: those that are named, else those of the site, else all installed ones that can be used and have what
    they need, with a line that says so and which were left out. Raises SiteError where an option names none, PluginError where
    there is none."""
    if named is not None and not named:
        raise SiteError("--plugins: names none; give one or more, with commas between, or leave the option out")
    if named or site.plugins:
        return named or list(site.plugins), ""
    plugins = load_installed()
    missing = {name: lacking(plugin_class) for name, plugin_class in plugins.classes.items()}
    taken = [name for name, packages in missing.items() if not packages]
    left = "".join(f"; not {name} ({' and '.join(lost)} not installed)" for name, lost in missing.items() if lost)
    left += "".join(f"; not {name}: {reason}" for name, reason in plugins.broken.items())
    if not taken:
        raise PluginError(f"no plugin is installed that has all it needs{left}; name one with --plugins")
    return taken, f"no plugins are named: looking for {', '.join(taken)}{left}"


def video_content(video: Path, camera_height_m: float | None, side: str | None) -> dict[str, Any]:
    """The content of a site of one row and one pass. Raises SiteError for options out of range."""
    if side not in (None, "left", "right"):
        raise SiteError(f"--side {side}: it is `left` or `right`, the hand the face is on as one drives along")
    if camera_height_m is not None and not LEAST_HEIGHT_M < camera_height_m < MOST_HEIGHT_M:
        raise SiteError(f"--camera-height {camera_height_m:g}: metres are expected{_in_metres(camera_height_m)}")
    height = {"camera_height_m": {"value": camera_height_m}} if camera_height_m is not None else {}
    return {"references": height, "rows": {VIDEO_ROW: {"passes": [{"video": video, "side": side}]}}}


def _in_metres(height: float) -> str:
    for unit, size in (("cm", 0.01), ("mm", 0.001)):
        if 1 < size * height < 10:
            return f"; {height:g} {unit} are {size * height:g}"
    return f", between {LEAST_HEIGHT_M:g} and {MOST_HEIGHT_M:g}"


def plugins_for(job: Job, row: str) -> Sequence[LoadedPlugin]:
    """The job's plugins, each with its settings for one row."""
    site = job.site
    plugins = open_plugins(job.plugins, lambda plugin: site.row_config(row, plugin), str(job.source), site.providers)
    return isolated(plugins, row) if skips(job) else plugins


def skips(job: Job) -> bool:
    """Whether all else is to be mapped where a plugin fails."""
    return job.site.on_plugin_error == "skip"


def prepare(folder: Path) -> None:
    """Make the output folder. Raises OutputError when nothing can be written there, or next to nothing."""
    probe = folder / ".savmap-probe"
    if folder.is_file():
        raise OutputError(f"{folder}: is a file, not a folder; choose another -o")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe.write_bytes(bytes(LEAST_ROOM))
    except OSError as error:
        raise OutputError(f"{folder}: nothing can be written there: {reason(error)}") from None
    finally:
        with suppress(OSError):
            probe.unlink(missing_ok=True)
