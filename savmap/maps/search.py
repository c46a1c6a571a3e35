"""Things of a map by their name, or by what is written on them: where "A21-03" is."""

import difflib
from collections.abc import Iterator

import numpy as np

from savmap.errors import SiteError
from savmap.types import SiteMap, Structure

WRITTEN = ("text", "code")


def found(site: SiteMap, name: str) -> Iterator[str]:
    """A line for each structure whose id, text or code (with or without its kind) is `name`; upper and lower case do not count.

    Raises SiteError, with the nearest names, where there is none.
    """
    places = [
        (row, own) for row in site.rows for structures in site.rows[row].structures.values() for own in structures
    ]
    hits = [(row, own) for row, own in places if name.lower() in {one.lower() for one in names(own)}]
    if not hits:
        known = sorted({one for _, own in places for one in names(own)})
        near = difflib.get_close_matches(name, known, 3)
        raise SiteError(f"`{name}` is not in the map" + (f"; nearest: {', '.join(near)}" if near else ""))
    return (_line(site, row, own) for row, own in hits)


def names(own: Structure) -> list[str]:
    """What a structure may be asked for by."""
    written = [str(own.attributes[key]) for key in WRITTEN if own.attributes.get(key)]
    return [own.id, *written, *(one.partition(":")[2] for one in written if ":" in one)]


def _line(site: SiteMap, row: str, own: Structure) -> str:
    middle = own.vertices.mean(axis=0)
    sigma = np.sqrt(np.trace(own.covariances.mean(axis=0)) / 3)
    said = f' "{own.attributes["text"]}"' if own.attributes.get("text") else ""
    at = f", {own.attributes['bay']}" if own.attributes.get("bay") else ""
    line = f"row {row}, {own.id}{said}{at}: {_metres(middle)} m (+- {1000 * sigma:.0f} mm)"
    if row in site.placements:
        line += f"; in the site {_metres(site.placements[row].points(middle[None])[0])} m"
    return line


def _metres(point: np.ndarray) -> str:
    x, y, z = point
    return f"x {x:.3f}, y {y:.3f}, z {z:.3f}"
