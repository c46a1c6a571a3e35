"""What `savmap map` is asked to do, checked before anything heavy begins."""

import tempfile
import uuid
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from numbers import Real
from pathlib import Path
from typing import Any

from savmap.errors import OutputError, PluginError, SiteError
from savmap.files.atomic import PREFIX, reason, require_no_device
from savmap.files.urls import is_url
from savmap.files.validation import SHORT
from savmap.maps.map_file import map_in
from savmap.plugin.isolation import isolated
from savmap.plugin.manager import LoadedPlugin, lacking, load_installed, open_plugin
from savmap.site.load import draft_of, is_footage, notes_on, read_draft, site_of
from savmap.site.locations import SourceMap
from savmap.site.model import SIDES, Side, Site
from savmap.site.overrides import Override
from savmap.site.sections import MODELS

VIDEO_ROW = "1"
LEAST_ROOM = 1 << 20
LEAST_HEIGHT_M, MOST_HEIGHT_M = 0.1, 50.0
SITE_FILE = "site.yaml"
_received: dict[str, "Job"] = {}


@dataclass(frozen=True, eq=False)
class Job:
    """One run: the site, where it was read, the names of its plugins, where to write, a map whose camera path is known,
    where the site's keys were given, and notes: sections that are empty, which plugins are taken where nobody named
    any. `against`: a map of the same rows that the run updates; `against_row`: which row of it the passes show, where
    the user says so.

    A job opens each plugin once for each of its settings. One that reaches another process several times is the same
    object there, so this holds for every process.
    """

    site: Site
    source: Path
    plugins: Sequence[str]
    output: Path
    earlier: Path | None = None
    places: SourceMap = field(default_factory=lambda: SourceMap("options"))
    notes: tuple[str, ...] = ()
    against: Path | None = None
    against_row: str | None = None
    token: str = field(default_factory=lambda: uuid.uuid4().hex)
    _opened: dict[tuple[str, str], LoadedPlugin] = field(default_factory=dict, init=False, repr=False)

    def __reduce__(self) -> tuple[Any, ...]:
        return _restored, (self.token, {part.name: getattr(self, part.name) for part in fields(self) if part.init})

    @property
    def skips_failed_plugins(self) -> bool:
        """Whether all else is mapped where a plugin fails."""
        return self.site.on_plugin_error == "skip"

    def opened(self, row: str, name: str) -> LoadedPlugin:
        """A plugin with its settings for one row. Raises PluginError for an unknown or broken one, SiteError for its
        settings."""
        settings = self.site.plugin_config(row, name)
        key = (name, repr(sorted(settings.items())))
        if key not in self._opened:
            self._opened[key] = open_plugin(name, settings, str(self.source), self.site.providers)
        return self._opened[key]


def _restored(token: str, values: Mapping[str, Any]) -> Job:
    """The job of this token in this process."""
    if token not in _received:
        _received.clear()
        _received[token] = Job(**values)
    return _received[token]


def plugins_for(job: Job, row: str) -> Sequence[LoadedPlugin]:
    """The job's plugins, each with its settings for one row."""
    plugins = [job.opened(row, name) for name in dict.fromkeys(job.plugins)]
    return isolated(plugins, row) if job.skips_failed_plugins else plugins


def job_for(
    source: Path,
    plugins: Sequence[str] | None,
    output: Path,
    camera_height_m: float | None = None,
    side: str | None = None,
    earlier: Path | None = None,
    overrides: Sequence[Override] = (),
    against: Path | None = None,
    against_row: str | None = None,
    camera: Mapping[str, Any] | None = None,
) -> Job:
    """The job that the command line describes. `source` is a site file, a folder that holds one, or a video (or folder
    of pictures); `overrides` are set in either. Maps, or their folders: `earlier`, whose camera path is taken as known;
    `against`, which the run updates. `camera`: a video's, as the site file has it.

    Raises SiteError for a bad site file or options that do not fit it.
    """
    if (source / SITE_FILE).is_file():
        source = source / SITE_FILE
    if earlier is not None and against is not None:
        raise SiteError("--trajectory and --against: give one of them; --trajectory is for the same footage once more")
    if against_row is not None and against is None:
        raise SiteError(f"--row {against_row}: says which row of an earlier map is filmed; give that with --against")
    if is_footage(source):
        content = video_content(source, camera_height_m, side, camera)
        draft = draft_of(content, SourceMap(str(source)), Path(), overrides)
    elif camera_height_m is not None or side is not None or camera:
        raise SiteError(
            f"{source}: --camera-height and --side go with a video, as --camera does; a site file has `camera`, "
            "`references` and `side`"
        )
    else:
        draft = read_draft(source, overrides)
    site = site_of(draft)
    names, note = chosen_plugins(site, plugins)
    notes = (*notes_on(draft), *([note] if note else []))
    earlier, mapped = earlier and map_in(earlier), against and map_in(against)
    return Job(site, source, names, output, earlier, draft.places, notes, mapped, against_row)


def chosen_plugins(site: Site, named: Sequence[str] | None) -> tuple[Sequence[str], str]:
    """The plugins of a job: those that are named, else those of the site, else all installed ones that can be used and
    have what they need, with a line that says so and which were left out. Raises SiteError where an option names none,
    PluginError where there is none."""
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


def video_content(
    video: Path, camera_height_m: float | None, side: str | None, camera: Mapping[str, Any] | None = None
) -> dict[str, Any]:
    """The content of a site of one row and one pass. Raises SiteError for options out of range."""
    if side is not None:
        side_of(side)
    if camera_height_m is not None and (isinstance(camera_height_m, bool) or not isinstance(camera_height_m, Real)):
        raise SiteError(f"camera_height_m: a number of metres is expected (it is {SHORT.repr(camera_height_m)})")
    if camera_height_m is not None and not LEAST_HEIGHT_M < camera_height_m < MOST_HEIGHT_M:
        limits = f"between {LEAST_HEIGHT_M:g} and {MOST_HEIGHT_M:g}"
        raise SiteError(f"--camera-height {camera_height_m:g}: metres are expected, {limits}")
    height: dict[str, Any] = {"camera_height_m": {"value": camera_height_m}} if camera_height_m is not None else {}
    return {
        "references": height,
        "camera": camera or None,
        "rows": {VIDEO_ROW: {"passes": [{"video": video, "side": side}]}},
    }


def camera_content(model: str | None, hfov_deg: float | None, calibration: Path | None) -> dict[str, Any]:
    """The section `camera` of a site that options describe; empty where none is given. Raises SiteError for a part of
    a camera without its model, and for a model that is not known."""
    rest = {"hfov_deg": hfov_deg, "calibration": str(calibration.absolute()) if calibration else None}
    given = {key: value for key, value in rest.items() if value is not None}
    if model is None and given:
        raise SiteError("--hfov and --calibration say more of a --camera: pinhole, fisheye or fisheye-pair")
    if model is not None and model not in MODELS:
        raise SiteError(f"--camera {model}: it is one of {', '.join(MODELS)}")
    return {} if model is None else {"model": model, **given}


def side_of(given: str) -> Side:
    """The hand that an option names. Raises SiteError where it is none."""
    for side in SIDES:
        if given == side:
            return side
    raise SiteError(f"--side {given}: it is `left` or `right`, the hand the face is on as one drives along")


def prepare(folder: Path, files: Iterable[Path] = ()) -> None:
    """Make the output folder. Raises OutputError when nothing can be written there, or next to nothing, or where one of
    the `files` could not be written below it."""
    if folder.is_file():
        raise OutputError(f"{folder}: is a file, not a folder; choose another -o")
    probe = folder / f"{PREFIX}{uuid.uuid4().hex[:8]}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        try:
            probe.write_bytes(bytes(LEAST_ROOM))
        finally:
            probe.unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(f"{folder}: nothing can be written there: {reason(error)}") from None
    if not is_url(folder):
        _require_free(files, folder)


def _require_free(files: Iterable[Path], root: Path) -> None:
    """Raise OutputError where one of the files could not be written: what stands there, or on the way, is of another
    kind or may not be written to. Nothing is made."""
    folders: set[Path] = set()
    for path in files:
        if path.is_dir():
            raise OutputError(f"{path}: is a folder, and a file is to be written there; remove it or choose another -o")
        require_no_device(path)
        folders.add(next(above for above in path.parents if above == root or above.exists()))
    for folder in folders:
        try:
            tempfile.TemporaryFile(dir=folder).close()
        except OSError as error:
            text = "is a file, not a folder" if folder.is_file() else reason(error)
            raise OutputError(
                f"{folder}: nothing can be written there: {text}; remove it or choose another -o"
            ) from None
