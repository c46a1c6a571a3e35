"""What is free along an aisle: the narrowest place between faces that look at each other, and the lowest of what is
over the aisle."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from savmap.apps.exchange.imports.survey import inverse
from savmap.maps.exports.frames import in_site, transformed
from savmap.plugin.inspection import Limit
from savmap.site.limits import EnvelopeLimits
from savmap.types import (
    Bools,
    Finding,
    FindingTable,
    Floats,
    Measured,
    Placement,
    RowInspection,
    RowMap,
    SiteMap,
    Structure,
)
from savmap.types.inspection import Cell

AISLE = "aisle"
"""Takes the place of a plugin's name."""
OVER_AISLE_M, OVERHEAD_M = 0.3, 1.8
"""What is further from the face and higher than this is over the aisle."""
WIDEST_M, NEAR_M = 12.0, 1.0
"""Faces further from each other have no aisle in common; what of a face is nearer along the row than this stands
opposite."""
OPPOSITE = -0.9
"""Of the faces' normals: their product, from where on they look at each other."""


@dataclass(frozen=True, eq=False)
class Vertices:
    """All measured vertices of a row in its frame: structures' ids (n), positions (n, 3) m, covariances (n, 3, 3) m^2;
    with the errors of the row's place, where it has one."""

    ids: tuple[str, ...]
    points: Floats
    covariances: Floats

    def where(self, chosen: Bools) -> "Vertices":
        """Those that are chosen (n)."""
        ids = tuple(name for name, keep in zip(self.ids, chosen, strict=True) if keep)
        return Vertices(ids, self.points[chosen], self.covariances[chosen])


@dataclass(frozen=True, eq=False)
class Narrowest:
    """The narrowest place between a row and the one across the aisle: its width, the ids of what stands there in either
    row, and the place (3,) m in the row's frame."""

    across: str
    width: Measured
    subjects: tuple[str, str]
    place: Floats


@dataclass(frozen=True, eq=False)
class Lowest:
    """The lowest vertex over an aisle: its structure's id, its height above the floor, its place (3,) m in the row's
    frame."""

    id: str
    height: Measured
    place: Floats


def aisle_inspections(site_map: SiteMap, limits: EnvelopeLimits) -> dict[str, RowInspection]:
    """For each row what is free in front of it; the width is told of the first of two rows."""
    return {row.name: _row_inspection(site_map, row, limits) for row in site_map.rows.values()}


def _row_inspection(site_map: SiteMap, row: RowMap, limits: EnvelopeLimits) -> RowInspection:
    narrowest, lowest = narrowest_of(site_map, row, limits.height_m), lowest_of(row)
    unchecked = [] if narrowest else ["the width of the aisle: no row across it is mapped and placed"]
    unchecked += [] if limits.width_m or limits.height_m else ["whether a truck passes: the limits have no `envelope`"]
    names, findings, lines = list(site_map.rows), list[Finding](), list[tuple[Cell, ...]]()

    def check(code: str, title: str, key: str, size: Measured, place: Floats, *subjects: str) -> None:
        limit_m = getattr(limits, key)
        if limit_m is not None:
            limit = Limit(amber=limit_m + limits.margin_m, red=limit_m, source=limits.source)
            finding = Finding(
                code,
                title,
                subjects=subjects,
                unit="m",
                action="measure it by hand",
                place=tuple(place.tolist()),
                limit_key=key,
            )
            findings.append(limit.finding(finding, size))

    if narrowest is not None and names.index(narrowest.across) > names.index(row.name):
        size, place = narrowest.width, narrowest.place
        lines.append((f"row {narrowest.across}", float(place[0]), size.value, size.sigma))
        title = f"aisle to row {narrowest.across} at {place[0]:.2f} m: free width"
        check("narrow-aisle", title, "width_m", size, place, *narrowest.subjects)
    if lowest is not None:
        lines.append((f"{lowest.id}, above", float(lowest.place[0]), lowest.height.value, lowest.height.sigma))
        title = f"{lowest.id} over the aisle: free height"
        check("low-overhead", title, "height_m", lowest.height, lowest.place, lowest.id)
    table = FindingTable("clearance", "What is free along the aisle", COLUMNS, tuple(lines))
    applied = ("margin_m",) if findings else ()
    return RowInspection(tuple(findings), (table,) if lines else (), (), tuple(unchecked), applied)


COLUMNS = ("to", "at_m", "free_m", "sigma_m")


def narrowest_of(site_map: SiteMap, row: RowMap, height_m: float | None) -> Narrowest | None:
    """The narrowest place to the nearest row across the aisle, of what is lower than a height (None: of all); None
    where there is no such row."""
    others = [other for other in site_map.rows.values() if other is not row]
    candidates = [_narrowest_between(site_map, row, other, height_m) for other in others]
    return min((place for place in candidates if place is not None), key=lambda place: place.width.value, default=None)


def _narrowest_between(site_map: SiteMap, row: RowMap, other: RowMap, height_m: float | None) -> Narrowest | None:
    placements = site_map.placements
    if row.name not in placements or other.name not in placements:
        return None
    row_from_other = inverse(placements[row.name].site_from_row) @ placements[other.name].site_from_row
    if row_from_other[2, 2] > OPPOSITE:
        return None
    mine, theirs = (
        _standing(vertices, height_m)
        for vertices in (_placed(row, placements[row.name]), _placed(other, placements[other.name]))
    )
    turn = row_from_other[:3, :3]
    theirs = replace(
        theirs, points=transformed(theirs.points, row_from_other), covariances=turn @ theirs.covariances @ turn.T
    )
    return _nearest(other.name, mine, theirs)


def _standing(vertices: Vertices, height_m: float | None) -> Vertices:
    """What stands at a row's own face, up to a height."""
    highest = np.inf if height_m is None else height_m
    return vertices.where((vertices.points[:, 1] <= highest) & (vertices.points[:, 2] < OVER_AISLE_M))


def _nearest(across: str, mine: Vertices, theirs: Vertices) -> Narrowest | None:
    """Of pairs that stand opposite each other the nearest along the faces' normal."""
    if not mine.ids or not theirs.ids:
        return None
    along = np.abs(mine.points[:, None, 0] - theirs.points[None, :, 0])
    gaps = np.where(along <= NEAR_M, theirs.points[None, :, 2] - mine.points[:, None, 2], np.inf)
    i, j = np.unravel_index(int(gaps.argmin()), gaps.shape)
    if not 0 < gaps[i, j] < WIDEST_M:
        return None
    variance = mine.covariances[i, 2, 2] + theirs.covariances[j, 2, 2]
    width = Measured(float(gaps[i, j]), float(np.sqrt(max(variance, 0.0))))
    return Narrowest(across, width, (mine.ids[i], theirs.ids[j]), (mine.points[i] + theirs.points[j]) / 2)


def _placed(row: RowMap, placement: Placement) -> Vertices:
    """A row's vertices in its frame, with the covariances that they have in the site's."""
    turn = placement.site_from_row[:3, :3]
    parts = [part for group in row.structures.values() for part in group]
    covariances = [turn.T @ in_site(part, placement).covariances @ turn for part in parts]
    return _joined([replace(part, covariances=errors) for part, errors in zip(parts, covariances, strict=True)])


def lowest_of(row: RowMap) -> Lowest | None:
    """The lowest of what is over the aisle in front of a row, of vertices whose height was measured."""
    groups = [(plugin, part) for plugin, group in row.structures.items() for part in group]
    vertices = _joined([part for _, part in groups])
    assumed = np.array([flag for plugin, part in groups for flag in part.assumed(plugin, row.joint)[:, 1]], bool)
    over = (vertices.points[:, 2] > OVER_AISLE_M) & (vertices.points[:, 1] > OVERHEAD_M)
    vertices = vertices.where(over & ~assumed)
    if not vertices.ids:
        return None
    k = int(vertices.points[:, 1].argmin())
    sigma = float(np.sqrt(max(vertices.covariances[k, 1, 1], 0.0)))
    return Lowest(vertices.ids[k], Measured(float(vertices.points[k, 1]), sigma), vertices.points[k])


def _joined(parts: Sequence[Structure]) -> Vertices:
    """The vertices of all structures."""
    ids = tuple(part.id for part in parts for _ in part.vertex_labels)
    points = np.concatenate([np.zeros((0, 3)), *(part.vertices for part in parts)])
    return Vertices(ids, points, np.concatenate([np.zeros((0, 3, 3)), *(part.covariances for part in parts)]))
