"""A format for fleets of vehicles: a layout (VDMA LIF 1.0, Layout Interchange Format) of nodes and edges along what was
driven, a station at either end of each row, and one before each of its bays."""

import math
from pathlib import Path
from typing import Any

from savmap.errors import OutputError, visible
from savmap.files.atomic import write_text
from savmap.maps.exports.files import json_text, timestamp
from savmap.maps.exports.marks import remarks
from savmap.maps.exports.plans.routes import RouteGraph, Station, route_graph
from savmap.types import Floats, SiteMap

LIF_VERSION = "1.0.0"
VEHICLE = "any"
"""The one type of vehicle that is spoken of: a map does not know any other."""
MAP = "map"
DECIMALS = 4
ABOUT = "nodes and edges follow the path on which the camera was driven, metres and radians"


def write_lif(site: SiteMap, path: Path) -> None:
    """A layout of one level. Raises OutputError, also for a map without a camera's path."""
    graph = route_graph(site)
    if not graph.edges:
        raise OutputError("the map holds no camera path, so that nothing is known of where vehicles drive")
    layout = {
        "layoutId": "savmap",
        "layoutName": f"rows {', '.join(map(visible, site.rows))}",
        "layoutVersion": "1",
        "layoutDescription": "; ".join((ABOUT, *remarks(site.rows.values()))),
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
        "lifVersion": LIF_VERSION,
    }
    write_text(path, json_text({"metaInformation": about, "layouts": [layout]}))


def _node(graph: RouteGraph, number: int) -> dict[str, Any]:
    return {
        "nodeId": _node_id(number),
        "nodeName": graph.names[number],
        "mapId": MAP,
        "nodePosition": _position(graph.nodes[number]),
        "vehicleTypeNodeProperties": [{"vehicleTypeId": VEHICLE}],
    }


def _edge(graph: RouteGraph, start: int, end: int) -> dict[str, Any]:
    """Forwards, along the edge."""
    vehicle = {
        "vehicleTypeId": VEHICLE,
        "vehicleOrientation": 0.0,
        "orientationType": "TANGENTIAL",
        "rotationAllowed": False,
    }
    return {
        "edgeId": f"{_node_id(start)}-{_node_id(end)}",
        "startNodeId": _node_id(start),
        "endNodeId": _node_id(end),
        "vehicleTypeEdgeProperties": [vehicle],
    }


def _stop(graph: RouteGraph, station: Station, node: int) -> dict[str, Any]:
    """At a bay: on its face, towards which the vehicle is turned from the path."""
    heading = station.place - graph.nodes[node]
    return _station(station.name, station.title or station.name, node, station.place, heading)


def _end(graph: RouteGraph, row: str, side: str, node: int) -> dict[str, Any]:
    """At an end of a row, turned the way in which the first edge at its node leaves it: into the aisle."""
    other = next((b if a == node else a for a, b in graph.edges if node in (a, b)), node)
    name, title = f"{visible(row)} / {side} end", f"row {visible(row)}, {side} end as one faces it"
    return _station(name, title, node, graph.nodes[node], graph.nodes[other] - graph.nodes[node])


def _station(name: str, title: str, node: int, place: Floats, heading: Floats) -> dict[str, Any]:
    dx, dy = heading.tolist()
    return {
        "stationId": name,
        "interactionNodeIds": [_node_id(node)],
        "stationName": title,
        "stationPosition": {**_position(place), "theta": round(math.atan2(dy, dx), 6)},
    }


def _position(place: Floats) -> dict[str, float]:
    return {axis: round(value, DECIMALS) + 0.0 for axis, value in zip("xy", place.tolist(), strict=True)}


def _node_id(number: int) -> str:
    return f"n{number + 1}"
