"""Open-RMF: the building.yaml of rmf_traffic_editor, in metres (`cartesian_meters`, y up), with lanes along what was
driven and a wall along each solid that stands in the way."""

from pathlib import Path
from typing import Any

import numpy as np

from savmap.files.atomic import write_text
from savmap.files.yaml_text import dumped
from savmap.maps.exports.frames import elements
from savmap.maps.exports.hull import hull
from savmap.maps.exports.plans.footprints import depth_note, footprints, in_the_way
from savmap.maps.exports.plans.routes import route_graph
from savmap.types import Floats, SiteMap

LEVEL = "L1"
STRING, INTEGER, DOUBLE, BOOLEAN = 1, 2, 3, 4
"""How the format marks the type of a parameter."""
DECIMALS = 4
MARGIN_M = 1.0


def write_building(site: SiteMap, path: Path) -> None:
    """One level with vertices, lanes, walls and the floor beneath all of them. Raises OutputError."""
    floor_m = site.alignment.z_m if site.alignment else 0.0
    graph = route_graph(site)
    walls = in_the_way(footprints(elements(site)), floor_m)
    axes = np.array([wall.axis for wall in walls]).reshape(-1, 2)
    ground = _ground(np.vstack([graph.nodes, axes]))
    vertices = [
        *(_vertex(at, name) for at, name in zip(graph.nodes, graph.names, strict=True)),
        *(_vertex(at, "") for at in (*axes, *ground)),
    ]
    first_wall, first_corner = len(graph.nodes), len(graph.nodes) + len(axes)
    level = {
        "elevation": round(floor_m, DECIMALS) + 0.0,
        "flattened_x_offset": 0,
        "flattened_y_offset": 0,
        "layers": {},
        "vertices": vertices,
        "lanes": [[a, b, _lane()] for a, b in graph.edges],
        "walls": [[first_wall + 2 * k, first_wall + 2 * k + 1, _wall()] for k in range(len(walls))],
        "floors": [{"vertices": list(range(first_corner, len(vertices))), "parameters": _floor()}]
        if len(ground)
        else [],
        "measurements": [],
        "doors": [],
        "models": [],
        "fiducials": [],
    }
    building = {
        "name": "savmap",
        "coordinate_system": "cartesian_meters",
        "parameters": {},
        "graphs": {0: {"name": "driven"}},
        "levels": {LEVEL: level},
        "lifts": {},
        "crowd_sim": {"enable": 0},
    }
    text = dumped(building, flow=None, width=1000)
    note = depth_note(walls)
    write_text(path, (f"# {note}\n" if note else "") + text)


def _vertex(at: Floats, name: str) -> list[Any]:
    x, y = (np.round(at, DECIMALS) + 0.0).tolist()
    return [x, y, 0.0, name, {}]


def _lane() -> dict[str, list[Any]]:
    return {
        "bidirectional": [BOOLEAN, True],
        "graph_idx": [INTEGER, 0],
        "orientation": [STRING, ""],
    }


def _wall() -> dict[str, list[Any]]:
    return {"alpha": [DOUBLE, 1.0], "texture_name": [STRING, "default"]}


def _floor() -> dict[str, list[Any]]:
    return {"texture_name": [STRING, "default"], "texture_scale": [DOUBLE, 1.0], "texture_rotation": [DOUBLE, 0.0]}


def _ground(places: Floats) -> Floats:
    """The corners of the floor: around all places, with a margin."""
    if not len(places):
        return places
    square = MARGIN_M * np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]])
    return hull((places[:, None] + square).reshape(-1, 2))
