"""`view.html`: the viewer's script, style and data as one file that asks nothing of a network."""

import base64
import gzip
import hashlib
import html
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from string import Template

from savmap.files.atomic import write_text
from savmap.report.viewer.beside import (
    NOTHING,
    Beside,
    joints_apart,
    old_beside,
    remove_others,
    script_names,
    written_beside,
)
from savmap.report.viewer.data import page_data
from savmap.report.viewer.dates import Before
from savmap.report.viewer.packed import Entry, Places
from savmap.types import Evaluation, Orthophoto, SiteMap, Still

POLICY = "default-src 'none'; script-src 'sha256-{script}' 'self' file:; style-src 'sha256-{style}'; img-src data: blob:; base-uri 'none'; form-action 'none'"
"""Scripts: the page's own, and the pictures' that lie beside it (`file:` is what some browsers call 'self' there)."""


ORIGIN = re.compile(rb'<meta name="savmap-view" content="map=(\w*) survey=(\w*) against=(\w*) by=([^"]*)">')
HEAD = 4096
"""Bytes of a page in which its origin stands."""


@dataclass(frozen=True)
class Origin:
    """The files that a page is made of: SHA-256 of the map's, of the survey's and of the earlier map's; empty for none,
    or where nobody told."""

    map_digest: str = ""
    survey_digest: str = ""
    against_digest: str = ""

    def is_of(self, page: Path) -> bool:
        """Whether a page was made of this map by this viewer, and, where there are any here, with this survey and this
        earlier map."""
        try:
            with page.open("rb") as stream:
                found = ORIGIN.search(stream.read(HEAD))
        except OSError:
            return False
        if found is None or not self.map_digest:
            return False
        map_digest, survey_digest, against_digest, by = (part.decode(errors="replace") for part in found.groups())
        asked = self.survey_digest in ("", survey_digest) and self.against_digest in ("", against_digest)
        return map_digest == self.map_digest and asked and by == _viewer()

    def __str__(self) -> str:
        return f"map={self.map_digest} survey={self.survey_digest} against={self.against_digest} by={_viewer()}"


@dataclass(frozen=True, eq=False)
class View:
    """What the viewer shows: a map, its scores where there is a survey, and by row its orthophoto and stills, where
    there are any; None for the stills that lie where the page is written. `before`: an earlier date to show with it.
    `places`: by row and plugin, places between structures that have a name, such as what lies between two of them,
    whose sizes are shown."""

    site_map: SiteMap
    evaluation: Evaluation | None = None
    title: str = "Site map"
    photos: Mapping[str, Orthophoto] = field(default_factory=dict)
    stills: Mapping[str, Sequence[Still]] | None = None
    origin: Origin = Origin()
    before: Before | None = None
    places: Places = field(default_factory=dict)


def write_view(view: View, path: Path) -> None:
    """Write the page, and beside it the pictures that it loads when they are looked at. Raises OutputError."""
    apart, stills, before = joints_apart(view.site_map.rows), view.stills, view.before
    names, folder = script_names(view.site_map.rows), path.parent
    beside = {
        name: written_beside(
            names[name],
            Beside(
                view.photos.get(name), None if stills is None else stills.get(name, ()), row.joint if apart else None
            ),
            folder,
        )
        for name, row in view.site_map.rows.items()
    }
    old_names = script_names(before.site_map.rows) if before else {}
    for name, script in old_names.items():
        if before and before.is_shown(name):
            beside[name] = beside.get(name, NOTHING) | old_beside(script, before.photo(name), before.folder, folder)
    write_text(path, page_text(view, beside))
    remove_others(beside.values(), path.parent, with_stills=stills is not None)


def page_text(view: View, beside: Mapping[str, Entry]) -> str:
    """The page. Texts of the map are in it packed, as base64: none of them can be taken for HTML or script."""
    style, script = _resource("viewer.css"), _resource("viewer.js")
    data = page_data(view.site_map, view.title, view.evaluation, beside, view.before, view.places)
    packed = gzip.compress(json.dumps(data, separators=(",", ":"), allow_nan=False).encode(), mtime=0)
    return Template(_resource("page.html")).substitute(
        policy=POLICY.format(script=_digest(script), style=_digest(style)),
        made_of=html.escape(str(view.origin)),
        title=html.escape(view.title),
        style=style,
        script=script,
        data=base64.b64encode(packed).decode(),
    )


def _viewer() -> str:
    """savmap's version, and what tells its viewers of one version apart."""
    return f"{version('savmap')}+{_digest(_resource('viewer.js') + _resource('viewer.css'))[:12]}"


def _resource(name: str) -> str:
    return (files("savmap.report.viewer") / name).read_text(encoding="utf-8")


def _digest(text: str) -> str:
    return base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
