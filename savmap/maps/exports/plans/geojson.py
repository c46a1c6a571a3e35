"""GeoJSON (RFC 7946): outlines of solids, lines of what has none, and the ways that were driven, in longitude and
latitude."""

from pathlib import Path
from typing import Any

import numpy as np

from savmap.errors import OutputError, visible
from savmap.files.atomic import write_text
from savmap.maps.exports.files import json_text
from savmap.maps.exports.frames import Element, elements
from savmap.maps.exports.marks import remarks
from savmap.maps.exports.plans.footprints import Footprint, footprints
from savmap.maps.exports.plans.routes import route_graph
from savmap.types import Floats, SiteMap

LEAST_M = 0.001
DECIMALS = 4
SEMI_MAJOR_M, FLATTENING = 6_378_137.0, 1 / 298.257223563
ECCENTRICITY2 = FLATTENING * (2 - FLATTENING)
FARTHEST_M = 20_000.0
"""Further from the anchor, the plane is metres above the Earth: the anchor is then not that of the world's origin."""
DEGREE_DECIMALS = 9
"""0.1 mm."""
ROUNDS = 5


class Earth:
    """The Earth (WGS 84) at a site's anchor: the world's plane touches the ellipsoid there, x to the east, y to the
    north. Raises OutputError for a site without an anchor."""

    def __init__(self, site: SiteMap) -> None:
        if site.alignment is None or site.alignment.anchor is None:
            raise OutputError(
                "this format needs latitude and longitude: give `align:` with an `anchor:` in the site file, or to "
                "`savmap align`"
            )
        self.latitude, self.longitude = site.alignment.anchor

    def positions(self, places: Floats) -> list[list[float]]:
        """Longitude and latitude in degrees (n, 2), in GeoJSON's order, of places (n, 2) m of the world. Raises
        OutputError for places far from the anchor."""
        away = float(np.linalg.norm(places, axis=1).max(initial=0.0))
        if away > FARTHEST_M:
            raise OutputError(
                f"the site is {away / 1000:.0f} km from the `anchor:`, which is where the origin of your world is on "
                "the Earth"
            )
        turned = self._east_north_up() @ np.column_stack([places, np.zeros(len(places))]).T
        x, y, z = turned + _centred(np.radians(self.latitude), np.radians(self.longitude))[:, None]
        across = np.hypot(x, y)
        latitude = np.arctan2(z, across * (1 - ECCENTRICITY2))
        for _ in range(ROUNDS):  # converges to the last digit
            latitude = np.arctan2(z + ECCENTRICITY2 * _normal(latitude) * np.sin(latitude), across)
        degrees = np.degrees(np.column_stack([np.arctan2(y, x), latitude]))
        rounded: list[list[float]] = (np.round(degrees, DEGREE_DECIMALS) + 0.0).tolist()
        return rounded

    def _east_north_up(self) -> Floats:
        """Rotation (3, 3) from east, north, up at the anchor to the Earth's axes."""
        latitude, longitude = np.radians(self.latitude), np.radians(self.longitude)
        sin, cos = np.sin(latitude), np.cos(latitude)
        east = [-np.sin(longitude), np.cos(longitude), 0.0]
        north = [-sin * np.cos(longitude), -sin * np.sin(longitude), cos]
        up = [cos * np.cos(longitude), cos * np.sin(longitude), sin]
        return np.array([east, north, up]).T


def _normal(latitude: Floats | float) -> Floats:
    radius: Floats = SEMI_MAJOR_M / np.sqrt(1 - ECCENTRICITY2 * np.sin(latitude) ** 2)
    return radius


def _centred(latitude: float, longitude: float) -> Floats:
    """The place (3,) m of the ellipsoid in the Earth's axes."""
    radius = _normal(latitude)
    x, y = radius * np.cos(latitude) * np.cos(longitude), radius * np.cos(latitude) * np.sin(longitude)
    return np.array([x, y, radius * (1 - ECCENTRICITY2) * np.sin(latitude)])


def write_geojson(site: SiteMap, path: Path) -> None:
    """A collection of features. Raises OutputError, also for a site without an anchor."""
    earth = Earth(site)
    everything = elements(site)
    features = [_solid(earth, footprint) for footprint in footprints(everything)]
    features += [
        _lines(earth, element)
        for element in everything
        if not element.structure.solid and len(element.structure.vertices)
    ]
    graph = route_graph(site)
    if graph.edges:
        nodes = earth.positions(graph.nodes)
        ways = [[nodes[a], nodes[b]] for a, b in graph.edges]
        features.append(feature("MultiLineString", ways, {"label": "driven"}))
    content = {"type": "FeatureCollection", "remarks": remarks(site.rows.values()), "features": features}
    write_text(path, json_text(content))


def ring(earth: Earth, outline: Floats) -> list[list[float]]:
    """A closed outline of corners (n, 2) m of the world, counter-clockwise."""
    corners = earth.positions(outline)
    return [*corners, corners[0]]


def _solid(earth: Earth, footprint: Footprint) -> dict[str, Any]:
    names = {key: getattr(footprint, key) for key in ("name", "row", "plugin", "id", "label")}
    depth = {"depth": "assumed" if footprint.assumed else "given"}
    properties = {**names, **_heights(footprint.bottom_m, footprint.top_m), **depth}
    return feature("Polygon", [ring(earth, footprint.outline)], properties)


def _lines(earth: Earth, element: Element) -> dict[str, Any]:
    """Edges of a structure that has no solid, as seen from above; a point where none is left."""
    structure = element.structure
    places, heights = structure.vertices[:, :2], structure.vertices[:, 2]
    names = {"row": element.row, "plugin": element.plugin, "id": structure.id, "label": structure.label}
    properties = {key: visible(name) for key, name in names.items()}
    properties |= _heights(float(heights.min()), float(heights.max()))
    edges = [places[edge] for edge in structure.edges if np.linalg.norm(np.diff(places[edge], axis=0)) > LEAST_M]
    if not edges:
        return feature("Point", earth.positions(places.mean(axis=0)[None])[0], properties)
    return feature("MultiLineString", [earth.positions(edge) for edge in edges], properties)


def _heights(bottom_m: float, top_m: float) -> dict[str, Any]:
    return {"bottom_m": round(bottom_m, DECIMALS) + 0.0, "top_m": round(top_m, DECIMALS) + 0.0}


def feature(kind: str, coordinates: Any, properties: dict[str, Any]) -> dict[str, Any]:
    """A feature of GeoJSON with a geometry of this kind."""
    return {"type": "Feature", "properties": properties, "geometry": {"type": kind, "coordinates": coordinates}}
