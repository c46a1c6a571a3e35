"""VDMA LIF 1.0 (Layout Interchange Format): nodes and edges along what was driven, a station at either end of each row,
and one before each of its bays."""

import math
from pathlib import Path
from typing import Any

from savmap.errors import OutputError, visible
from savmap.files.atomic import write_text
from savmap.maps.exports.json_text import json_text, timestamp
from savmap.maps.exports.plans.routes import RouteGraph, route_graph
from savmap.maps.exports.plans.stations import Station
from savmap.types import SiteMap

VERSION = "1.0.0"
VEHICLE = "any"
"""The one type of vehicle that is spoken of: a map does not know any other."""
MAP = "map"
DECIMALS = 4


def write_lif(site: SiteMap, path: Path) -> None:
    """A layout of one level. Raises OutputError, also for a map without a camera's path."""
    graph = route_graph(site)
    if not graph.edges:
        raise OutputError("the map holds no camera path, so that nothing is known of where vehicles drive")
    layout = {
        "layoutId": "savmap",
        "layoutName": f"rows {', '.join(map(visible, site.rows))}",
        "layoutVersion": "1",
        "layoutDescription": "Nodes and edges follow the path on which the camera was driven, metres and radians.",
        "nodes": [_node(graph, number) for number in range(len(graph.nodes))],
        "edges": [_edge(graph, *way) for a, b in graph.edges for way in ((a, b), (b, a))],
        "stations": [
            *(
                _end(graph, row, side, node)
                for row, ends in graph.ends.items()
                for side, node in zip(("left", "right"), ends, strict=True)
            ),
            *(_stop(graph, station, node) for station, node in graph.stops.values()),
        ],
    }
    about = {
        "projectIdentification": "savmap",
        "creator": f"savmap {visible(site.made_by.get('savmap', ''))}".strip(),
        "exportTimestamp": timestamp(),
        "lifVersion": VERSION,
    }
    write_text(path, json_text({"metaInformation": about, "layouts": [layout]}))


def _node(graph: RouteGraph, number: int) -> dict[str, Any]:
    return {
        "nodeId": _node_id(number),
        "nodeName": graph.names[number],
        "mapId": MAP,
        "nodePosition": _position(graph, number),
        "vehicleTypeNodeProperties": [{"vehicleTypeId": VEHICLE}],
    }


def _edge(graph: RouteGraph, start: int, end: int) -> dict[str, Any]:
    """Forwards, along the edge."""
    return {
        "edgeId": f"{_node_id(start)}-{_node_id(end)}",
        "startNodeId": _node_id(start),
        "endNodeId": _node_id(end),
        "vehicleTypeEdgeProperties": [
            {
                "vehicleTypeId": VEHICLE,
                "vehicleOrientation": 0.0,
                "orientationType": "TANGENTIAL",
                "rotationAllowed": False,
            }
        ],
    }


def _stop(graph: RouteGraph, station: Station, node: int) -> dict[str, Any]:
    """At a bay: on its face, looking at it from the path."""
    dx, dy = (station.place - graph.nodes[node]).tolist()
    x, y = station.place.tolist()
    return {
        "stationId": station.name,
        "interactionNodeIds": [_node_id(node)],
        "stationName": station.title or station.name,
        "stationPosition": {"x": _rounded(x), "y": _rounded(y), "theta": round(math.atan2(dy, dx), 6)},
    }


def _end(graph: RouteGraph, row: str, side: str, node: int) -> dict[str, Any]:
    """At an end of a row; it looks into the aisle."""
    return {
        "stationId": f"{visible(row)} / {side} end",
        "interactionNodeIds": [_node_id(node)],
        "stationName": f"row {visible(row)}, {side} end as one faces it",
        "stationPosition": {**_position(graph, node), "theta": round(_heading(graph, node), 6)},
    }


def _heading(graph: RouteGraph, node: int) -> float:
    """Which way the first edge at a node leaves it, radians."""
    other = next((b if a == node else a for a, b in graph.edges if node in (a, b)), node)
    dx, dy = (graph.nodes[other] - graph.nodes[node]).tolist()
    return math.atan2(dy, dx)


def _position(graph: RouteGraph, number: int) -> dict[str, float]:
    x, y = graph.nodes[number].tolist()
    return {"x": _rounded(x), "y": _rounded(y)}


def _rounded(value: float) -> float:
    return round(value, DECIMALS) + 0.0


def _node_id(number: int) -> str:
    return f"n{number + 1}"
