"""Reading site files: YAML with errors that name file, line, key and a remedy."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from savmap.errors import SiteError
from savmap.files import yaml_text
from savmap.files.atomic import reason
from savmap.files.kinds import kind_of_file
from savmap.files.texts import bounded_text, head_of, is_text
from savmap.files.urls import in_folder
from savmap.files.validation import Location, path_of
from savmap.files.yaml_text import YamlError
from savmap.site.layout import misaligned, misplaced, with_places
from savmap.site.locations import SourceMap, explained, left_out, without_value
from savmap.site.model import Pass, Row, Site
from savmap.site.overrides import Override, applied
from savmap.site.sections import AlignSection, LayoutSection
from savmap.video.container import is_video

Part = TypeVar("Part", bound=BaseModel)
Problems = Sequence[tuple[Location, str]]
SITE_FILE = "site file"
SITE_SUFFIXES = (".yaml", ".yml")
HEAD = 4096
"""Bytes of a file by which it is text or not: every container that is read has other bytes in its first hundred."""
NEITHER = "is neither a site file (YAML, see docs/site-file.md) nor a video"


@dataclass(frozen=True)
class Draft:
    """What a site file holds, with overrides applied, before it is checked; `folder` is what relative paths are
    relative to."""

    content: Mapping[str, Any]
    places: SourceMap
    folder: Path
    doubles: Problems = ()


def is_footage(source: Path) -> bool:
    """Whether a source is footage rather than a site file, by what it holds: a folder, or a file that is no text. Its
    ending decides where it holds nothing, or nothing that can be opened as a video."""
    if source.is_dir():
        return True
    head = head_of(source, HEAD)
    if not head:
        return source.suffix.lower() not in SITE_SUFFIXES
    return not is_text(head) and (source.suffix.lower() not in SITE_SUFFIXES or is_video(source))


def load_site(path: Path, overrides: Iterable[Override] = ()) -> Site:
    """The site of a file, its relative paths taken from the file's folder.

    Raises SiteError with file and line for anything that is not as docs/site-file.md says.
    """
    return site_of(read_draft(path, overrides))


@dataclass(frozen=True)
class KnownAlignment:
    """Where the user says the site stands in their world, and where that was said: `at` is the section's place in its
    file."""

    section: AlignSection
    places: SourceMap
    at: Location = ("align",)

    def line(self, location: Location, text: str) -> str:
        """A line about a key of the section: its place, the key, and what is wrong."""
        in_file = (*self.at, *location)
        key = path_of(in_file)
        return f"{self.places.of(in_file)}: `{key}`: {text}" if key else f"{self.places.of(in_file)}: {text}"


def load_alignment(path: Path) -> KnownAlignment:
    """The section `align` of a file, or what stands in a file of it alone. Raises SiteError with file and line for what
    is not as docs/site-file.md says."""
    draft = read_draft(path, what="file with `align:`")
    at: Location = ("align",) if "align" in draft.content else ()
    return KnownAlignment(section_in(AlignSection, draft, at), draft.places, at)


def section_in(model: type[Part], draft: Draft, at: Location = ()) -> Part:
    """A draft as a model, or what stands at a key of it. Raises SiteError with the first problem's place."""
    for problem in (*dict(draft.doubles).values(), *without_value(model, draft.places, (at,)).values()):
        raise SiteError(problem)
    try:
        return model.model_validate(draft.content[str(at[0])] if at else draft.content)
    except ValidationError as error:
        problems = explained(error, model, draft.places, lambda location: (*at, *location))
        raise SiteError(next(iter(problems.values()))) from None


def read_draft(
    path: Path, overrides: Iterable[Override] = (), what: str = SITE_FILE, guide: str = "docs/site-file.md"
) -> Draft:
    """The content of a site file, or of another (`what`) that `guide` explains. Raises SiteError where it is no YAML or
    another file, or where an override does not fit it."""

    def refused(problem: str, line: int | None = None) -> SiteError:
        """Of a file that does not even have the name of a site file: it may have been meant for anything."""
        if what == SITE_FILE and path.suffix.lower() not in SITE_SUFFIXES:
            return SiteError(f"{path}: {NEITHER} ({f'line {line}: ' if line else ''}{problem})")
        return SiteError(f"{path}{f':{line}' if line else ''}: {problem}")

    kind = kind_of_file(path)
    if kind and kind != "a site file":
        raise SiteError(f"{path}: is {kind}, not a {what}")
    try:
        document = yaml_text.document(bounded_text(path, yaml_text.MOST_MB))
    except FileNotFoundError:
        advice = " (give one, or run in a folder that has a site.yaml)" if what == SITE_FILE else ""
        raise SiteError(f"{path}: no such {what}{advice}") from None
    except OSError as error:
        raise SiteError(f"{path}: cannot be read as a {what}: {reason(error)}") from None
    except YamlError as error:
        raise refused(f"not valid YAML: {error}", error.line) from None
    except ValueError as error:
        if what == SITE_FILE and not is_text(head_of(path, HEAD)) and is_video(path):
            raise SiteError(f"{path}: is a video, not a site file; `savmap init` writes one for it") from None
        raise refused(f"cannot be read as a {what}: it {error}") from None
    if not isinstance(document.content, dict):
        least = " with at least `rows:`" if what == SITE_FILE else ""
        raise refused(f"a {what} is a mapping{least} (see {guide})")
    doubles = tuple(
        (location, f"{path}:{line}: `{'.'.join(map(str, location))}` is given twice, first in line {first}")
        for location, first, line in document.doubles
    )
    places = SourceMap(str(path), document.lines, empty=document.empty)
    return draft_of(document.content, places, path.parent, overrides, doubles)


def draft_of(
    content: Mapping[str, Any],
    places: SourceMap,
    folder: Path,
    overrides: Iterable[Override] = (),
    doubles: Problems = (),
) -> Draft:
    """A draft with overrides applied. Raises SiteError where one does not fit."""
    changed, overridden = applied(content, overrides)
    return Draft(changed, replace(places, overridden=overridden), folder, doubles)


def problems_in(draft: Draft) -> Problems:
    """Everything that is wrong with a draft: the key, and a line that says where it stands and what is wrong."""
    problems = dict[Location, str]()
    align = None
    try:
        site = Site.model_validate(draft.content)
        layout, rows, align = site.layout, with_places(site), site.align
    except ValidationError as error:
        problems = explained(error, Site, draft.places)
        layout, rows = _layout_alone(draft.content)
    unfit = (*misplaced(layout, rows), *misaligned(align, rows))
    wrong = [(at, f"{draft.places.of(at)}: `{'.'.join(map(str, at))}`: {text}") for at, text in unfit]
    return [*draft.doubles, *{**problems, **without_value(Site, draft.places)}.items(), *wrong]


def notes_on(draft: Draft) -> tuple[str, ...]:
    """A line for each section of a draft in which nothing stands."""
    return tuple(left_out(Site, draft.places))


def _layout_alone(content: Mapping[str, Any]) -> tuple[LayoutSection | None, dict[str, bool]]:
    """The layout of a site with which other things are wrong, and its rows, with whether they have a place."""
    rows = content.get("rows")
    try:
        layout = LayoutSection.model_validate(content.get("layout"))
    except ValidationError:
        return None, {}
    named = rows.items() if isinstance(rows, Mapping) else ()
    return layout, {str(name): isinstance(row, Mapping) and row.get("place") is not None for name, row in named}


def site_of(draft: Draft) -> Site:
    """The site, its paths resolved. Raises SiteError for the first of its problems."""
    for _, problem in problems_in(draft):
        raise SiteError(problem)
    return _resolve(Site.model_validate(draft.content), draft.folder)


def sound_part(draft: Draft) -> Site | None:
    """The site without its layout, its alignment and the rows that something is wrong with; None where that leaves
    nothing, or where anything is wrong that concerns all rows."""
    wrong = [location for location, _ in problems_in(draft) if location[:1] not in (("layout",), ("align",))]
    broken = {str(location[1]) for location in wrong if location[:1] == ("rows",) and len(location) > 1}
    rows = draft.content.get("rows")
    if not isinstance(rows, Mapping) or any(at[:1] != ("rows",) or len(at) < 2 for at in wrong):
        return None
    kept = {name: row for name, row in rows.items() if str(name) not in broken}
    content = {key: value for key, value in draft.content.items() if key not in ("layout", "align")}
    return _resolve(Site.model_validate({**content, "rows": kept}), draft.folder) if kept else None


def _resolve(site: Site, folder: Path) -> Site:
    """The site with all its paths taken from a folder: those of videos, the survey and plugins' networks."""

    def of_pass(row_pass: Pass) -> Pass:
        camera = row_pass.camera
        if camera is not None and camera.calibration is not None:
            camera = camera.model_copy(update={"calibration": in_folder(folder, camera.calibration)})
        return row_pass.model_copy(update={"video": in_folder(folder, row_pass.video), "camera": camera})

    def of_row(row: Row) -> Row:
        passes = tuple(map(of_pass, row.passes))
        video = in_folder(folder, row.video) if row.video else None
        return row.model_copy(update={"passes": passes, "video": video, "plugins": _networks(row.plugins, folder)})

    changed: dict[str, Any] = {"rows": {name: of_row(row) for name, row in site.rows.items()}}
    changed["plugins"] = _networks(site.plugins, folder)
    changed |= {key: in_folder(folder, path) for key in ("survey", "video") if (path := getattr(site, key)) is not None}
    return site.model_copy(update=changed)


def _networks(plugins: Mapping[str, Mapping[str, Any]], folder: Path) -> dict[str, dict[str, Any]]:
    """Plugins' settings with their `model`, which every plugin has, taken from a folder."""
    named = {name: settings["model"] for name, settings in plugins.items() if isinstance(settings.get("model"), str)}
    paths = {name: {"model": str(folder / model)} for name, model in named.items()}
    return {name: {**settings, **paths.get(name, {})} for name, settings in plugins.items()}
