"""Structures of a map by their id, or by what is written on them: where "A21-03" is."""

import difflib
from dataclasses import dataclass

import numpy as np

from savmap.errors import SiteError
from savmap.types import Floats, SiteMap, Structure, array_record

WRITTEN = ("text", "code")
"""Attributes by which plugins give what is written on a structure; of "kind:content", the content counts too."""


@dataclass(frozen=True, eq=False)
@array_record
class SearchHit:
    """A structure of a row: the mean of its vertices (3,) m in the row's frame and, where the row is placed, in the site's; and the
    standard deviation of one coordinate, m."""

    row: str
    structure: Structure
    position_m: Floats
    sigma_m: float
    site_position_m: Floats | None = None

    def __str__(self) -> str:
        attributes = self.structure.attributes
        text = f' "{attributes["text"]}"' if attributes.get("text") else ""
        others = [
            f", {value}" for key, value in attributes.items() if isinstance(value, str) and value and key not in WRITTEN
        ]
        site = "" if self.site_position_m is None else f"; in the site {_metres(self.site_position_m)} m"
        what = f"row {self.row}, {self.structure.id}{text}{''.join(others)}"
        return f"{what}: {_metres(self.position_m)} m (+- {1000 * self.sigma_m:.0f} mm){site}"


def find_structures(site: SiteMap, name: str) -> list[SearchHit]:
    """The structures whose id, text or code is `name`, whatever its case. Raises SiteError, with the nearest names, if there are none."""
    structures = [
        (row.name, structure) for row in site.rows.values() for group in row.structures.values() for structure in group
    ]
    hits = [
        _hit(site, row, structure)
        for row, structure in structures
        if name.lower() in {key.lower() for key in names(structure)}
    ]
    if not hits:
        known = sorted({key for _, structure in structures for key in names(structure)})
        near = difflib.get_close_matches(name, known, 3)
        raise SiteError(f"`{name}` is not in the map" + (f"; nearest: {', '.join(near)}" if near else ""))
    return hits


def names(structure: Structure) -> list[str]:
    """The names by which a structure is found."""
    written = [str(structure.attributes[key]) for key in WRITTEN if structure.attributes.get(key)]
    return [structure.id, *written, *(text.partition(":")[2] for text in written if ":" in text)]


def _hit(site: SiteMap, row: str, structure: Structure) -> SearchHit:
    middle = structure.vertices.mean(axis=0)
    sigma = float(np.sqrt(np.trace(structure.covariances.mean(axis=0)) / 3))
    placement = site.placements.get(row)
    return SearchHit(row, structure, middle, sigma, None if placement is None else placement.points(middle[None])[0])


def _metres(point: Floats) -> str:
    x, y, z = point
    return f"x {x:.3f}, y {y:.3f}, z {z:.3f}"
