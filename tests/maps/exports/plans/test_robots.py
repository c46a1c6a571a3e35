"""Formats for robots and their fleets, read by others: PIL, PyYAML, JSON Schemas written from the published specifications."""

import json
import zipfile
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
import yaml
from made_up_hall import HOSTILE, PLACES, hall, plate, section, world
from PIL import Image

from savmap.apps.exchange.fleets import write_lif
from savmap.apps.exchange.nav2 import write_nav2
from savmap.errors import OutputError
from savmap.maps.exports.plans.footprints import obstacles
from savmap.maps.exports.plans.routes import route_graph
from savmap.types import Alignment, SiteMap, Structure

NUMBER, TEXT = {"type": "number"}, {"type": "string", "minLength": 1}


def record(*required: str, **properties: Any) -> dict[str, Any]:
    """The schema of an object with these keys, all of which are texts unless they are said."""
    return {"type": "object", "required": list(required), "properties": {**dict.fromkeys(required, TEXT), **properties}}


def several(items: dict[str, Any], least: int = 0) -> dict[str, Any]:
    return {"type": "array", "items": items, "minItems": least}


ANGLE = {"type": "number", "minimum": -np.pi, "maximum": np.pi}
POSITION = record("x", "y", x=NUMBER, y=NUMBER, theta=ANGLE)
EDGE = record(
    "vehicleTypeId",
    "rotationAllowed",
    rotationAllowed={"type": "boolean"},
    vehicleOrientation=ANGLE,
    orientationType={"enum": ["GLOBAL", "TANGENTIAL"]},
)
LAYOUT = record(
    *("layoutId", "layoutVersion", "nodes", "edges", "stations"),
    nodes=several(
        record(
            *("nodeId", "nodePosition", "vehicleTypeNodeProperties"),
            nodePosition=POSITION,
            vehicleTypeNodeProperties=several(record("vehicleTypeId"), 1),
        )
    ),
    edges=several(
        record(
            *("edgeId", "startNodeId", "endNodeId", "vehicleTypeEdgeProperties"),
            vehicleTypeEdgeProperties=several(EDGE, 1),
        )
    ),
    stations=several(
        record(*("stationId", "interactionNodeIds"), interactionNodeIds=several(TEXT, 1), stationPosition=POSITION)
    ),
)
LIF = record(
    *("metaInformation", "layouts"),
    metaInformation=record(
        *("projectIdentification", "creator", "exportTimestamp", "lifVersion"),
        exportTimestamp={"type": "string", "pattern": r"^\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d\dZ$"},
        lifVersion={"const": "1.0.0"},
    ),
    layouts=several(LAYOUT, 1),
)


def unzipped(path: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(path) as archive:
        assert archive.testzip() is None
        return {name: archive.read(name) for name in archive.namelist()}


def test_the_keep_out_mask_is_black_where_solids_stand(tmp_path: Path) -> None:
    write_nav2(hall(), tmp_path / "nav2.zip")
    files = unzipped(tmp_path / "nav2.zip")
    assert sorted(files) == ["keepout.pgm", "keepout.yaml", "route_graph.geojson", "vector_objects.yaml"]
    about = yaml.safe_load(files["keepout.yaml"])
    picture = np.array(Image.open(BytesIO(files["keepout.pgm"])))
    assert (about["image"], about["mode"], about["negate"], about["origin"][2]) == ("keepout.pgm", "trinary", 0, 0.0)

    def at(x: float, z: float) -> int:
        column, up = (world(x, z) - about["origin"][:2]) / about["resolution"]
        return int(picture[picture.shape[0] - 1 - int(up), int(column)])

    assert at(0.05, -0.5) == 0  # within a post of row A
    assert at(6.0, -0.02) == 0  # within its low bar
    assert at(6.0, 1.5) == 254  # in the aisle
    assert at(6.0, -0.5) == 254  # behind the bar
    assert at(12.0 - 0.05, 3.5) == 0  # the other row's first post
    shown = (254 - picture.astype(int)).sum() / 254 * about["resolution"] ** 2
    assert 2 * (2 * 0.1 + 11.8 * 0.05) < shown < 2 * (2 * 0.2 * 1.1 + 11.9 * 0.16)


def test_the_route_graph_has_ids_as_the_route_server_wants_them(tmp_path: Path) -> None:
    write_nav2(hall(), tmp_path / "nav2.zip")
    graph = json.loads(unzipped(tmp_path / "nav2.zip")["route_graph.geojson"])
    nodes = [f for f in graph["features"] if f["geometry"]["type"] == "Point"]
    edges = [f for f in graph["features"] if f["geometry"]["type"] == "MultiLineString"]
    ids = [feature["properties"]["id"] for feature in graph["features"]]
    assert len(set(ids)) == len(ids) == len(nodes) + len(edges)
    places = {node["properties"]["id"]: node["geometry"]["coordinates"] for node in nodes}
    ways = {(edge["properties"]["startid"], edge["properties"]["endid"]): edge for edge in edges}
    assert all((b, a) in ways for a, b in ways)
    for (a, b), edge in ways.items():
        assert edge["geometry"]["coordinates"] == [[places[a], places[b]]]
    np.testing.assert_allclose(list(places.values()), route_graph(hall()).nodes, atol=1e-4)
    assert "\u202e" not in unzipped(tmp_path / "nav2.zip")["route_graph.geojson"].decode()


def test_vector_objects_are_closed_polygons(tmp_path: Path) -> None:
    write_nav2(hall(), tmp_path / "nav2.zip")
    text = unzipped(tmp_path / "nav2.zip")["vector_objects.yaml"].decode()
    settings = yaml.safe_load(text)["vector_object_server"]["ros__parameters"]
    assert len(settings["shapes"]) == 6
    for name, outline in zip(settings["shapes"], (footprint.outline for footprint in obstacles(hall())), strict=True):
        shape = settings[name]
        assert (shape["type"], shape["closed"], shape["frame_id"]) == ("polygon", True, "map")
        np.testing.assert_allclose(np.reshape(shape["points"], (-1, 2)), outline, atol=1e-4)
    assert text.splitlines()[1] == "# solid_1: A / post 1, depth assumed"
    assert all(line.startswith("# solid_") for line in text.splitlines()[1:7])


def test_a_site_too_large_for_a_mask_is_refused(tmp_path: Path) -> None:
    far = Alignment(0.0, 0.0, 0.0, np.zeros((3, 3)))
    site = hall(far)
    places = {"A": PLACES["A"], HOSTILE: type(PLACES["A"])(5000.0, 5000.0, 0.0, np.zeros((3, 3)))}
    with pytest.raises(OutputError, match="too large for a mask with cells of 5 cm"):
        write_nav2(SiteMap(site.rows, {}, placements=places), tmp_path / "a.zip")


def test_lif_is_as_its_specification_says(tmp_path: Path) -> None:
    write_lif(hall(), tmp_path / "a.lif.json")
    content = json.loads((tmp_path / "a.lif.json").read_text(encoding="utf-8"))
    jsonschema.validate(content, LIF)
    (layout,) = content["layouts"]
    nodes = {node["nodeId"]: node["nodePosition"] for node in layout["nodes"]}
    assert len(nodes) == len(layout["nodes"])
    ways = {(edge["startNodeId"], edge["endNodeId"]) for edge in layout["edges"]}
    assert len({edge["edgeId"] for edge in layout["edges"]}) == len(layout["edges"]) == len(ways)
    assert all((b, a) in ways and {a, b} <= set(nodes) for a, b in ways)
    stations = {station["stationId"]: station for station in layout["stations"]}
    assert len(stations) == 4
    start = stations["A / left end"]
    np.testing.assert_allclose(list(nodes[start["interactionNodeIds"][0]].values()), world(-1.0, 1.5), atol=1e-4)
    assert start["stationPosition"]["theta"] == pytest.approx(np.radians(30.0), abs=1e-3)
    found = [[place["x"], place["y"]] for place in nodes.values()]
    np.testing.assert_allclose(found, route_graph(hall()).nodes, atol=1e-4)


def test_sections_are_stations_before_which_vehicles_stop(tmp_path: Path) -> None:
    site = hall()
    parts = (section(1, 2.0), section(2, 7.5), plate(2, "A-02\n"))
    first = replace(site.rows["A"], structures={"things": parts})
    write_lif(replace(site, rows={**site.rows, "A": first}), tmp_path / "a.lif.json")
    content = json.loads((tmp_path / "a.lif.json").read_text(encoding="utf-8"))
    jsonschema.validate(content, LIF)
    (layout,) = content["layouts"]
    stations = {station["stationId"]: station for station in layout["stations"]}
    second = stations["A / bay 2"]
    assert second["stationName"] == "A-02\\n"
    (node,) = [node for node in layout["nodes"] if [node["nodeId"]] == second["interactionNodeIds"]]
    assert node["nodeName"] == "A / bay 2"
    np.testing.assert_allclose(list(node["nodePosition"].values()), world(8.5, 1.5), atol=1e-4)
    place = second["stationPosition"]
    np.testing.assert_allclose([place["x"], place["y"]], world(8.5, 0.0), atol=1e-4)
    assert place["theta"] == pytest.approx(np.radians(120.0), abs=1e-5)
    assert len({node["nodeId"] for node in layout["nodes"]}) == len(layout["nodes"])


NOTE = "assumed depth, neither measured nor given: post 1 m, bar 0.05 m"


def with_depths_given(site: SiteMap) -> SiteMap:
    def given(one: Structure) -> Structure:
        return replace(one, solid=one.solid and replace(one.solid, assumed=False))

    rows = {
        name: replace(own, structures={key: tuple(map(given, group)) for key, group in own.structures.items()})
        for name, own in site.rows.items()
    }
    return replace(site, rows=rows)


def test_depths_that_are_assumed_are_told(tmp_path: Path) -> None:
    write_nav2(hall(), tmp_path / "a.zip")
    write_nav2(with_depths_given(hall()), tmp_path / "given.zip")
    files = unzipped(tmp_path / "a.zip")
    assert files["keepout.yaml"].startswith(f"# {NOTE}\nimage".encode())
    assert files["vector_objects.yaml"].startswith(f"# {NOTE}\n# solid_1".encode())
    assert not any(b"assumed" in text for text in unzipped(tmp_path / "given.zip").values())
