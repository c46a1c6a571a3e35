"""The contract, corners of masks, and a simulated aisle that is mapped with the length of a stripe as its only scale."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import savmap
from savmap.lab.sim.scene.files import load_scene
from savmap.lab.sim.simulate import simulate
from savmap.plugin import FrameTable, SiteMap, Structure, Trajectory, check_plugin
from savmap.plugin.manager import loaded_plugin
from savmap.types import RowMap
from savmap_stripes.plugin import Stripes, corners_of

SCENE = Path(__file__).parents[1] / "scene.yaml"
LENGTH = {"between": ["stripe corner 1", "stripe corner 2"], "axis": "x", "value": 2.0, "sigma": 0.002}
CAMERA_HEIGHT = {"camera_height_m": {"value": 1.9, "sigma": 0.02}}


def test_the_contract_holds() -> None:
    check_plugin(Stripes)


def test_corners_are_given_around_from_the_upper_left() -> None:
    mask = np.zeros((480, 640), np.bool_)
    mask[100:120, 200:400] = True
    np.testing.assert_allclose(
        corners_of(mask), [[199.5, 99.5], [399.5, 99.5], [399.5, 119.5], [199.5, 119.5]], atol=0.01
    )


def stripe(number: int, width_m: float) -> Structure:
    corners = np.array([[0.0, 0.0, 1.0], [2.0, 0.0, 1.0], [2.0, 0.0, 1.0 - width_m], [0.0, 0.0, 1.0 - width_m]])
    name = f"stripe {number}"
    return Structure(
        name, "stripe", corners, np.tile(1e-6 * np.eye(3), (4, 1, 1)), tuple("abcd"), np.zeros((0, 2), np.int64)
    )


def test_a_worn_stripe_is_told_in_an_inspection() -> None:
    plugin = loaded_plugin("stripes", Stripes, Stripes.Config())
    stripes = [stripe(1, 0.08), stripe(2, 0.03)]
    result = plugin.inspect(stripes, {}, None, plugin.limits({}, "test"), None, {}, None)
    assert [(finding.subjects, finding.grade) for finding in result.findings] == [
        (("stripe 1",), "green"),
        (("stripe 2",), "red"),
    ]
    given = plugin.limits({"width_m": {"amber": 0.02, "red": 0.01}}, "test")
    assert [finding.grade for finding in plugin.inspect(stripes, {}, None, given, None, {}, None).findings] == [
        "green",
        "green",
    ]


def test_it_is_inspected_with_what_other_plugins_mapped(installed: None) -> None:
    path = Trajectory(np.arange(1), np.eye(4)[None])
    row = RowMap(
        "A", FrameTable(np.zeros(1), ("pass 1",)), {}, path, {"shelves": (), "stripes": (stripe(1, 0.03),)}, ()
    )
    inspection = savmap.inspect(SiteMap({"A": row}, {}))
    assert [(placed[:2], placed[2].code) for placed in inspection.findings()] == [(("A", "stripes"), "narrow-stripe")]


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """The plugin's entry point, as pip would write it."""
    record = tmp_path_factory.mktemp("packages") / "savmap_stripes-0.1.0.dist-info"
    record.mkdir()
    points = "[savmap.plugins]\nstripes = savmap_stripes.plugin:Stripes\n"
    points += "[savmap.lab]\nstripes = savmap_stripes.lab:StripesLab\n"
    (record / "entry_points.txt").write_text(points, encoding="utf-8")
    (record / "METADATA").write_text("Name: savmap-stripes\nVersion: 0.1.0\n", encoding="utf-8")
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(record.parent))
        yield


@pytest.fixture(scope="module")
def aisle(installed: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Footage of the scene with its survey and its site file."""
    folder = tmp_path_factory.mktemp("stripes") / "simulated"
    simulate(load_scene(SCENE), folder)
    return folder


def mapped(aisle: Path, out: Path, references: dict[str, Any]) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """Mapped and surveyed corners (n, 4, 3) m, with nothing known but these references."""
    site = {
        "plugins": {"shelves": {}, "stripes": {}},
        "references": references,
        "rows": {"A": {"passes": [{"video": str(aisle / "footage.mp4"), "side": "left"}]}},
    }
    path = out / "site.yaml"
    path.write_text(json.dumps(site), encoding="utf-8")
    corners = [stripe.vertices for stripe in savmap.map_site(path).rows["A"].structures["stripes"]]
    survey = json.loads((aisle / "survey.json").read_text(encoding="utf-8"))["rows"]["A"]["stripes"]
    return np.array(corners), np.array(survey)


def test_stripes_are_mapped_beside_shelves(aisle: Path, tmp_path: Path) -> None:
    corners, survey = mapped(aisle, tmp_path, {**CAMERA_HEIGHT, "travel_m": 9.4})
    assert corners.shape == survey.shape == (3, 4, 3)
    assert np.linalg.norm(corners - survey, axis=-1).max() < 0.08


def test_a_stripes_length_is_the_only_scale(aisle: Path, tmp_path: Path) -> None:
    corners, survey = mapped(aisle, tmp_path, {"lengths": [LENGTH]})
    assert np.abs(np.diff(corners[:, :2, 0]) - 2.0).max() < 0.01
    assert np.linalg.norm(corners - survey, axis=-1).max() < 0.05
