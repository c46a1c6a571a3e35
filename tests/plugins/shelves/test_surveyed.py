"""Surveys out of tables and drawings: savmap's own exports come back without an error, and so do a surveyor's."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from perfect_maps import structures_of, surveyed_row

import savmap
from savmap.apps.exchange.imports.records import element
from savmap.cli.app import app
from savmap.errors import OutputError
from savmap.maps.exports.frames import world_from_row
from savmap.maps.map_file import read_map, write_map
from savmap.types import (
    Alignment,
    FrameTable,
    Placement,
    RowMap,
    SiteMap,
    Solid,
    Structure,
    Trajectory,
)
from savmap_shelves.report.evaluation import survey_entry

NEAREST_M = 1e-4


def thing(name: str, label: str, corners: Any, text: str = "") -> Structure:
    points = np.array(corners, dtype=np.float64)
    edges = np.array([[k, (k + 1) % len(points)] for k in range(len(points))] if len(points) > 2 else [[0, 1]])
    own = element(name, label, points, [f"{name} / {k}" for k in range(len(points))], {"text": text} if text else {})
    return replace(own, covariances=np.tile(1e-6 * np.eye(3), (len(points), 1, 1)), edges=edges)


def solid_of(own: Structure) -> Structure:
    depth = np.array([0.0, 0.0, -1.1 if own.label == "upright" else -0.05])
    return replace(own, solid=Solid(own.vertices[[0, 1, 3, 2]], depth, True, "IfcColumn"))


def mapped(name: str, tilt: float) -> RowMap:
    shelves = tuple(solid_of(own) for own in structures_of(surveyed_row()))
    tilted = [replace(own, vertices=own.vertices + own.vertices[:, :1] * [0, 0, tilt]) for own in shelves]
    lamps = tuple(thing(f"light {k}", "light", [[3.0 * k, 8.2, 1.2], [3.0 * k + 1.25, 8.21, 1.2]]) for k in range(1, 4))
    flat = [[1.0, 1.9, 0.01], [1.3, 1.9, 0.01], [1.3, 1.75, 0.01], [1.0, 1.75, 0.01]]
    across = [[5.0, 4.0, 1.5], [5.0, 4.0, 0.5], [5.0, 3.5, 0.5], [5.0, 3.5, 1.5]]
    plates = (thing("sign 1", "sign", flat, "A21-03"), thing("sign 2", "sign", across, "=AISLE; 4"))
    plates = tuple(
        replace(own, solid=Solid(own.vertices, np.array(way), True))
        for own, way in zip(plates, ([0, 0, -0.002], [-0.002, 0, 0]), strict=True)
    )
    parts = {"shelves": tuple(map(solid_of, tilted)), "lights": lamps, "signs": plates}
    path = Trajectory(np.zeros(0, np.int64), np.zeros((0, 4, 4)))
    return RowMap(name, FrameTable(np.zeros(0), ()), {}, path, parts, ())


@pytest.fixture
def site() -> SiteMap:
    places = {"A": Placement(2.0, -3.0, 30.0, np.eye(3)), "B": Placement(4.0, -7.0, 210.0, np.eye(3))}
    alignment = Alignment(4321.5, -8765.25, -75.0, np.eye(3), 12.5)
    return SiteMap({name: mapped(name, 1e-3) for name in places}, {}, placements=places, alignment=alignment)


def require_no_error(site: SiteMap, survey: Any) -> None:
    scores = savmap.evaluate(site, survey)
    assert set(scores.rows) == set(site.rows)
    for score in scores.rows.values():
        errors = np.concatenate([*score.errors.values(), *score.coordinates.values()])
        apart = np.concatenate([own.distances_m for own in score.distances.values()])
        assert len(errors) > 80
        assert len(apart) == 3 + 6 + 2
        assert np.abs(errors).max() < NEAREST_M
        assert apart.max() < NEAREST_M
        lost = [*score.missing.values(), *score.spurious.values()]
        assert not any([*lost, *(own.missing + own.spurious for own in score.distances.values())])


@pytest.mark.parametrize(
    "name",
    [
        "csv",
        pytest.param("dxf", marks=pytest.mark.extra("cad")),
        pytest.param("ifc", marks=pytest.mark.extra("bim")),
        pytest.param("ifc4x3", marks=pytest.mark.extra("bim")),
    ],
)
def test_own_exports_come_back_without_an_error(site: SiteMap, name: str, tmp_path: Path) -> None:
    path = savmap.export(site, tmp_path / f"map.{name.removesuffix('4x3')}", name)
    survey = savmap.import_survey(path, site).survey
    require_no_error(site, survey)
    table = savmap.import_survey(savmap.export(site, tmp_path / "map.csv"), site).survey
    assert [sign["text"] for sign in survey.rows["A"]["signs"]] == [sign["text"] for sign in table.rows["A"]["signs"]]
    for key in ("uprights", "lights"):
        assert str(survey.rows["B"][key]).count("[") == str(table.rows["B"][key]).count("[")


@pytest.mark.extra("bim")
def test_what_was_moved_in_an_own_model_stands_where_it_is_now(site: SiteMap, tmp_path: Path) -> None:
    import ifcopenshell

    path = savmap.export(site, tmp_path / "map.ifc")
    model = ifcopenshell.open(str(path))
    upright = next(element for element in model.by_type("IfcColumn") if element.Name == "upright 2")
    place = upright.ObjectPlacement.RelativePlacement.Location
    along = np.array([np.cos(np.deg2rad(-45)), np.sin(np.deg2rad(-45)), 0])
    place.Coordinates = (np.array(place.Coordinates) + 0.05 * along).tolist()
    model.write(str(path))
    moved = savmap.import_survey(path, site).survey.rows["A"]["uprights"]
    shift = np.array([[0], [0.05], [0], [0], [0]])
    assert np.array(moved) == pytest.approx(surveyed_row()["uprights"] + shift, abs=1e-3)


def test_a_survey_of_the_users_world_is_used(site: SiteMap, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    apart = replace(site, alignment=None)
    write_map(apart, tmp_path / "map.json")
    lines = ["Nr;Rechts;Hoch;Z;Element;Art"]
    for row in site.rows.values():
        for own in row.structures["shelves"]:
            world = world_from_row(site, row.name)
            for k, point in enumerate(own.vertices @ world[:3, :3].T + world[:3, 3]):
                code = "STIEL" if own.label == "upright" else "TRAVERSE"
                place = [f"{value:.4f}".replace(".", ",") for value in point]
                lines.append(";".join([str(k), *place, f"{row.name} {own.id}", code]))
    (tmp_path / "points.csv").write_text("\n".join(lines), encoding="cp1252")
    feet = [(name, at) for name in site.rows for at in ("upright 1 / left / bottom", "upright 5 / right / bottom")]
    known = []
    for name, at in feet:
        own = next(own for own in site.rows[name].structures["shelves"] if at in own.vertex_labels)
        world = world_from_row(site, name)
        x, y, _ = world[:3, :3] @ own.vertices[own.vertex_labels.index(at)] + world[:3, 3]
        known.append(f"  - {{row: {name}, at: {at}, world_m: [{x:.4f}, {y:.4f}]}}")
    known[0] = known[0].replace("]}", ", 12.5]}")
    (tmp_path / "align.yaml").write_text("points:\n" + "\n".join(known) + "\n")
    options = {
        "-o": tmp_path / "survey.json",
        "--map": tmp_path / "map.json",
        "--align": tmp_path / "align.yaml",
        "--columns": "x=Rechts,y=Hoch,vertex=Nr,label=6",
    }
    words = [str(word) for pair in options.items() for word in pair]
    labels = ["--layer", "Stiel=upright", "--layer", "TRAVERSE=beam"]
    app(["import", str(tmp_path / "points.csv"), *words, *labels], standalone_mode=False)
    said = capsys.readouterr().out
    assert "row A: 5 upright, 22 beam\nrow B: 5 upright, 22 beam\n" in said
    scores = savmap.evaluate(read_map(tmp_path / "map.json"), tmp_path / "survey.json")
    for score in scores.rows.values():
        assert max(float(np.abs(errors).max()) for errors in score.errors.values()) < 3e-4
        assert not any([*score.missing.values(), *score.spurious.values()])


@pytest.mark.extra("cad")
def test_an_elevation_drawing_is_a_survey(tmp_path: Path) -> None:
    import ezdxf

    document = ezdxf.new("R2010", units=4)
    surveyed = surveyed_row()
    for left, right in surveyed["uprights"]:
        ring = [(1000 * x, 1000 * y) for x, y in ((left, 0), (right, 0), (right, 6), (left, 6))]
        document.modelspace().add_lwpolyline(ring, close=True, dxfattribs={"layer": "POSTS"})
    for k, section in enumerate(surveyed["sections"]):
        left, right = surveyed["uprights"][k][1], surveyed["uprights"][k + 1][0]
        for low, high in section["beams"]:
            block = document.blocks.new(f"bar {k} {low}")
            block.add_solid(
                [
                    (0, 0),
                    (1000 * (right - left), 0),
                    (0, 1000 * (high - low)),
                    (1000 * (right - left), 1000 * (high - low)),
                ]
            )
            document.modelspace().add_blockref(block.name, (1000 * left, 1000 * low), dxfattribs={"layer": "Bars"})
    document.saveas(tmp_path / "rack.dxf")
    result = savmap.import_survey([tmp_path / "rack.dxf"], row="A", labels={"POSTS": "upright", "bars": "beam"})
    for key in ("uprights", "sections"):
        assert json.dumps(result.survey.rows["A"][key]) != ""
    assert np.array(result.survey.rows["A"]["uprights"]) == pytest.approx(np.array(surveyed["uprights"]))
    for ours, theirs in zip(result.survey.rows["A"]["sections"], surveyed["sections"], strict=True):
        assert np.array(ours["beams"]) == pytest.approx(np.array(theirs["beams"]))


@pytest.mark.parametrize(
    ("uprights", "message"),
    [
        ([[0.0, 0.1]], "needs the uprights at their sides: there are 1"),
        ([[0.0, 0.1], [3.0, 3.0]], "upright 2: has no width"),
        ([[0.0, 0.1], [0.05, 0.15]], "should lie beyond"),
    ],
)
def test_what_makes_no_survey_is_refused(uprights: list[list[float]], message: str) -> None:
    own = [
        element(f"upright {k}", "upright", np.array([[left, 0.0, 0.0], [right, 5, 0]]))
        for k, (left, right) in enumerate(uprights, start=1)
    ]
    with pytest.raises(OutputError, match=message):
        survey_entry(own)


def test_a_beam_beside_all_uprights_is_left_out() -> None:
    own = structures_of(surveyed_row())
    entry = survey_entry([one for one in own if one.id not in ("upright 1", "upright 2")])
    assert len(entry.values["uprights"]) == 3
    assert set(entry.left_out) == {one.id for one in own if one.label == "beam" and one.id[4] in "12"}


def test_a_survey_of_lamps_alone_scores_lamps_alone(site: SiteMap, tmp_path: Path) -> None:
    (tmp_path / "lamps.csv").write_text("id,label,x,y,z\n1,light,3,8.2,1.2\n1,light,4.25,8.21,1.2\n")
    alone = replace(site, rows={"A": site.rows["A"]})
    survey = savmap.import_survey(tmp_path / "lamps.csv", row="A").survey
    score = savmap.evaluate(alone, survey).rows["A"]
    assert (score.errors, score.missing) == ({}, {})
    assert score.distances["lights"].distances_m == pytest.approx([0.0], abs=1e-6)


def test_what_stands_behind_the_face_is_no_second_member() -> None:
    row = structures_of(surveyed_row())
    back = [replace(part, id=f"{part.id} back", vertices=part.vertices - np.array([0, 0, 1.1])) for part in row]
    opposite = np.array([0.03, 0, 2.9])
    across = [replace(part, id=f"{part.id} across", vertices=part.vertices + opposite) for part in row]
    entry = survey_entry([*back, *across, *row])
    assert entry.values == survey_entry(row).values
    assert set(entry.left_out) == {part.id for part in (*back, *across)}
