"""Where rows stand in the frame of a survey: by a map with its alignment, or by the place of each row's origin in the
user's world."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from savmap.errors import OutputError, SiteError
from savmap.maps.exports.frames import Z_UP, world_from_row
from savmap.maps.imports.records import Found, listed
from savmap.types import Alignment, Floats, SiteMap, Structure

NEAR_M = 2.0
"""What is further from all that was mapped of a row does not belong to it."""


@dataclass(frozen=True, eq=False)
class RowPlaces:
    """Where rows stand: in a map (`site`), and of those named in `given`, world_from_row (4, 4)."""

    site: SiteMap | None = None
    given: Mapping[str, Floats] = field(default_factory=dict)

    @property
    def known(self) -> bool:
        """Whether anything is known of the rows' places."""
        return self.site is not None or bool(self.given)

    @property
    def rows(self) -> list[str]:
        """The rows that are known of."""
        return list(dict.fromkeys((*self.given, *(self.site.rows if self.site else ()))))

    def row_from(self, frame: str, row: str) -> Floats:
        """Transform (4, 4) from a frame to a row's. Raises OutputError where the row's place in it is not known."""
        if frame == "row":
            return np.eye(4)
        if frame == "world" and row in self.given:
            return inverse(self.given[row])
        site = self.site
        if site is None or row not in site.rows:
            known = f"known are {listed(self.rows)}" if self.known else "say --map MAP"
            more = "" if frame == "site" else f", or --place '{listed([row])}=X,Y,HEADING'"
            raise OutputError(
                f"positions are in the {frame}'s frame, in which row {listed([row])} has no place: {known}{more}"
            )
        if row not in site.placements and (len(site.rows) > 1 or frame == "site"):
            raise OutputError(f"the map does not say where row {listed([row])} stands in the {frame}'s frame")
        return inverse(world_from_row(site, row) if frame == "world" else site.placements[row].site_from_row)


def inverse(transform: Floats) -> Floats:
    """A rigid transform (4, 4) the other way."""
    result = np.eye(4)
    turn = transform[:3, :3].T
    result[:3, :3], result[:3, 3] = turn, -turn @ transform[:3, 3]
    return result


def in_rows(found: Sequence[Found], places: RowPlaces, row: str | None) -> tuple[list[Found], list[str]]:
    """The elements in their rows' frames, and a note of those that belong to no row. `row`: that of what names none.
    Raises OutputError."""
    moved = [_in_row(one, places, row) for one in found]
    astray = [one.structure.id for one, there in zip(found, moved, strict=True) if there is None]
    notes = [f"further than {NEAR_M:g} m from every row, left out: {len(astray)} ({listed(astray)})"] if astray else []
    return [there for there in moved if there is not None], notes


def _in_row(one: Found, places: RowPlaces, row: str | None) -> Found | None:
    if one.row or row:
        return _moved(one, one.row or row or "", places)
    if len(places.rows) == 1:
        return _moved(one, places.rows[0], places)
    if one.frame == "row" or places.site is None or places.given:
        raise OutputError(f"nothing says of which row {listed([one.structure.id])} is: say it with --row ROW")
    return _nearest(one, places, places.site)


def _nearest(one: Found, places: RowPlaces, site: SiteMap) -> Found | None:
    """The element in the row whose mapped structures it is nearest to; None where none is near."""
    tried = [_moved(one, row, places) for row in site.rows if row in site.placements]
    if not tried:
        raise OutputError("the map does not say where its rows stand: say with --row of which row the survey is")
    apart = [_apart(own.structure, site, own.row) for own in tried]
    best = int(np.argmin(apart))
    return tried[best] if apart[best] <= NEAR_M else None


def _apart(structure: Structure, site: SiteMap, row: str) -> float:
    """How far the middle of a structure is from the box around what was mapped of a row, m."""
    mapped = [own.vertices for group in site.rows[row].structures.values() for own in group]
    if not mapped or not len(structure.vertices):
        return np.inf
    points, middle = np.concatenate(mapped), structure.vertices.mean(axis=0)
    beyond = np.maximum(np.maximum(points.min(axis=0) - middle, middle - points.max(axis=0)), 0.0)
    return float(np.linalg.norm(beyond))


def _moved(one: Found, row: str, places: RowPlaces) -> Found:
    transform = places.row_from(one.frame, row)
    vertices = one.structure.vertices @ transform[:3, :3].T + transform[:3, 3]
    return Found(row, "row", replace(one.structure, vertices=vertices))


def place_of(text: str) -> tuple[str, Floats]:
    """A row and world_from_row (4, 4) of "A=12.40,3.05,3.8": x and y of its origin in the world, m, and which way its x
    axis runs there, degrees counter-clockwise from the world's; a fourth number is the height of its floor. Raises
    SiteError."""
    row, _, numbers = text.rpartition("=")
    try:
        x, y, heading, *rest = [float(number) for number in numbers.split(",")]
        (z,) = rest or (0.0,)
        if not row or not np.isfinite([x, y, z, heading]).all():
            raise ValueError
    except ValueError:
        raise SiteError(
            f"--place {listed([text])}: should be ROW=X,Y,HEADING or ROW=X,Y,HEADING,Z, in metres and degrees"
        ) from None
    transform = np.eye(4)
    transform[:3, :3] = Z_UP
    return row, Alignment(x, y, heading, np.zeros((3, 3)), z).world_from_level @ transform
