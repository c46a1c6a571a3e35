"""map.json: the same bytes each time, everything in it, and clear errors for what is no map."""

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from savmap.errors import OutputError
from savmap.maps.map_file import map_text, read_map, write_map
from savmap.maps.schema import schema_text
from savmap.types import (
    Alignment,
    AlignmentResidual,
    CrossRowMatch,
    FrameTable,
    JointCovariance,
    MapWarning,
    Measured,
    Placement,
    ReferenceUse,
    RowMap,
    SiteMap,
    Solid,
    Structure,
    Trajectory,
    Verdict,
    ViewSpec,
)

SCHEMA = Path(__file__).parents[2] / "docs" / "map.schema.json"


def site() -> SiteMap:
    rng = np.random.default_rng(5)
    root = rng.normal(size=(4, 3, 3)) * 1e-3
    thing = Structure(
        id="thing 1",
        label="thing",
        vertices=rng.normal(size=(4, 3)),
        covariances=root @ root.transpose(0, 2, 1),
        vertex_labels=("lower left", "lower right", "upper right", "[ 1 ]"),
        edges=np.array([[0, 1], [1, 2], [2, 3]]),
        attributes={"number": 1, "colour": "[ 2 ]", "size": np.float64(0.25), "height_m": Measured(1.2345, 0.002)},
        solid=Solid(rng.normal(size=(4, 3)), np.array([0.0, 0.0, -0.5]), assumed=True, ifc_class="IfcBeam"),
    )
    spread = rng.normal(size=(11, 4)) * 0.05
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[:, :3, :3] = Rotation.random(3, rng=rng).as_matrix()
    poses[:, :3, 3] = rng.normal(size=(3, 3))
    row = RowMap(
        name="A",
        frames=FrameTable(np.arange(5) / 15, ("there",) * 3 + ("back",) * 2),
        views={"face": ViewSpec("face", 91.25, -3.5, 0.125, 110.0), "up": ViewSpec("up", 0.0, 90.0)},
        trajectory=Trajectory(np.array([0, 1, 4]), poses, np.full((3, 3), 0.0123)),
        structures={"things": (thing,), "others": ()},
        references=(ReferenceUse("camera height", 3.055, 0.02, 3.0501),),
        report={"frames": 5, "rms_px": 0.41},
        joint=JointCovariance(
            {"things": {"thing 1": np.arange(-1, 11).reshape(4, 3)}}, spread @ spread.T, spread.T[:2]
        ),
    )
    placed = {"A": Placement(1.5, -2.25, 180.0, np.diag([1e-4, 1e-4, 0.01]))}
    lamp = CrossRowMatch(
        "A", "B", "thing 1", "thing 4", np.array([0.01, -0.002, np.nan]), np.array([0.02, 0.001, np.nan])
    )
    residual = AlignmentResidual("A", "a", np.array([0.01, -0.02, np.nan]), np.array([0.03, 0.02, np.nan]), 1.25, False)
    covariance = np.diag([1e-4, 4e-4, 0.01])
    aligned = Alignment(100.25, -3.5, 12.5, covariance, 0.125, (48.137, 11.575), (residual,), Measured(1.001, 0.0005))
    return SiteMap(
        {"A": row}, {"savmap": "0.1.0", "model things": "ab12"}, {"B": "no structure found"}, placed, (lamp,), aligned
    )


def test_what_is_written_is_read(tmp_path: Path) -> None:
    made = site()
    write_map(made, tmp_path / "map.json")
    found = read_map(tmp_path / "map.json")
    assert found.made_by == made.made_by
    before, after = made.rows["A"], found.rows["A"]
    assert (after.name, after.views) == ("A", before.views)
    assert (after.references, after.report) == (before.references, before.report)
    assert after.frames.passes == before.frames.passes
    assert after.trajectory.frames.tolist() == [0, 1, 4]
    np.testing.assert_allclose(after.frames.stamps_s, before.frames.stamps_s, atol=1e-6)
    np.testing.assert_allclose(after.trajectory.world_from_rig, before.trajectory.world_from_rig, atol=6e-6)
    np.testing.assert_allclose(after.trajectory.sigma_m, before.trajectory.sigma_m, atol=1e-6)
    assert set(after.structures) == {"things", "others"}
    mapped, read = before.structures["things"][0], after.structures["things"][0]
    assert (read.id, read.label, read.vertex_labels) == (mapped.id, mapped.label, mapped.vertex_labels)
    assert read.attributes == mapped.attributes
    np.testing.assert_array_equal(read.edges, mapped.edges)
    np.testing.assert_allclose(read.vertices, mapped.vertices, atol=5.001e-6)
    np.testing.assert_allclose(read.covariances, mapped.covariances, rtol=1e-5)
    assert before.joint is not None
    assert after.joint is not None
    assert after.joint.coordinates["things"]["thing 1"].tolist() == [[-1, 0, 1], [2, 3, 4], [5, 6, 7], [8, 9, 10]]
    np.testing.assert_allclose(after.joint.covariance, before.joint.covariance, rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(after.joint.hidden, before.joint.hidden, atol=5.001e-6)
    assert read.solid is not None
    assert mapped.solid is not None
    np.testing.assert_allclose(read.solid.outline, mapped.solid.outline, atol=5.001e-6)
    assert (read.solid.depth.tolist(), read.solid.assumed, read.solid.ifc_class) == ([0, 0, -0.5], True, "IfcBeam")
    assert found.alignment is not None
    assert (found.alignment.x_m, found.alignment.z_m, found.alignment.anchor) == (100.25, 0.125, (48.137, 11.575))
    (residual,) = found.alignment.residuals
    assert (residual.row, residual.at, residual.deviation, residual.used) == ("A", "a", 1.25, False)
    np.testing.assert_allclose(residual.residual_m, [0.01, -0.02, np.nan])
    assert found.alignment.scale == Measured(1.001, 0.0005)
    assert found.failed == made.failed
    np.testing.assert_allclose(found.placements["A"].site_from_row, made.placements["A"].site_from_row, atol=1e-6)
    np.testing.assert_allclose(found.matches[0].residual_m, made.matches[0].residual_m)


def test_a_row_stands_where_its_place_says() -> None:
    placed = Placement(10.0, 5.0, 90.0, np.zeros((3, 3)))
    along = placed.site_from_row @ [1.0, 2.0, 0.0, 1.0]
    out_of_the_face = placed.site_from_row @ [0.0, 0.0, 1.0, 1.0]
    np.testing.assert_allclose(along[:3], [10.0, 2.0, 4.0], atol=1e-12)
    np.testing.assert_allclose(out_of_the_face[:3], [11.0, 0.0, 5.0], atol=1e-12)


def test_bytes_are_the_same_each_time_and_after_reading(tmp_path: Path) -> None:
    text = map_text(site())
    assert text == map_text(site())
    write_map(site(), tmp_path / "map.json")
    write_map(read_map(tmp_path / "map.json"), tmp_path / "again.json")
    assert (tmp_path / "again.json").read_bytes() == (tmp_path / "map.json").read_bytes() == text.encode()


def test_tiny_differences_and_the_order_of_keys_leave_the_bytes_alone() -> None:
    made = site()
    row = made.rows["A"]
    poses = row.trajectory.world_from_rig.copy()
    poses[:, :3, 3] = np.round(poses[:, :3, 3], 5) + 1e-9
    nudged = replace(row, trajectory=replace(row.trajectory, world_from_rig=poses))
    turned = replace(nudged, structures=dict(reversed(nudged.structures.items())))
    assert map_text(replace(made, rows={"A": turned})) == map_text(made)


def test_every_vertex_has_its_label_and_deviation_and_frames_may_have_no_place() -> None:
    row = json.loads(map_text(site()))["rows"]["A"]
    entry = row["structures"]["things"][0]
    for vertex, label in zip(entry["vertices"], ("lower left", "lower right", "upper right", "[ 1 ]"), strict=True):
        assert vertex["label"] == label
        variances = [vertex["covariance_m2"][k] for k in (0, 3, 5)]
        np.testing.assert_allclose(vertex["sigma_m"], np.sqrt(variances), atol=1e-6)
    assert row["references"][0]["residual"] == pytest.approx(-0.0049)
    assert [frame["position_m"] is None for frame in row["trajectory"]] == [False, False, True, True, False]
    assert row["trajectory"][4]["pass"] == "back"


def test_references_say_how_they_were_used(tmp_path: Path) -> None:
    uses = (
        ReferenceUse("camera height", 3.055, 0.02, 3.05),
        ReferenceUse("height", 0.3, 0.002, 0.303, softened=0.05),
        ReferenceUse("length", 15.452, 0.003, 14.94, softened=0.51),
        ReferenceUse("mark", 1.0, 0.002, 1.2, left_out=True),
    )
    made = site()
    write_map(replace(made, rows={"A": replace(made.rows["A"], references=uses)}), tmp_path / "map.json")
    entries = json.loads((tmp_path / "map.json").read_text())["rows"]["A"]["references"]
    assert [(one["sigma"], one["sigma_used"], one["state"]) for one in entries] == [
        (0.02, 0.02, "used"),
        (0.002, 0.05, "softened"),
        (0.003, 0.51, "contradicted"),
        (0.002, None, "left out"),
    ]
    assert read_map(tmp_path / "map.json").rows["A"].references == uses


def test_a_warning_is_written_and_read(tmp_path: Path) -> None:
    where = ("row B",), "2 m off", (1.0, 2.0, 3.0), 4
    warning = MapWarning("site-misfit", *where, ("more", "yet"))
    made = site()
    write_map(replace(made, rows={"A": replace(made.rows["A"], verdict=Verdict((warning,)))}), tmp_path / "map.json")
    assert read_map(tmp_path / "map.json").rows["A"].verdict == Verdict((warning,))


def test_published_schema_is_up_to_date() -> None:
    assert SCHEMA.read_text() == schema_text(), "savmap schema map > docs/map.schema.json"


def test_map_satisfies_the_published_schema() -> None:
    import jsonschema

    validator = jsonschema.Draft202012Validator(json.loads(SCHEMA.read_text()))
    content = json.loads(map_text(site()))
    assert list(validator.iter_errors(content)) == []
    content["rows"]["A"]["colour"] = "red"
    assert len(list(validator.iter_errors(content))) == 1


def test_numbers_that_are_not_finite_are_not_written(tmp_path: Path) -> None:
    made = site()
    broken = replace(made, rows={"A": replace(made.rows["A"], report={"rms_px": float("nan")})})
    with pytest.raises(OutputError, match="not finite"):
        write_map(broken, tmp_path / "map.json")
    assert not (tmp_path / "map.json").exists()


def test_infinite_numbers_of_a_map_are_one_line(tmp_path: Path) -> None:
    path = tmp_path / "map.json"
    path.write_text(re.sub(r'"rms_px": [0-9.]+', '"rms_px": 1e999', map_text(site())))
    with pytest.raises(OutputError, match="is not JSON \\(1e999 is too large\\)"):
        read_map(path)


def test_a_reference_without_a_deviation_can_be_read_again(tmp_path: Path) -> None:
    made = site()
    sure = replace(made.rows["A"], references=(ReferenceUse("length", 1.0, 1e-9, 1.0),))
    write_map(replace(made, rows={"A": sure}), tmp_path / "map.json")
    assert read_map(tmp_path / "map.json").rows["A"].references[0].sigma == 1e-6


THING, POSE = "rows.A.structures.things.0", "rows.A.trajectory.1"


@pytest.mark.parametrize(
    ("place", "value", "message"),
    [
        ("rows", None, "`rows` is missing"),
        ("version", 7, "version 7; this program reads version 1"),
        ("format", "savmap-survey", "is a survey, not a map"),
        (f"{THING}.vertices.2.position_m.2", None, r"things\[0\]\.vertices\[2\]\.position_m\[2\]` is missing"),
        (f"{THING}.vertices", [], r"structures\.things\[0\]\.vertices`: at least 1 entry is expected"),
        (f"{THING}.edges.0", [0, 9], "thing 1: an edge joins a vertex that is not there"),
        (f"{POSE}.frame", 8, "frames should be numbered"),
        (f"{POSE}.orientation_xyzw", [0, 0, 0, 0], r"trajectory\[1\]\.orientation_xyzw`: it is no unit quaternion"),
        ("rows.A.references.0.sigma", 0, r"references\[0\]\.sigma`: input should be greater than 0"),
        (f"{THING}.vertices.0.covariance_m2.3", -1e-6, r"vertices\[0\]\.covariance_m2`: a variance is negative"),
        (f"{THING}.vertices.0.position_m.1", 1e300, r"position_m\[1\]`: input should be less .*lengths are metres"),
        ("rows.A.joint.covariance_m2", "AAAA", "joint`: covariance_m2 is not the finite upper triangle of 11 lines"),
        ("rows.A.joint.covariance_m2", "*", "joint`: covariance_m2 is not base64"),
        ("rows.A.joint.coordinates.things.thing 2", [[0, 0, 0]], "joint: things: thing 2 is none of the structures"),
        ("rows.A.joint.coordinates.things.thing 1.0.0", 11, "thing 1: a coordinate is not among the 11"),
        ("rows.A.views.face.width", 0, r"views\.face\.width`: input should be greater than or equal to 1 \(it is 0\)"),
        (f"{POSE}.pass_name", "a", r"unknown key `rows\.A\.trajectory\[1\]\.pass_name`: did you mean `pass`\?"),
    ],
)
def test_wrong_maps_are_one_line(tmp_path: Path, place: str, value: object, message: str) -> None:
    content = json.loads(map_text(site()))
    *keys, last = (int(key) if key.isdecimal() else key for key in place.split("."))
    entry: Any = content
    for key in keys:
        entry = entry[key]
    if value is None:
        del entry[last]
    else:
        entry[last] = value
    path = tmp_path / "map.json"
    path.write_text(json.dumps(content))
    with pytest.raises(OutputError, match=message) as caught:
        read_map(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)
