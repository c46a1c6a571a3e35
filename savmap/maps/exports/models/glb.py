"""A map as binary glTF 2.0 (https://registry.khronos.org/glTF/specs/2.0/glTF-2.0.html): metres, y up.

A node for each row stands at the row's origin, with a node for each structure below it, which stands in the structure's
middle. What is known of a structure beside its shape is in its node's `extras`.
"""

import json
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from savmap.files.atomic import write_bytes
from savmap.files.texts import json_visible
from savmap.maps.exports.marks import attributes, colours, linear, maker, sigmas
from savmap.maps.exports.models.bodies import Part, RowParts, depth_note, parts_of
from savmap.types import Floats, Ints, SiteMap

SCENE_FROM_WORLD = np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]])
"""glTF's axes: y up; z is what comes towards one."""
FLOAT, UNSIGNED_INT = 5126, 5125
CORNERS, NUMBERS = 34962, 34963
POINTS, LINES, TRIANGLES = 0, 1, 4
MAGIC, JSON_CHUNK, BINARY_CHUNK = 0x46546C67, 0x4E4F534A, 0x004E4942
Entry = dict[str, Any]


def write_glb(site: SiteMap, path: Path) -> None:
    """The map as one file. Raises OutputError where rows have no common frame."""
    write_bytes(path, glb_of(site))


def glb_of(site: SiteMap) -> bytes:
    """The file's bytes."""
    rows = parts_of(site)
    palette = colours(part.structure.label for row in rows for part in row.parts)
    binary = _Binary()
    nodes, meshes, tops = list[Entry](), list[Entry](), list[int]()
    for row in rows:
        tops.append(len(nodes))
        nodes.append(_row_node(site, row, len(nodes)))
        for part in row.parts:
            points = part.structure.vertices if part.body is None else part.body.points
            middle = (points.min(axis=0) + points.max(axis=0)) / 2 if len(points) else row.origin
            place = middle - row.origin
            mesh = _mesh(part, row.origin + place, list(palette).index(part.structure.label), binary)
            nodes.append(_part_node(part, place) | ({"mesh": len(meshes)} if mesh else {}))
            meshes += [mesh] if mesh else []
    content = {
        "asset": _filled({"version": "2.0", "generator": maker(), "extras": _filled({"note": depth_note(rows)})}),
        "scene": 0,
        "scenes": [_filled({"name": "map", "nodes": tops})],
        "nodes": nodes,
        "meshes": meshes,
        "materials": [_material(label, colour) for label, colour in palette.items()] if meshes else [],
        **binary.entries(),
    }
    text = json_visible(json.dumps(_filled(content), ensure_ascii=False, allow_nan=False, separators=(",", ":")))
    body = _chunk(JSON_CHUNK, text.encode(), b" ")
    if binary.accessors:
        body += _chunk(BINARY_CHUNK, bytes(binary.corners + binary.numbers), b"\0")
    return struct.pack("<III", MAGIC, 2, 12 + len(body)) + body


def _chunk(kind: int, content: bytes, filler: bytes) -> bytes:
    padded = content + filler * (-len(content) % 4)
    return struct.pack("<II", len(padded), kind) + padded


def in_scene(points: Floats) -> Floats:
    """Points (n, 3) of the world's frame with glTF's axes."""
    turned: Floats = points @ SCENE_FROM_WORLD.T
    return turned


class _Binary:
    """The binary part as it grows: accessors, and the bytes of corners and of numbers, each of which takes four."""

    def __init__(self) -> None:
        self.accessors = list[Entry]()
        self.corners, self.numbers = bytearray(), bytearray()

    def add_corners(self, points: Floats, bounds: bool) -> int:
        """The accessor's number of vectors (n, 3). `bounds`: whether it says how far they reach, as positions' must."""
        values = points.astype("<f4")
        reach = {"min": values.min(axis=0).tolist(), "max": values.max(axis=0).tolist()} if bounds else {}
        kind = {"componentType": FLOAT, "count": len(values), "type": "VEC3"}
        self.accessors.append({"bufferView": 0, "byteOffset": len(self.corners), **kind, **reach})
        self.corners += values.tobytes()
        return len(self.accessors) - 1

    def add_numbers(self, numbers: Ints) -> int:
        """The accessor's number of the numbers of corners."""
        values = numbers.astype("<u4").ravel()
        kind = {"componentType": UNSIGNED_INT, "count": len(values), "type": "SCALAR"}
        self.accessors.append({"bufferView": 1, "byteOffset": len(self.numbers), **kind})
        self.numbers += values.tobytes()
        return len(self.accessors) - 1

    def entries(self) -> Entry:
        """What the JSON part says of the binary one."""
        if not self.accessors:
            return {}
        first, second = len(self.corners), len(self.numbers)
        views = [{"buffer": 0, "byteOffset": 0, "byteLength": first, "byteStride": 12, "target": CORNERS}]
        if second:
            views.append({"buffer": 0, "byteOffset": first, "byteLength": second, "target": NUMBERS})
        return {"accessors": self.accessors, "bufferViews": views, "buffers": [{"byteLength": first + second}]}


def _mesh(part: Part, origin: Floats, material: int, binary: _Binary) -> Entry | None:
    """A structure's shape around its origin (3,) m in the world: its body, or its edges, or its vertices, if any."""
    structure = part.structure
    primitive: Entry
    if part.body is not None:
        points, normals, triangles = part.body.flat_faces()
        shape = {"POSITION": binary.add_corners(in_scene(points - origin), True)}
        shape |= {"NORMAL": binary.add_corners(in_scene(normals), False)}
        primitive = {"attributes": shape, "indices": binary.add_numbers(triangles), "mode": TRIANGLES}
    elif not len(structure.vertices):
        return None
    else:
        primitive = {"attributes": {"POSITION": binary.add_corners(in_scene(structure.vertices - origin), True)}}
        if len(structure.edges):
            primitive |= {"indices": binary.add_numbers(structure.edges), "mode": LINES}
        else:
            primitive |= {"mode": POINTS}
    return {"name": structure.id, "primitives": [primitive | {"material": material}]}


def _row_node(site: SiteMap, row: RowParts, number: int) -> Entry:
    verdict = site.rows[row.name].verdict
    extras = {"row": row.name} | ({"grade": verdict.grade} if verdict else {})
    children = list(range(number + 1, number + 1 + len(row.parts)))
    place = [float(value) for value in in_scene(row.origin)]
    return _filled({"name": row.name, "translation": place, "children": children, "extras": extras})


def _part_node(part: Part, place: Floats) -> Entry:
    """A structure's node at its place (3,) m from its row's origin."""
    structure = part.structure
    positions, spread = in_scene(structure.vertices), sigmas(structure) @ np.abs(SCENE_FROM_WORLD.T)
    vertices = [
        {"label": label, "position_m": position, "sigma_m": sigma}
        for label, position, sigma in zip(structure.vertex_labels, *map(_rounded, (positions, spread)), strict=True)
    ]
    extras = {
        "row": part.row,
        "plugin": part.plugin,
        "id": structure.id,
        "label": structure.label,
        "attributes": attributes(structure),
        "vertices": vertices,
        "ifc_class": part.ifc_class,
        "warnings": list(part.warnings),
    }
    assumed = {} if part.body is None else {"depth_assumed": part.assumed}
    translation = [float(value) for value in in_scene(place)]
    return {"name": structure.id, "translation": translation, "extras": _filled(extras) | assumed}


def _material(label: str, colour: str) -> Entry:
    surface = {"baseColorFactor": [*linear(colour), 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.8}
    return {"name": label, "pbrMetallicRoughness": surface}


def _rounded(values: Floats) -> list[list[float]]:
    """To a thousandth of a millimetre."""
    return [[round(value, 6) + 0.0 for value in line] for line in values.tolist()]


def _filled(entry: Mapping[str, Any]) -> Entry:
    """Without what is empty, which glTF does not allow."""
    return {name: value for name, value in entry.items() if value not in ([], {}, "")}
