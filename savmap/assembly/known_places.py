"""Places of a map that the user knows in their own world, and the equations that they give for where the site stands
there."""

import difflib
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from savmap.errors import SiteError
from savmap.files.validation import Location
from savmap.maps.exports.frames import Z_UP, in_site
from savmap.site.load import KnownAlignment
from savmap.site.sections import AlignLine, AlignPoint
from savmap.types import Floats, RowMap, SiteMap, Structure, array_record


@dataclass(frozen=True, eq=False)
@array_record
class MappedPlace:
    """A place of a row in the site's frame turned z up: position (3,) m, the covariance (3, 3) that the row's own map
    gives it, and its derivatives (3, 3) by the row's x m, z m and heading in degrees."""

    row: str
    at: str
    position: Floats
    covariance: Floats
    slopes: Floats


@dataclass(frozen=True, eq=False)
@array_record
class KnownPlace:
    """A mapped place, and where it is in the user's world: at `world` (2,), or, if there is a `normal` (2,), on the
    line through it at right angles to that. `height` is its z there, where it is known. Metres; `sigma` is that of each
    number. `location`: its key in the file."""

    place: MappedPlace
    world: Floats
    sigma: float
    location: Location
    normal: Floats | None = None
    height: float | None = None

    @property
    def name(self) -> str:
        """Row and place, for people."""
        return f"row {self.place.row}, {self.place.at}"

    @property
    def axes(self) -> Floats:
        """The directions (k, 2) of the world along which the place is known."""
        axes: Floats = np.eye(2) if self.normal is None else self.normal[None]
        return axes


@dataclass(frozen=True)
class KnownPlaces:
    """Known places; `directed`: numbers of the first and the last place of each line that has several, in its order;
    `left_out`: what is known of rows that were not mapped."""

    places: Sequence[KnownPlace]
    directed: Sequence[tuple[int, int]]
    left_out: Sequence[str]


def known_places(site: SiteMap, source: KnownAlignment) -> KnownPlaces:
    """The places that the section's points and lines name. Raises SiteError with file and line for one that is not in
    the map."""
    places: list[KnownPlace] = []
    directed: list[tuple[int, int]] = []
    left_out: list[str] = []

    def mapped(entry: AlignPoint | AlignLine, location: Location, names: Sequence[str]) -> list[MappedPlace]:
        row = _row_of(site, source, entry, location)
        if row is None:
            left_out.append(source.line(location, f"row {entry.row} was not mapped; it is aligned without it"))
            return []
        try:
            return [place_at(site, row, name) for name in names]
        except SiteError as error:
            raise SiteError(source.line(location, str(error))) from None

    for number, point in enumerate(source.section.points):
        at_point = mapped(point, ("points", number), (point.at,))
        height = point.world_m[2] if len(point.world_m) == 3 else None
        world = np.array(point.world_m[:2])
        places += [KnownPlace(place, world, point.sigma_m, ("points", number), height=height) for place in at_point]
    for number, line in enumerate(source.section.lines):
        along = mapped(line, ("lines", number), line.through)
        if len(along) > 1:
            directed.append((len(places), len(places) + len(along) - 1))
        first, second = np.array(line.world_m)
        x, y = (second - first) / np.linalg.norm(second - first)
        places += [KnownPlace(place, first, line.sigma_m, ("lines", number), np.array([-y, x])) for place in along]
    return KnownPlaces(places, directed, left_out)


def _row_of(site: SiteMap, source: KnownAlignment, entry: AlignPoint | AlignLine, location: Location) -> RowMap | None:
    """The row of an entry; None where that was not mapped."""
    rows = site.rows
    if entry.row is None and len(rows) + len(site.failed) == 1:
        return next(iter(rows.values()), None)
    if entry.row is not None and (entry.row in rows or entry.row in site.failed):
        return rows.get(entry.row)
    names = f"the map's rows are {', '.join(rows)}"
    what = f"there is no row `{entry.row}`" if entry.row is not None else "say which `row` it is in"
    raise SiteError(source.line(location, f"{what}; {names}"))


def place_at(site: SiteMap, row: RowMap, at: str) -> MappedPlace:
    """The place of a row that is called so: a vertex by its label, the mean of those whose labels begin so, or of a
    structure's. Raises SiteError where there is none, where there are several, or where the row has no place among
    others."""
    placement = site.placements.get(row.name)
    if placement is None and len(site.rows) > 1:
        raise SiteError(
            f"row {row.name} has no place in the site's frame, so that nothing in it tells where the site stands"
        )
    structure, chosen = _find(row, at)
    vertices = structure.vertices[chosen].mean(axis=0)[None]
    covariances = structure.covariances[chosen].mean(axis=0)[None]
    turn = Z_UP if placement is None else Z_UP @ placement.site_from_row[:3, :3]
    labels = structure.vertex_labels[:1]
    point = Structure(at, "", vertices, covariances, labels, np.zeros((0, 2), np.int64))
    position = Z_UP @ in_site(point, placement).vertices[0]
    slopes = np.zeros((3, 3)) if placement is None else Z_UP @ placement.slopes(vertices)[0]
    return MappedPlace(row.name, at, position, turn @ covariances[0] @ turn.T, slopes)


def _find(row: RowMap, at: str) -> tuple[Structure, list[int]]:
    """The structure and the numbers of its vertices that are meant: by the whole label first, then by the structure,
    then by how labels begin."""
    readings: tuple[Callable[[Structure, str], bool], ...] = (
        lambda part, label: at in (label, f"{part.id} / {label}"),
        lambda part, label: at == part.id,
        lambda part, label: label.startswith(f"{at} / "),
    )
    parts = [part for group in row.structures.values() for part in group]
    for is_meant in readings:
        chosen = [(part, [k for k, label in enumerate(part.vertex_labels) if is_meant(part, label)]) for part in parts]
        matches = [(part, numbers) for part, numbers in chosen if numbers]
        if len(matches) > 1:
            raise SiteError(f"there are {len(matches)} structures in row {row.name} that `{at}` may mean")
        if matches:
            return matches[0]
    beginnings = {label.rpartition(" / ")[0] for part in parts for label in part.vertex_labels} - {""}
    names = sorted({*beginnings, *(name for part in parts for name in (part.id, *part.vertex_labels))})
    near = difflib.get_close_matches(at, names, 3)
    raise SiteError(f"row {row.name} has no `{at}`" + (f"; nearest: {', '.join(near)}" if near else ""))
