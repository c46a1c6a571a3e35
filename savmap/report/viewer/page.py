"""`view.html`: the viewer's script, style and data as one file that asks nothing of a network."""

import base64
import gzip
import hashlib
import html
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from string import Template

from savmap.files.atomic import write_text
from savmap.report.viewer.beside import joints_apart, remove_others, script_names, written_beside
from savmap.report.viewer.data import Entry, page_data
from savmap.types import Evaluation, Orthophoto, SiteMap, Still

POLICY = "default-src 'none'; script-src 'sha256-{script}' 'self' file:; style-src 'sha256-{style}'; img-src data: blob:; base-uri 'none'; form-action 'none'"
"""Scripts: the page's own, and the pictures' that lie beside it (`file:` is what some browsers call 'self' there)."""


@dataclass(frozen=True, eq=False)
class View:
    """What the viewer shows: a map, its scores where there is a survey, and by row its orthophoto and stills, where there are any; None for
    the stills that lie where the page is written."""

    site_map: SiteMap
    evaluation: Evaluation | None = None
    title: str = "Site map"
    photos: Mapping[str, Orthophoto] = field(default_factory=dict)
    stills: Mapping[str, Sequence[Still]] | None = None


def write_view(view: View, path: Path) -> None:
    """Write the page, and beside it the pictures that it loads when they are looked at. Raises OutputError."""
    apart, stills = joints_apart(view.site_map.rows), view.stills
    names = script_names(view.site_map.rows)
    beside = {
        name: written_beside(
            names[name],
            view.photos.get(name),
            None if stills is None else stills.get(name, ()),
            row.joint if apart else None,
            path.parent,
        )
        for name, row in view.site_map.rows.items()
    }
    write_text(path, page_text(view, beside))
    remove_others(beside.values(), path.parent, with_stills=stills is not None)


def page_text(view: View, beside: Mapping[str, Entry]) -> str:
    """The page. Texts of the map are in it packed, as base64: none of them can be taken for HTML or script."""
    style, script = _resource("viewer.css"), _resource("viewer.js")
    data = page_data(view.site_map, view.title, view.evaluation, beside)
    packed = gzip.compress(json.dumps(data, separators=(",", ":"), allow_nan=False).encode(), mtime=0)
    return Template(_resource("page.html")).substitute(
        policy=POLICY.format(script=_digest(script), style=_digest(style)),
        title=html.escape(view.title),
        style=style,
        script=script,
        data=base64.b64encode(packed).decode(),
    )


def _resource(name: str) -> str:
    return (files("savmap.report.viewer") / name).read_text(encoding="utf-8")


def _digest(text: str) -> str:
    return base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
