"""Labelled pictures of the structures of further plugins."""

import sys
from collections.abc import Callable, Mapping
from importlib.metadata import EntryPoint
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from savmap.errors import PluginError, PluginFailedError
from savmap.lab.plugins import GROUP, lab_plugin
from savmap.lab.scenes import FACES, Box, Exposure, Goods, Hall, Material, RandomSection, SceneError, SceneParts, Site
from savmap.lab.sim.dataset import view_mask
from savmap.lab.sim.drive.cart import drive
from savmap.lab.sim.drive.views import sample_camera
from savmap.lab.sim.posts import build_posts
from savmap.lab.sim.random_scene import random_scene
from savmap.lab.sim.render.raycast import Caster
from savmap.lab.sim.scene.build import build
from savmap.lab.sim.scene.files import Scene
from savmap.lab.sim.simulate import references, site_of
from savmap.plugin.hookspecs import hookimpl
from savmap.plugin.manager import installed

CLASSES = ("upright", "beam", "light")


class CratesLab:
    @hookimpl
    def scene(self, section: Mapping[str, Any]) -> SceneParts:
        """Crates on the floor before the first row."""
        size = np.array([0.8, 0.3, 0.6])
        places = [np.array([x, 0.15, 0.7]) for x in section["x"]]
        boxes = [Box(at, size, Material((0.5, 0.3, 0.1)), face_labels=dict.fromkeys(FACES, "crate")) for at in places]
        return SceneParts(boxes, {})

    @hookimpl
    def random_section(self, rng: np.random.Generator) -> RandomSection:
        return RandomSection({"x": [float(x) for x in np.arange(0.0, 12.0, 1.2) + rng.uniform(-0.1, 0.1, 10)]})


def install(monkeypatch: pytest.MonkeyPatch, lab_class: type) -> None:
    """Let `crates` be an installed plugin, which has this class for the laboratory."""
    module = ModuleType("savmap_crates")
    vars(module).update(Crates=lab_class)
    monkeypatch.setitem(sys.modules, "savmap_crates", module)
    point = EntryPoint("crates", "savmap_crates:Crates", GROUP)
    monkeypatch.setattr("savmap.lab.plugins.installed", lambda group: installed(group) | {"crates": point})


@pytest.fixture
def crates(monkeypatch: pytest.MonkeyPatch) -> None:
    install(monkeypatch, CratesLab)


def test_a_random_scene_has_them_and_their_class_comes_after_ours(crates: None) -> None:
    built = build(random_scene(3, ["crates"]))
    caster, rng = Caster(built.boxes), np.random.default_rng(0)
    cameras = [sample_camera(built, rng, "floor") for _ in range(6)]
    masks = np.stack([view_mask(caster, camera, (*CLASSES, "crate"), 64, 48) for camera in cameras])
    own = len(CLASSES) + 1
    assert (masks == own).mean() > 0.01
    assert not (np.stack([view_mask(caster, camera, CLASSES, 64, 48) for camera in cameras]) == own).any()
    assert all(camera.world_from_view[1, 2] < -0.4 for camera in cameras)


def test_the_rest_of_the_place_stays_as_it_is(crates: None) -> None:
    plain, more = random_scene(3), random_scene(3, ["crates"])
    assert more.structures["crates"] == random_scene(3, ["crates"]).structures["crates"]
    assert more.model_copy(update={"structures": plain.structures}) == plain


def test_a_plugin_that_builds_no_scenes_is_named(scene_with: Callable[..., Scene]) -> None:
    with pytest.raises(SceneError, match=r"structures\.nobody: no installed plugin of that name builds scenes"):
        build(scene_with().model_copy(update={"structures": {"nobody": {}}}))


def test_a_plugin_without_random_sections_is_named() -> None:
    with pytest.raises(SceneError, match="--plugin nobody: its `random_section` makes up nothing"):
        random_scene(3, ["nobody"])


def test_a_broken_laboratory_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    class Misspelt:
        @hookimpl
        def scenes(self) -> None: ...

    install(monkeypatch, Misspelt)
    with pytest.raises(PluginError, match=r"plugin `crates` .*`scenes` is no hook: did you mean `scene`\?"):
        lab_plugin("crates")

    class Failing:
        @hookimpl
        def scene(self) -> None:
            raise RuntimeError("oh")

    install(monkeypatch, Failing)
    crates = lab_plugin("crates")
    assert crates is not None
    with pytest.raises(PluginFailedError, match="plugin `crates` failed in `scene`: RuntimeError: oh"):
        crates.scene({}, np.random.default_rng(0), Site(Hall(), Goods(), Exposure(), {}))


def test_a_plugin_is_told_how_long_the_rows_are_and_what_stands_in_them(scene_with: Callable[..., Scene]) -> None:
    told: list[Site] = []

    def scene(section: Mapping[str, Any], rng: np.random.Generator, site: Site) -> SceneParts:
        told.append(site)
        return SceneParts([], {})

    plain = scene_with()
    with_crates = plain.model_copy(update={"structures": {**plain.structures, "crates": {}}})
    built = build(with_crates, {"crates": scene})
    (site,) = told
    uprights = built.survey["rows"]["A"]["uprights"]
    assert site.sizes["A"].length == pytest.approx(uprights[-1][1])
    assert len([front for front in site.fronts["A"] if front.high[1] - front.low[1] > 2]) == len(uprights)
    assert site.aisle == pytest.approx(2.4)


def test_a_plugin_switches_off_and_adds_distractors(scene_with: Callable[..., Scene]) -> None:
    box = Box(np.array([1.0, 0.1, 0.6]), np.full(3, 0.2), Material((0.5, 0.3, 0.1)), face_labels={"+z": "crate"})

    def scene(section: Mapping[str, Any], rng: np.random.Generator, site: Site) -> SceneParts:
        return SceneParts([box], {}, distractors=[box], without=frozenset({"goods", "aisle_marking"}))

    plain = scene_with(hall={"x": [-3.0, 7.0], "z": [-4.0, 5.0], "height": 4.5, "aisle_marking": True})
    built = build(plain.model_copy(update={"structures": {**plain.structures, "crates": {}}}), {"crates": scene})
    crates = [own for own in built.boxes if own.center is box.center]
    assert [dict(own.face_labels) for own in crates] == [{"+z": "crate"}, {}]
    paint = [own for own in built.boxes if own.size[1] == pytest.approx(0.002) and own.size[0] > 5]
    assert not paint
    assert any(own.size[1] == pytest.approx(0.002) and own.size[0] > 5 for own in build(plain).boxes)
    cartons = [own.material.texture == "carton" for own in built.boxes]
    assert not any(cartons)
    assert any(own.material.texture == "carton" for own in build(plain).boxes)


def test_a_row_of_which_nothing_is_known_beforehand_is_in_the_site_file() -> None:
    def posts(section: Mapping[str, Any], rng: np.random.Generator, site: Site) -> SceneParts:
        return build_posts(section, site, "posts", "post")

    content = {"rows": {"A": {"x": 0.0, "z": 0.0}}, "structures": {"posts": {"stands": [{"x": 1.0, "z": 0.0}]}}}
    built = build(Scene.model_validate(content), {"posts": posts})
    known = references(built, drive(built.scene.cart, built.scene.seed))
    assert "row_A" not in known
    assert list(site_of(built, known)["rows"]) == ["A"]


def test_the_site_file_names_the_plugins_that_are_to_map() -> None:
    content = {"structures": {"posts": {}, "lamps": {}}, "mapped": ["posts"]}
    for scene, named in ((content, ["posts"]), ({**content, "mapped": []}, ["posts", "lamps"])):
        built = build(
            Scene.model_validate(scene),
            {"posts": lambda *_: SceneParts([], {}), "lamps": lambda *_: SceneParts([], {})},
        )
        assert list(site_of(built, references(built, drive(built.scene.cart, 0)))["plugins"]) == named
