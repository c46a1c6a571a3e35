"""Nav2 (ROS 2): a keep-out mask, a route graph and vector objects, in one archive.

The mask is that of the keep-out filter (map_server: PGM and YAML), the graph that of the route server (GeoJSON in
metres), the objects are parameters of the vector object server.
"""

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from savmap.errors import OutputError
from savmap.files.yaml_text import dumped
from savmap.maps.exports.files import json_text, write_archive
from savmap.maps.exports.marks import commented, remarks
from savmap.maps.exports.plans.footprints import Footprint, depth_note, obstacles
from savmap.maps.exports.plans.geojson import feature
from savmap.maps.exports.plans.routes import RouteGraph, route_graph
from savmap.types import Floats, SiteMap

RESOLUTION_M = 0.05
MARGIN_M = 1.0
MOST_CELLS = 100_000_000
FREE, OCCUPIED = 254, 0
DECIMALS = 4
FRAME = "map"
CRS = "urn:ogc:def:crs:EPSG::3857"
"""What Nav2's own graphs say: metres of a plane, not of the Earth."""


def write_nav2(site: SiteMap, path: Path) -> None:
    """A .zip with keepout.pgm, keepout.yaml, route_graph.geojson and vector_objects.yaml. Raises OutputError, also for
    a site that is too large for a mask."""
    solids, graph = obstacles(site), route_graph(site)
    if not solids:
        raise OutputError("nothing in this map stands in the way: it has no solids near the floor")
    picture, about = keepout(solids, graph.nodes)
    said = remarks(site.rows.values())
    head = commented((*said, depth_note(solids)))
    write_archive(
        path,
        {
            "keepout.pgm": picture,
            "keepout.yaml": head + about,
            "route_graph.geojson": json_text(route_content(graph) | {"remarks": said}),
            "vector_objects.yaml": head + vector_objects(solids),
        },
    )


def keepout(solids: list[Footprint], driven: Floats) -> tuple[bytes, str]:
    """A PGM picture, black where any footprint touches a cell, of all footprints and of places driven (n, 2), and what
    map_server wants to know of it. Raises OutputError."""
    places = np.vstack([*(footprint.outline for footprint in solids), driven])
    origin = np.floor((places.min(axis=0) - MARGIN_M) / RESOLUTION_M) * RESOLUTION_M
    columns, rows = (int(n) for n in np.ceil((places.max(axis=0) + MARGIN_M - origin) / RESOLUTION_M))
    if columns * rows > MOST_CELLS:
        size = f"{columns * RESOLUTION_M:.0f} x {rows * RESOLUTION_M:.0f} m"
        raise OutputError(f"a site of {size} is too large for a mask with cells of {100 * RESOLUTION_M:.0f} cm")
    cells = np.full((rows, columns), FREE, np.uint8)
    for footprint in solids:
        _mark(cells, (footprint.outline - origin) / RESOLUTION_M)
    about = {
        "image": "keepout.pgm",
        "mode": "trinary",
        "resolution": RESOLUTION_M,
        "origin": [round(float(value), DECIMALS) + 0.0 for value in origin] + [0.0],
        "negate": 0,
        "occupied_thresh": 0.65,
        "free_thresh": 0.25,
    }
    head = f"P5\n{columns} {rows}\n255\n".encode()
    return head + np.ascontiguousarray(cells[::-1]).tobytes(), dumped(about)


def _mark(cells: npt.NDArray[np.uint8], outline: Floats) -> None:
    """Mark all cells that a convex outline (n, 2), in cells from the lower left corner, has a part of: in each row of
    cells those from where it reaches furthest left to where it reaches furthest right."""
    first = int(max(np.floor(outline[:, 1].min()), 0))
    last = int(min(np.ceil(outline[:, 1].max()), len(cells)))
    below = np.arange(first, max(last, first + 1))[:, None]
    (x, y), (dx, dy) = outline.T, (np.roll(outline, -1, axis=0) - outline).T
    low, high = np.minimum(y, y + dy), np.maximum(y, y + dy)
    crossing = np.clip(np.stack([below + 0 * low, below + 1 + 0 * low]), low, high)
    share = np.where(np.abs(dy) > 0, (crossing - y) / np.where(dy == 0, 1.0, dy), [[[0.0]], [[1.0]]])
    met = (low <= below + 1) & (high >= below)
    left = np.where(met, x + share * dx, np.inf).min(axis=(0, 2))
    right = np.where(met, x + share * dx, -np.inf).max(axis=(0, 2))
    for row, start, end in zip(below[:, 0].tolist(), np.floor(left).tolist(), np.ceil(right).tolist(), strict=True):
        cells[row, max(int(start), 0) : max(int(end), int(start) + 1)] = OCCUPIED


def route_content(graph: RouteGraph) -> dict[str, Any]:
    """The graph of Nav2's route server: ids of nodes, then of edges, all different; an edge for each way that it is
    driven."""
    nodes = np.round(graph.nodes, DECIMALS).tolist()
    features = [
        feature("Point", at, {"id": number, "frame": FRAME, "metadata": {"name": name, "row": row}})
        for number, (at, name, row) in enumerate(zip(nodes, graph.names, graph.rows, strict=True))
    ]
    ways = [way for a, b in graph.edges for way in ((a, b), (b, a))]
    features += [
        feature("MultiLineString", [[nodes[a], nodes[b]]], {"id": len(nodes) + number, "startid": a, "endid": b})
        for number, (a, b) in enumerate(ways)
    ]
    crs = {"type": "name", "properties": {"name": CRS}}
    return {"type": "FeatureCollection", "name": "graph", "crs": crs, "features": features}


def vector_objects(solids: list[Footprint]) -> str:
    """Parameters of the vector object server: a closed, filled polygon for each footprint. Their names are numbers,
    because names of parameters may hold letters, digits and underscores alone; the comments above say which is
    which."""
    shapes = {
        f"solid_{number}": {
            "type": "polygon",
            "frame_id": FRAME,
            "closed": True,
            "value": 100,
            "points": np.round(footprint.outline, DECIMALS).ravel().tolist(),
        }
        for number, footprint in enumerate(solids, start=1)
    }
    settings = {
        "map_topic": "vo_map",
        "global_frame_id": FRAME,
        "resolution": RESOLUTION_M,
        "default_value": -1,
        "overlay_type": 0,
        "update_frequency": 1.0,
        "transform_tolerance": 0.1,
        "shapes": list(shapes),
        **shapes,
    }
    names = "".join(
        f"# solid_{number}: {footprint.name}{', depth assumed' if footprint.assumed else ''}\n"
        for number, footprint in enumerate(solids, start=1)
    )
    text = dumped({"vector_object_server": {"ros__parameters": settings}}, flow=None)
    return names + text
