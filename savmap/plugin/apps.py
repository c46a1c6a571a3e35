"""Apps: what uses finished maps, or sits beside mapping. Those that come with savmap and those of others are found
alike: by entry points of the group `savmap.apps`, each of which names an `App`. No other package of savmap imports one.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from savmap.errors import PluginError, format_error

if TYPE_CHECKING:  # the command line lists commands of apps and needs no numpy for that
    from savmap.types import Evaluation, Orthophoto, RowMap, RowPlace, SiteMap, Still, Structure

GROUP = "savmap.apps"
notices = logging.getLogger("savmap-plugins")


class Command(NamedTuple):
    """A command: the function, or the Typer app, that it is ("module:name"), and its line of the help."""

    target: str
    help: str


@dataclass(frozen=True)
class App:
    """What an app brings, named as "module:name" and imported when it is used.

    `commands`: of the command line, by name. `formats`: functions (SiteMap, Path) that write a map, by the format's
    name; they get rows that have a place in one frame. `html`: a function of a SiteMap that gives what a notebook shows
    of it. `viewer`: a `Viewer`, and `dates`: a `Dates`, or modules that are."""

    commands: Mapping[str, Command] = field(default_factory=dict)
    formats: Mapping[str, str] = field(default_factory=dict)
    html: str = ""
    viewer: str = ""
    dates: str = ""


@dataclass(frozen=True, eq=False)
class WrittenMap:
    """A map that a run wrote, with what is written beside it: the map's file, its scores where there is a survey (a
    file), a title, orthophotos and stills by row, and places between structures by row and plugin."""

    file: Path
    site_map: SiteMap
    evaluation: Evaluation | None
    survey: Path | None
    title: str
    photos: Mapping[str, Orthophoto]
    stills: Mapping[str, Sequence[Still]]
    places: Mapping[str, Mapping[str, Sequence[Structure]]]


class Viewer(Protocol):
    """Writes a page beside each map that a run writes."""

    PAGE: str
    """The name of the page's file."""

    def files_of(self, rows: Sequence[str], folder: Path) -> list[Path]:
        """Files that are written of rows into a folder, one of each kind in each folder, for a test whether they can
        be."""
        ...

    def write_beside(self, written: WrittenMap) -> None:
        """Write the page. Raises OutputError."""
        ...


class Changes(Protocol):
    """What changed from an earlier map to a later one."""

    def lines(self) -> list[str]:
        """For the terminal."""
        ...

    def section(self, viewer: str) -> str:
        """For the report, as HTML; `viewer`: the address of the viewer's page, where there is one."""
        ...


class Dates(Protocol):
    """Knows a row again that an earlier map has, and what changed in it."""

    def recognised(self, seen: RowMap, rows: Mapping[str, RowMap]) -> RowPlace:
        """Where a pass, mapped in any scale, lies in one of these rows. Raises StructureError where it could be at
        several places, or at none."""
        ...

    def in_row(self, row: RowMap, place: RowPlace, mapped: RowMap) -> RowMap:
        """A pass that was solved in metres, in the mapped row's frame, with its name."""
        ...

    def updated(
        self, earlier: SiteMap, passes: Mapping[str, RowMap], made_by: Mapping[str, str]
    ) -> tuple[SiteMap, Changes]:
        """The earlier map with passes of its rows, by name. Raises StructureError where one fits elsewhere better."""
        ...

    def changes_since(self, old_file: Path, new: SiteMap) -> Changes:
        """What changed since the map of a file. Raises SavmapError."""
        ...


@cache
def apps() -> Mapping[str, App]:
    """The installed apps by name; one that cannot be imported is left out, and named in a warning."""
    found_apps = dict[str, App]()
    for point in sorted(entry_points(group=GROUP), key=lambda point: point.name):
        try:
            app = point.load()
        except (Exception, SystemExit) as error:
            notices.warning("app `%s` (%s) cannot be imported: %s", point.name, point.value, format_error(error))
            continue
        if isinstance(app, App) and all(isinstance(command, Command) for command in app.commands.values()):
            found_apps[point.name] = app
        else:
            notices.warning(
                "app `%s` (%s) is no savmap.plugin.apps.App, or a command of it is no Command", point.name, point.value
            )
    return found_apps


def target_of(address: str) -> Any:
    """What an address "module:name", or "module", names. Raises PluginError where it is not there."""
    module, _, name = address.partition(":")
    try:
        return getattr(import_module(module), name) if name else import_module(module)
    except (ImportError, AttributeError) as error:
        raise PluginError(f"`{address}`, which an app names, cannot be imported: {format_error(error)}") from error


def viewer() -> Viewer | None:
    """The viewer of the first app that has one."""
    return next((target_of(app.viewer) for app in apps().values() if app.viewer), None)


def dates() -> Dates:
    """That of the first app that has it. Raises PluginError where none has."""
    for app in apps().values():
        if app.dates:
            result: Dates = target_of(app.dates)
            return result
    raise PluginError("an earlier map needs an app that compares maps, and none is installed")


def html_of(site_map: SiteMap) -> str | None:
    """What a notebook shows of a map, by the first app that can tell."""
    for app in apps().values():
        if app.html:
            shown: str = target_of(app.html)(site_map)
            return shown
    return None
