"""GLB: structures stand where they are, as an independent reader finds them, and say what is known of them."""

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

import savmap
from savmap.maps.exports.models.glb import glb_of
from savmap.types import Floats, SiteMap

from .made_up_models import (
    DEPTH_NOTE,
    EVIL,
    NEAREST_M,
    distance_m,
    expected,
    hostile_site,
    made_up_site,
    readable,
    row,
    things,
    warning_of,
)


def content_of(glb: bytes) -> dict[str, Any]:
    """The JSON part."""
    magic, version, length, size, kind = struct.unpack("<4sIII4s", glb[:20])
    assert (magic, version, length, kind) == (b"glTF", 2, len(glb), b"JSON")
    content: dict[str, Any] = json.loads(glb[20 : 20 + size])
    return content


def in_world(points: Floats) -> Floats:
    """Points of the scene, whose y axis points up, in the world's frame."""
    return points @ np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])


def test_positions_are_those_of_the_map(tmp_path: Path) -> None:
    path = savmap.export(made_up_site(), tmp_path / "map.glb")
    scene = trimesh.load(path)
    nodes = content_of(path.read_bytes())["nodes"]
    wanted = expected(made_up_site())
    found = dict[tuple[str, str], Floats]()
    for name in scene.graph.nodes_geometry:
        transform, mesh = scene.graph[name]
        points = scene.geometry[mesh].vertices @ transform[:3, :3].T + transform[:3, 3]
        key = min(wanted, key=lambda key: distance_m(wanted[key], in_world(points)))
        found[key] = in_world(points)
    assert set(found) == set(wanted)
    assert max(distance_m(found[key], wanted[key]) for key in wanted) < NEAREST_M
    named = {(node["extras"]["row"], node["name"]): node["extras"] for node in nodes if "plugin" in node["extras"]}
    assert set(named) == set(wanted)
    positions = np.array([vertex["position_m"] for vertex in named["B", "tube"]["vertices"]])
    assert distance_m(in_world(positions), wanted["B", "tube"]) < NEAREST_M


def test_each_object_has_its_origin_in_its_middle(tmp_path: Path) -> None:
    path = savmap.export(made_up_site(), tmp_path / "map.glb")
    content = content_of(path.read_bytes())
    for node in content["nodes"]:
        if "mesh" in node:
            shape = content["accessors"][content["meshes"][node["mesh"]]["primitives"][0]["attributes"]["POSITION"]]
            assert np.array(shape["min"]) == pytest.approx(-np.array(shape["max"]), abs=1e-6)
    rows = {node["name"]: node for node in content["nodes"] if "children" in node}
    spot = next(content["nodes"][k] for k in rows["B"]["children"] if content["nodes"][k]["name"] == "spot")
    place = np.array(rows["B"]["translation"]) + spot["translation"]
    assert in_world(place[None]) == pytest.approx(expected(made_up_site())["B", "spot"], abs=NEAREST_M)


def test_bodies_are_closed_and_look_outwards(tmp_path: Path) -> None:
    scene = trimesh.load(savmap.export(SiteMap({"A": row("A", things())}, {}), tmp_path / "map.glb"))
    volumes = {}
    for name, mesh in scene.geometry.items():
        if isinstance(mesh, trimesh.Trimesh):
            mesh.merge_vertices(merge_norm=True)
            assert mesh.is_watertight
            volumes[name] = float(mesh.volume)
    assert volumes["post 1"] == pytest.approx(0.1 * 5.0 * 1.1, rel=1e-5)
    assert volumes["corner"] == pytest.approx(1.5 * 0.4, rel=1e-5)
    assert set(volumes) == {"post 1", "post 2", "bar / 1", "plate", "corner"}


def test_nodes_say_what_is_known() -> None:
    content = content_of(glb_of(SiteMap({"A": row("A", things())}, {})))
    nodes = {node["name"]: node for node in content["nodes"]}
    assert nodes["A"]["extras"] == {"row": "A", "grade": "check"}
    extras = nodes["post 1"]["extras"]
    assert extras["attributes"] == {
        "width_m": 0.1,
        "width_m sigma": 0.005,
        "number": 7,
        "text": "text of post 1",
        "far": 10**12,
    }
    assert (extras["label"], extras["depth_assumed"], extras["ifc_class"]) == ("post", True, "IfcColumn")
    assert extras["warnings"] == [warning_of("post 1").line]
    assert nodes["post 2"]["extras"]["depth_assumed"] is False
    assert extras["vertices"][0]["sigma_m"] == [0.01, 0.02, 0.03]
    assert extras["vertices"][2] == {
        "label": "post 1 / 2",
        "position_m": [0.1, 5.0, 0.0],
        "sigma_m": [0.01, 0.02, 0.03],
    }
    assert [material["name"] for material in content["materials"]] == ["bar", "block", "plate", "post", "tube"]
    modes = [mesh["primitives"][0]["mode"] for mesh in content["meshes"]]
    assert modes == [4, 4, 4, 4, 4, 1, 0]


def test_any_text_is_kept_as_text() -> None:
    glb = glb_of(hostile_site())
    nodes = content_of(glb)["nodes"]
    assert nodes[0].get("name") == readable(EVIL[0])
    assert [node["extras"].get("id", "") for node in nodes[1:]] == [readable(text) for text in (*EVIL, EVIL[0])]
    assert b"\x1b" not in glb[: glb.index(b"BIN\0")]


def test_maps_without_structures_are_scenes_without_nodes() -> None:
    assert content_of(glb_of(SiteMap({}, {})))["scenes"] == [{"name": "map"}]


def test_depths_that_are_assumed_are_told() -> None:
    assert content_of(glb_of(made_up_site()))["asset"]["extras"] == {"note": DEPTH_NOTE}
    given = SiteMap({"A": row("A", things()[1:2])}, {})
    assert "extras" not in content_of(glb_of(given))["asset"]
