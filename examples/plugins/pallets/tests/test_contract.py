"""The contract that any plugin must keep, the door it comes in by, and the network that it ships."""

import tomllib
from importlib.metadata import entry_points
from pathlib import Path

import numpy as np
import pytest

from savmap.lab.scenes import RowFrame, Site
from savmap.lab.sim.random_scene import furnished
from savmap.lab.sim.scene.files import load_scene
from savmap.plugin import check_plugin
from savmap.plugin.manager import load_class
from savmap_pallets.lab import PalletsLab
from savmap_pallets.plugin import Pallets

ROW = Path(__file__).parents[1] / "row.yaml"


@pytest.mark.slow
def test_contract() -> None:
    check_plugin(Pallets)


def test_the_entry_point_leads_to_it() -> None:
    project = tomllib.loads((ROW.parent / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    for group, plugin_class in {"savmap.plugins": Pallets, "savmap.lab": PalletsLab}.items():
        assert project["entry-points"][group] == {"pallets": f"{plugin_class.__module__}:{plugin_class.__name__}"}


@pytest.mark.skipif("pallets" not in entry_points(group="savmap.plugins").names, reason="run from the source tree")
def test_it_is_installed_as_a_plugin() -> None:
    assert load_class("pallets") is Pallets


def test_the_network_is_small() -> None:
    assert Pallets.model.stat().st_size < 3_000_000


def test_the_scene_has_what_its_survey_says() -> None:
    scene = load_scene(ROW)
    frame = RowFrame(np.eye(3), np.zeros(3), True)
    site = Site(scene.hall, scene.goods, scene.look, {"A": frame, "B": frame})
    parts = PalletsLab().scene(scene.structures["pallets"], np.random.default_rng(0), site)
    assert len(parts.survey["A"]["pallets"]) == 7
    assert parts.survey["B"]["pallets"] == []
    assert {label for box in parts.boxes for label in box.face_labels.values()} == {"pallet"}
    middles = np.array([box.center[[0, 2]] for box in parts.boxes])
    assert np.hypot(*(middles - np.array([2.610, 0.905])).T).min() < 0.1


def test_random_places_have_pallets() -> None:
    random = PalletsLab().random_section(np.random.default_rng(0), furnished(5).site, None)
    assert random is not None
    assert sum(len(row) for row in random.section["rows"].values()) >= 3
