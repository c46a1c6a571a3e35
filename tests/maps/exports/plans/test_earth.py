"""GeoJSON: longitude and latitude by the anchor, read back by the formulas of the other direction."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_up_hall import ALIGNED, ANCHOR, hall

from savmap.errors import OutputError
from savmap.maps.exports.frames import elements
from savmap.maps.exports.plans.footprints import footprints
from savmap.maps.exports.plans.geojson import write_geojson
from savmap.types import Structure


def centred(longitude: float, latitude: float) -> np.ndarray:
    """A place (3,) m of the ellipsoid in the Earth's axes."""
    squared = 6.69437999014132e-3
    radius = 6378137.0 / np.sqrt(1 - squared * np.sin(latitude) ** 2)
    x, y = np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude)
    return radius * np.array([x, y, (1 - squared) * np.sin(latitude)])


def metres(position: list[float]) -> np.ndarray:
    """How far a place (2,) is to the east and to the north of the anchor, m."""
    latitude, longitude = np.radians(ANCHOR)
    step = centred(*np.radians(position)) - centred(longitude, latitude)
    east = np.array([-np.sin(longitude), np.cos(longitude), 0.0])
    up = np.array([np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)])
    return np.array([step @ east, step @ np.cross(up, east)])


def collection(text: str | bytes) -> dict[str, Any]:
    content: dict[str, Any] = json.loads(text)
    assert content["type"] == "FeatureCollection"
    return content


def turned_left(ring: list[list[float]]) -> bool:
    x, y = np.array(ring).T
    return float((x[:-1] * y[1:] - x[1:] * y[:-1]).sum()) > 0 and ring[0] == ring[-1]


def test_geojson_gives_solids_lines_and_ways_on_the_earth(tmp_path: Path) -> None:
    write_geojson(hall(), tmp_path / "a.geojson")
    features = collection((tmp_path / "a.geojson").read_text(encoding="utf-8"))["features"]
    kinds = [feature["geometry"]["type"] for feature in features]
    assert kinds == ["Polygon"] * 8 + ["MultiLineString"] * 3
    for feature, footprint in zip(features, footprints(elements(hall())), strict=False):
        (ring,) = feature["geometry"]["coordinates"]
        assert turned_left(ring)
        np.testing.assert_allclose([metres(position) for position in ring[:-1]], footprint.outline, atol=1e-4)
    assert features[0]["properties"]["depth"] == "assumed"
    assert (features[0]["properties"]["bottom_m"], features[0]["properties"]["top_m"]) == (0.5, 5.5)
    assert "\\n=cmd" in features[4]["properties"]["row"]


def test_structures_without_vertices_are_left_out(tmp_path: Path) -> None:
    nothing = Structure("nothing", "strip", np.zeros((0, 3)), np.zeros((0, 3, 3)), (), np.zeros((0, 2), np.int64))
    point = Structure("point", "strip", np.zeros((1, 3)), np.zeros((1, 3, 3)), ("a",), np.zeros((0, 2), np.int64))
    site = hall()
    row = replace(site.rows["A"], structures={"strips": (nothing, point)})
    write_geojson(replace(site, rows={"A": row}), tmp_path / "a.geojson")
    features = collection((tmp_path / "a.geojson").read_text(encoding="utf-8"))["features"]
    assert [feature["geometry"]["type"] for feature in features] == ["Point", "MultiLineString"]
    np.testing.assert_allclose(metres(features[0]["geometry"]["coordinates"]), [100.0, 50.0], atol=1e-4)


def test_positions_agree_with_another_library(tmp_path: Path) -> None:
    pyproj = pytest.importorskip("pyproj", reason="pyproj is no dependency")
    write_geojson(hall(), tmp_path / "a.geojson")
    features = collection((tmp_path / "a.geojson").read_text(encoding="utf-8"))["features"]
    definition = f"+proj=topocentric +ellps=WGS84 +lat_0={ANCHOR[0]} +lon_0={ANCHOR[1]} +h_0=0"
    local = pyproj.Transformer.from_pipeline(f"+proj=pipeline +step +proj=cart +ellps=WGS84 +step {definition}")
    for feature, footprint in zip(features, footprints(elements(hall())), strict=False):
        longitude, latitude = np.array(feature["geometry"]["coordinates"][0][:-1]).T
        east, north, _ = local.transform(longitude, latitude, np.zeros(len(longitude)))
        np.testing.assert_allclose(np.column_stack([east, north]), footprint.outline, atol=1e-4)


def test_without_an_anchor_it_is_refused(tmp_path: Path) -> None:
    for alignment in (None, replace(ALIGNED, anchor=None)):
        with pytest.raises(OutputError, match="give `align:` with an `anchor:`"):
            write_geojson(hall(alignment), tmp_path / "a")
    with pytest.raises(OutputError, match=r"is 5000 km from the `anchor:`"):
        write_geojson(hall(replace(ALIGNED, y_m=5e6)), tmp_path / "a")
    assert not (tmp_path / "a").exists()
