"""Open-RMF: the building.yaml of rmf_traffic_editor, in metres (`cartesian_meters`, y up), with lanes along what was
driven and a wall along each solid that stands in the way."""

from copy import deepcopy
from pathlib import Path

import numpy as np

from savmap.files.atomic import write_text
from savmap.files.yaml_text import dumped
from savmap.maps.exports.hull import hull
from savmap.maps.exports.marks import commented, remarks
from savmap.maps.exports.plans.footprints import depth_note, obstacles
from savmap.maps.exports.plans.routes import route_graph
from savmap.types import SiteMap

LEVEL = "L1"
STRING, INTEGER, DOUBLE, BOOLEAN = 1, 2, 3, 4
"""How the format marks the type of a parameter."""
DECIMALS = 4
MARGIN_M = 1.0


def write_building(site: SiteMap, path: Path) -> None:
    """One level with vertices, lanes, walls and the floor beneath all of them. Raises OutputError."""
    graph, walls = route_graph(site), obstacles(site)
    axes = np.array([wall.axis for wall in walls]).reshape(-1, 2)
    places = np.vstack([graph.nodes, axes])
    ground = hull(places, MARGIN_M) if len(places) else places
    named = zip(np.vstack([places, ground]), (*graph.names, *[""] * (len(axes) + len(ground))), strict=True)
    vertices = [[*(np.round(at, DECIMALS) + 0.0).tolist(), 0.0, name, {}] for at, name in named]
    first_wall, first_corner = len(graph.nodes), len(places)
    lane = {"bidirectional": [BOOLEAN, True], "graph_idx": [INTEGER, 0], "orientation": [STRING, ""]}
    wall = {"alpha": [DOUBLE, 1.0], "texture_name": [STRING, "default"]}
    floor = {
        "vertices": list(range(first_corner, len(vertices))),
        "parameters": {
            "texture_name": [STRING, "default"],
            "texture_scale": [DOUBLE, 1.0],
            "texture_rotation": [DOUBLE, 0.0],
        },
    }
    level = {
        "elevation": round(site.alignment.z_m, DECIMALS) + 0.0 if site.alignment else 0.0,
        "flattened_x_offset": 0,
        "flattened_y_offset": 0,
        "layers": {},
        "vertices": vertices,
        "lanes": [[a, b, deepcopy(lane)] for a, b in graph.edges],
        "walls": [[first_wall + 2 * k, first_wall + 2 * k + 1, deepcopy(wall)] for k in range(len(walls))],
        "floors": [floor] if len(ground) else [],
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
    head = commented((*remarks(site.rows.values()), depth_note(walls)))
    write_text(path, head + dumped(building, flow=None, width=1000))
