"""Every hook is documented with its exact signature and an example, and is really asked of a plugin by a test here."""

import ast
import inspect
import re
import textwrap
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import typer

from savmap.errors import PluginError, PluginFailedError
from savmap.graph import Constraints, image_measurements
from savmap.lab import hookspecs as lab_hookspecs
from savmap.lab.plugins import LabPlugin
from savmap.lab.scenes import Goods, Hall, Look, RandomSection, SceneParts, Site
from savmap.plugin import hookspecs, manager
from savmap.types import (
    CrossRowLandmark,
    Detection,
    Doubt,
    Drawing,
    Expected,
    Feature,
    FlatParts,
    JointCovariance,
    PlaneEvidence,
    PlanePatch,
    Score,
    SiteMap,
    Structure,
    SurveyEntry,
    Track,
    ViewPlan,
)

from .made_up_plugin import FACTS, PATH, SPEC, VIEW, loaded

HOOKS: dict[str, Callable[..., Any]] = {
    name: value for name, value in {**vars(hookspecs), **vars(lab_hookspecs)}.items() if hasattr(value, "savmap_spec")
}
LAB = {name for name in HOOKS if hasattr(lab_hookspecs, name)}
DOCS = (Path(__file__).parents[2] / "docs" / "hooks.md").read_text(encoding="utf-8")
MASK = np.ones((12, 16), np.bool_)
DETECTION = Detection("thing", 0.9, MASK, MASK.astype(np.float32))
FEATURE = Feature(3, "view", "thing", "foot", 0, np.ones((1, 2)), np.eye(2)[None])
TRACK = Track("thing 1", "thing", {}, np.zeros(1, np.int64), ("view",), np.ones((1, 2)), np.eye(2)[None])
THING = Structure("thing 1", "thing", np.zeros((1, 3)), np.eye(3)[None], ("foot",), np.empty((0, 2), np.int64))


def asked(hook: str, answer: object) -> tuple[Any, dict[str, Any]]:
    """A plugin that answers one hook with `answer`, and what that is given, once it is asked."""
    given: dict[str, Any] = {}
    names = list(inspect.signature(HOOKS[hook]).parameters)
    body = f"def {hook}(self, {', '.join(names)}):\n    given.update({', '.join(f'{n}={n}' for n in names)})\n    return answer"
    scope: dict[str, Any] = {"given": given, "answer": answer}
    exec(body, scope)
    if hook in LAB:
        lab_class = type("MadeUpLab", (), {hook: hookspecs.hookimpl(scope[hook])})
        return LabPlugin("made-up", *manager.set_up("made-up", lab_class, lab_hookspecs)), given
    return loaded(**{hook: scope[hook]}), given


def ask_render_views() -> dict[str, Any]:
    plugin, given = asked("render_views", ViewPlan((SPEC,)))
    assert plugin.render_views(1, len, "left", {}, None).views == (SPEC,)
    return given


def ask_detect() -> dict[str, Any]:
    plugin, given = asked("detect", [DETECTION])
    assert plugin.detect(VIEW, 1) == [DETECTION]
    assert given["threshold"] == 0.25
    assert given["thresholds"] == (0.25, 0.25, 0.25)
    return given


def ask_extract_features() -> dict[str, Any]:
    plugin, given = asked("extract_features", [FEATURE])
    assert plugin.extract_features(VIEW, [DETECTION], None) == [FEATURE]
    return given


def ask_track() -> dict[str, Any]:
    plugin, given = asked("track", [TRACK])
    assert plugin.track([FEATURE], FACTS, np.eye(3)[None], PATH) == [TRACK]
    return given


PATCH = PlanePatch("face", np.zeros(3), np.eye(3)[0], np.eye(3)[1], np.ones(2), 0.1)


def ask_planes() -> dict[str, Any]:
    plugin, given = asked("planes", [PATCH])
    assert plugin.planes({"thing 1": np.zeros(3)}) == [PATCH]
    return given


def ask_expect() -> dict[str, Any]:
    expected = Expected("thing", np.eye(3))
    seen = PlaneEvidence(PATCH, ("thing",), np.zeros((1, 10, 10)), np.zeros((10, 10)), np.zeros((10, 10, 3), np.uint8))
    plugin, given = asked("expect", [expected])
    assert plugin.expect({"thing 1": np.zeros(3)}, [seen], 0.0) == [expected]
    return given


def ask_flat_parts() -> dict[str, Any]:
    flat = FlatParts("thing 1", "z", (PATCH,))
    plugin, given = asked("flat_parts", [flat])
    assert plugin.flat_parts({"thing 1": np.zeros(3)}) == [flat]
    assert asked("describe", [])[0].flat_parts({}) == []
    return given


def ask_constrain() -> dict[str, Any]:
    nothing = Constraints("made-up", {}, image_measurements([], {}, {}), (), {})
    plugin, given = asked("constrain", nothing)
    assert plugin.constrain([TRACK], FACTS, PATH) is nothing
    return given


def ask_describe() -> dict[str, Any]:
    plugin, given = asked("describe", [THING])
    assert plugin.describe([TRACK], FACTS, SimpleNamespace(landmarks_of=lambda plugin: {})) == [THING]
    return given


def ask_relate() -> dict[str, Any]:
    related = replace(THING, attributes={"bay": 1})
    plugin, given = asked("relate", [related])
    assert plugin.relate([THING], {"others": [THING]}) == [related]
    assert asked("describe", [])[0].relate([THING], {}) == [THING]
    return given


def ask_doubt() -> dict[str, Any]:
    doubt = Doubt("shape", "it is unusually high", ("thing 1",))
    plugin, given = asked("doubt", [doubt])
    assert plugin.doubt([THING]) == [doubt]
    with pytest.raises(PluginFailedError, match="thing 2"):
        asked("doubt", [replace(doubt, structures=("thing 2",))])[0].doubt([THING])
    return given


def ask_openings() -> dict[str, Any]:
    plugin, given = asked("openings", [THING])
    assert plugin.openings([THING]) == [THING]
    assert asked("describe", [])[0].openings([THING]) == []
    return given


def ask_places() -> dict[str, Any]:
    plugin, given = asked("places", [THING])
    assert plugin.places([THING], JointCovariance({}, np.eye(1))) == [THING]
    assert loaded(places=lambda self, structures: structures).places([THING], None) == [
        THING
    ]  # as before there was `joint`
    assert asked("describe", [])[0].places([THING], None) == []
    return given


def ask_cross_row_landmarks() -> dict[str, Any]:
    thing = CrossRowLandmark("thing 1", "thing", np.zeros(3), np.eye(3))
    plugin, given = asked("cross_row_landmarks", [thing])
    assert plugin.cross_row_landmarks([THING]) == [thing]
    return given


def ask_evaluate() -> dict[str, Any]:
    score = Score(missing={"thing": 1})
    plugin, given = asked("evaluate", score)
    assert plugin.evaluate([THING], {}) is score
    return given


def ask_survey_entry() -> dict[str, Any]:
    entry = SurveyEntry({"things": [[0.0, 1.0, 2.0]]}, {"thing 1": "it is odd"})
    plugin, given = asked("survey_entry", entry)
    assert plugin.survey_entry([THING]) is entry
    assert dict(asked("describe", [])[0].survey_entry([THING]).values) == {}
    for bad in (
        SurveyEntry({}, {"thing 2": "who?"}),
        SurveyEntry({"x": float("nan")}),
        SurveyEntry({"x": np.zeros(3)}),
    ):
        with pytest.raises(PluginFailedError, match="returned what cannot be used from `survey_entry`"):
            asked("survey_entry", bad)[0].survey_entry([THING])
    return given


def ask_draw() -> dict[str, Any]:
    drawing = Drawing("point", np.zeros((1, 3)), "mapped", "fixture", "things")
    plugin, given = asked("draw", (drawing,))
    assert plugin.draw([THING], None, {}) == (drawing,)
    return given


def ask_scene() -> dict[str, Any]:
    parts = SceneParts([], {})
    plugin, given = asked("scene", parts)
    site = Site(Hall(), Goods(), Look(), {})
    assert plugin.scene({}, np.random.default_rng(0), site) is parts
    return given


def ask_random_section() -> dict[str, Any]:
    section = RandomSection({})
    plugin, given = asked("random_section", section)
    site = Site(Hall(), Goods(), Look(), {})
    assert plugin.random_section(np.random.default_rng(0), site, None) is section
    return given


def ask_practice_pictures() -> dict[str, Any]:
    plugin, given = asked("practice_pictures", None)
    plugin.practice_pictures(Path("practice"), 3, 0)
    return given


def ask_exporters() -> dict[str, Any]:
    def write(site_map: SiteMap, path: Path) -> None: ...

    plugin, given = asked("exporters", {"made": write})
    assert plugin.exporters() == {"made": write}
    return given


def ask_register_commands() -> dict[str, Any]:
    plugin, given = asked("register_commands", None)
    plugin.instance.register_commands(typer.Typer())
    return given


ASKED: dict[str, Callable[[], dict[str, Any]]] = {
    "render_views": ask_render_views,
    "detect": ask_detect,
    "extract_features": ask_extract_features,
    "track": ask_track,
    "planes": ask_planes,
    "expect": ask_expect,
    "flat_parts": ask_flat_parts,
    "constrain": ask_constrain,
    "describe": ask_describe,
    "relate": ask_relate,
    "doubt": ask_doubt,
    "openings": ask_openings,
    "places": ask_places,
    "cross_row_landmarks": ask_cross_row_landmarks,
    "evaluate": ask_evaluate,
    "survey_entry": ask_survey_entry,
    "draw": ask_draw,
    "scene": ask_scene,
    "random_section": ask_random_section,
    "practice_pictures": ask_practice_pictures,
    "exporters": ask_exporters,
    "register_commands": ask_register_commands,
}


def test_every_hook_is_tested_and_every_test_is_of_a_hook() -> None:
    assert set(ASKED) == set(HOOKS)


@pytest.mark.parametrize("name", HOOKS)
def test_a_plugin_is_asked_with_every_argument_and_its_answer_comes_back(name: str) -> None:
    assert set(ASKED[name]()) == set(inspect.signature(HOOKS[name]).parameters)


@pytest.mark.parametrize("name", sorted(set(HOOKS) - {"exporters", "register_commands"}))
def test_an_answer_of_another_type_is_refused_with_the_plugins_name(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    real = asked
    ask = ASKED[name]
    monkeypatch.setitem(ask.__globals__, "asked", lambda hook, answer: real(hook, 3))
    with pytest.raises(PluginFailedError, match=f"plugin `made-up` returned int from `{name}`, not ") as caught:
        ask()
    assert (caught.value.plugin, caught.value.hook) == ("made-up", name)


def test_a_plugin_that_fails_to_add_its_commands_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    class Broken:
        @staticmethod
        def register_commands(app: object) -> None:
            raise RuntimeError("oh")

    monkeypatch.setattr(manager, "installed", lambda: {"broken": None})
    monkeypatch.setattr(manager, "load_class", lambda name: Broken)
    with pytest.raises(PluginError, match="plugin `broken` failed in `register_commands`: RuntimeError: oh"):
        manager.register_commands(typer.Typer())


def blocks_of(name: str) -> list[str]:
    """The Python blocks of a hook's bay in the documentation."""
    section = re.search(rf"^## {name}\n(.*?)(?=^## |\Z)", DOCS, re.MULTILINE | re.DOTALL)
    assert section is not None, f"docs/hooks.md has no bay {name}"
    return re.findall(r"```python\n(.*?)```", section.group(1), re.DOTALL)


def signature_of(source: str) -> tuple[list[tuple[str, str]], str]:
    """Arguments with their types, and what is given, of the function in a piece of source; types in quotes are taken out of them."""
    (function,) = ast.parse(textwrap.dedent(source)).body
    assert isinstance(function, ast.FunctionDef)
    return [(one.arg, _type(one.annotation)) for one in function.args.args], _type(function.returns)


class _Unquoted(ast.NodeTransformer):
    def visit_Constant(self, node: ast.Constant) -> ast.expr:
        return ast.parse(node.value, mode="eval").body if isinstance(node.value, str) else node

    def visit_Subscript(self, node: ast.Subscript) -> ast.AST:
        return node if ast.unparse(node.value) == "Literal" else self.generic_visit(node)


def _type(annotation: ast.expr | None) -> str:
    return ast.unparse(_Unquoted().visit(annotation)) if annotation is not None else ""


@pytest.mark.parametrize("name", HOOKS)
def test_every_hook_is_documented_with_its_exact_signature(name: str) -> None:
    documented = signature_of(blocks_of(name)[0])
    assert documented == signature_of(inspect.getsource(HOOKS[name]))
    assert [argument for argument, _ in documented[0]] == list(inspect.signature(HOOKS[name]).parameters)


@pytest.mark.parametrize("name", HOOKS)
def test_every_hook_has_an_example_that_a_plugin_could_have(name: str) -> None:
    (function,) = ast.parse(blocks_of(name)[1]).body
    assert isinstance(function, ast.FunctionDef)
    assert function.name == name
    assert {one.arg for one in function.args.args} - {"self"} <= set(inspect.signature(HOOKS[name]).parameters)
    assert "hookimpl" in {ast.unparse(one) for one in function.decorator_list}


def test_nothing_is_documented_that_is_no_hook() -> None:
    assert set(re.findall(r"^## ([a-z_]+)$", DOCS, re.MULTILINE)) == set(HOOKS)
