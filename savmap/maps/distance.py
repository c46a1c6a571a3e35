"""The distance between two vertices of a map, with a standard deviation that knows what errors they share."""

import difflib
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from savmap.errors import SiteError
from savmap.maps.exports.frames import in_site
from savmap.types import Floats, SiteMap, Structure, array_record

NOT_JOINT = "errors that both share count twice, for this map does not say which they are"
PLACES = "the rows' places are taken for independent"


@dataclass(frozen=True, eq=False)
@array_record
class MapVertex:
    """One vertex of a map: its row, plugin, structure and number in it."""

    row: str
    plugin: str
    structure: Structure
    number: int

    @property
    def place(self) -> tuple[str, str, str, int]:
        """Row, plugin, structure's id and number."""
        return self.row, self.plugin, self.structure.id, self.number

    @property
    def name(self) -> str:
        """As in the viewer: "upright 1 / left / bottom", "light 1 / end 0"."""
        return self.structure.vertex_names[self.number]


@dataclass(frozen=True, eq=False)
@array_record
class VertexDistance:
    """From one vertex to another: `difference_m` (3,), in the row's frame or, for vertices of different rows, the
    site's, with its covariance (3, 3) m^2. `remark`: what it does not know, and which coordinates are assumed; empty
    where the errors that both share are left out of it and all was measured."""

    first: MapVertex
    second: MapVertex
    difference_m: Floats
    covariance: Floats
    remark: str = ""

    @property
    def length_m(self) -> float:
        return float(np.linalg.norm(self.difference_m))

    @property
    def sigma_m(self) -> float:
        """Standard deviation of the length, m; that of the longest axis where the length is zero."""
        length = self.length_m
        if length == 0:
            return float(np.sqrt(np.linalg.eigvalsh(self.covariance)[-1]))
        along = self.difference_m / length
        return float(np.sqrt(np.maximum(along @ self.covariance @ along, 0.0)))

    def __str__(self) -> str:
        sigmas = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        axes = ", ".join(
            f"{axis} {_metres(value, sigma)}"
            for axis, value, sigma in zip("xyz", self.difference_m, sigmas, strict=True)
        )
        return f"{_metres(self.length_m, self.sigma_m)} ({axes}){self.remark and '; '}{self.remark}"


def vertex_distance(site: SiteMap, first: str, second: str) -> VertexDistance:
    """From a vertex to another, each by its name ("upright 1 / right / bottom"), after its row or plugin and a colon
    where several have the same ("A: upright 1 / right / bottom"), or by its edge as site files call it ("upright 1 /
    right"). Raises SiteError for a name that no vertex has, or several have, and for rows without a common frame."""
    a, b = _vertex(site, first), _vertex(site, second)
    if a.row != b.row:
        return _between_rows(site, a, b)
    joint = site.rows[a.row].joint
    difference = b.structure.vertices[b.number] - a.structure.vertices[a.number]
    if a.place == b.place:
        return VertexDistance(a, b, difference, np.zeros((3, 3)))
    if joint is None:
        covariance = a.structure.covariances[a.number] + b.structure.covariances[b.number]
        return VertexDistance(a, b, difference, covariance, NOT_JOINT)
    start, end = ((vertex.plugin, vertex.structure, vertex.number) for vertex in (a, b))
    distance = VertexDistance(a, b, difference, joint.of_difference(start, end), _assumptions(site, a, b))
    hidden_m = np.linalg.norm(joint.moves(*end) - joint.moves(*start), axis=1).max(initial=0.0)
    if hidden_m <= distance.sigma_m:
        return distance
    said = f"not checked by a second reference: an error of {1000 * hidden_m:.0f} mm would stay hidden"
    return replace(distance, remark="; ".join(filter(None, (distance.remark, said))))


def _between_rows(site: SiteMap, a: MapVertex, b: MapVertex) -> VertexDistance:
    for end in (a, b):
        if end.row not in site.placements:
            raise SiteError(f"row {end.row} has no place in the site's frame: distances to other rows are not known")
    first, second = (in_site(end.structure, site.placements[end.row]) for end in (a, b))
    covariance = first.covariances[a.number] + second.covariances[b.number]
    remark = "; ".join(filter(None, (PLACES, _assumptions(site, a, b))))
    return VertexDistance(a, b, second.vertices[b.number] - first.vertices[a.number], covariance, remark)


def _assumptions(site: SiteMap, *ends: MapVertex) -> str:
    """Which coordinates of vertices nothing measured, in the axes of their rows, as far as the map knows what was
    solved for."""
    said = []
    for end in ends:
        assumed = end.structure.assumed(end.plugin, site.rows[end.row].joint)[end.number]
        sigmas = np.sqrt(np.diag(end.structure.covariances[end.number]))
        for axis in np.flatnonzero(assumed):
            sigma_mm = f"{1000 * sigmas[axis]:.0f}"
            said.append(f"{'xyz'[axis]} of `{end.name}` was not measured, it is assumed to +- {sigma_mm} mm")
    return "; ".join(said)


def _vertex(site: SiteMap, name: str) -> MapVertex:
    owner, _, wanted = (part.strip() for part in name.rpartition(":"))
    vertices = [
        MapVertex(mapped.name, plugin, structure, number)
        for mapped in site.rows.values()
        for plugin, structures in mapped.structures.items()
        if owner in ("", mapped.name, plugin, f"{mapped.name}: {plugin}")
        for structure in structures
        for number in range(len(structure.vertices))
    ]
    folded = wanted.lower()
    hits = [vertex for vertex in vertices if vertex.name.lower() == folded] or _first_of_edge(vertices, folded)
    if not hits:
        names = sorted({vertex.name for vertex in vertices})
        near = [name for name in names if f" / {folded} / " in f" / {name.lower()} / "][:8]
        near = near or difflib.get_close_matches(wanted, names, 3)
        raise SiteError(f"`{name}` is no vertex of the map" + (f"; nearest: {'; '.join(near)}" if near else ""))
    if len(hits) > 1:
        owners = {vertex.row: "row" for vertex in hits}
        owners = owners if len(owners) > 1 else {f"{vertex.row}: {vertex.plugin}": "plugin" for vertex in hits}
        first, kind = next(iter(owners.items()))
        what = f"is in {kind}s {', '.join(sorted(owners))}: put the {kind} before it, such as `{first}: {wanted}`"
        raise SiteError(f"`{name}` {what}")
    return hits[0]


def _first_of_edge(vertices: Iterable[MapVertex], name: str) -> list[MapVertex]:
    """The first vertex in each row of an edge, "upright 1 / left", as site files call it; none for the name of a whole
    structure, which has several edges."""
    parts = [
        vertex
        for vertex in vertices
        if vertex.structure.id.lower() != name
        and vertex.name.lower().startswith((f"{name} ", f"{name} /"))
        and name.startswith(vertex.structure.id.lower())
    ]
    return [*{vertex.row: vertex for vertex in reversed(parts)}.values()]


def _metres(value: float, sigma: float) -> str:
    return f"{value:.3f} m +- {1000 * sigma:.1f} mm"
