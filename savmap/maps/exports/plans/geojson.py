"""GeoJSON (RFC 7946): outlines of solids, lines of what has none, and the ways that were driven, in longitude and
latitude."""

from pathlib import Path
from typing import Any

import numpy as np

from savmap.errors import visible
from savmap.files.atomic import write_text
from savmap.maps.exports.frames import Element, elements
from savmap.maps.exports.json_text import json_text
from savmap.maps.exports.plans.footprints import Footprint, footprints
from savmap.maps.exports.plans.geodesy import Earth
from savmap.maps.exports.plans.routes import RouteGraph, route_graph
from savmap.types import SiteMap

LEAST_M = 0.001
DECIMALS = 4


def write_geojson(site: SiteMap, path: Path) -> None:
    """A collection of features. Raises OutputError, also for a site without an anchor."""
    earth = Earth(site)
    everything = elements(site)
    features = [
        *(_solid(earth, footprint) for footprint in footprints(everything)),
        *(_lines(earth, element) for element in everything if not (element.structure.solid or _empty(element))),
        *(_ways(earth, route_graph(site))),
    ]
    write_text(path, json_text({"type": "FeatureCollection", "features": features}))


def ring(earth: Earth, footprint: Footprint) -> list[list[float]]:
    """A closed outline, counter-clockwise."""
    corners = earth.positions(footprint.outline)
    return [*corners, corners[0]]


def _solid(earth: Earth, footprint: Footprint) -> dict[str, Any]:
    properties = {
        "name": footprint.name,
        "row": footprint.row,
        "plugin": footprint.plugin,
        "id": footprint.id,
        "label": footprint.label,
        "bottom_m": round(footprint.bottom_m, DECIMALS) + 0.0,
        "top_m": round(footprint.top_m, DECIMALS) + 0.0,
        "depth": "assumed" if footprint.assumed else "given",
    }
    return feature("Polygon", [ring(earth, footprint)], properties)


def _empty(element: Element) -> bool:
    return not len(element.structure.vertices)


def _lines(earth: Earth, element: Element) -> dict[str, Any]:
    """Edges of a structure that has no solid, as seen from above; a point where none is left."""
    structure = element.structure
    places, heights = structure.vertices[:, :2], structure.vertices[:, 2]
    properties = {
        "row": visible(element.row),
        "plugin": visible(element.plugin),
        "id": visible(structure.id),
        "label": visible(structure.label),
        "bottom_m": round(float(heights.min()), DECIMALS) + 0.0,
        "top_m": round(float(heights.max()), DECIMALS) + 0.0,
    }
    edges = [places[edge] for edge in structure.edges if np.linalg.norm(np.diff(places[edge], axis=0)) > LEAST_M]
    if not edges:
        return feature("Point", earth.positions(places.mean(axis=0)[None])[0], properties)
    return feature("MultiLineString", [earth.positions(edge) for edge in edges], properties)


def _ways(earth: Earth, graph: RouteGraph) -> list[dict[str, Any]]:
    if not graph.edges:
        return []
    nodes = earth.positions(graph.nodes)
    lines = [[nodes[a], nodes[b]] for a, b in graph.edges]
    return [feature("MultiLineString", lines, {"label": "driven"})]


def feature(kind: str, coordinates: Any, properties: dict[str, Any]) -> dict[str, Any]:
    """A feature of GeoJSON with a geometry of this kind."""
    return {"type": "Feature", "properties": properties, "geometry": {"type": kind, "coordinates": coordinates}}
