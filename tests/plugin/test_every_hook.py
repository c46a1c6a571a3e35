"""Every hook is documented with its exact signature and an example, and is really asked of a plugin by a test here."""

import ast
import inspect
import re
import textwrap
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from savmap.errors import PluginFailedError
from savmap.lab import hookspecs as lab_hookspecs
from savmap.lab.plugins import LabPlugin
from savmap.lab.scenes import Exposure, Goods, Hall, RandomSection, SceneParts, Site
from savmap.plugin import hookspecs
from savmap.plugin.manager import set_up
from savmap.types import Score

from .made_up_plugin import ANSWERS, CALLS, THING, loaded

HOOKS: dict[str, Callable[..., Any]] = {
    name: value for name, value in {**vars(hookspecs), **vars(lab_hookspecs)}.items() if hasattr(value, "savmap_spec")
}
DOCS = (Path(__file__).parents[2] / "docs" / "hooks.md").read_text(encoding="utf-8")
SITE = Site(Hall(), Goods(), Exposure(), {})
LAB_CALLS: dict[str, Callable[[Any], Any]] = {
    "scene": lambda plugin: plugin.scene({}, np.random.default_rng(0), SITE),
    "random_section": lambda plugin: plugin.random_section(np.random.default_rng(0), SITE, None),
    "practice_picture": lambda plugin: plugin.practice_picture(3, 0),
}
LAB_ANSWERS: dict[str, Any] = {
    "scene": SceneParts([], {}),
    "random_section": RandomSection({}),
    "practice_picture": (np.zeros((480, 640, 3), np.uint8), np.zeros((480, 640), np.uint8)),
}
ASK = CALLS | LAB_CALLS


def asked(hook: str, answer: object) -> tuple[Any, dict[str, Any]]:
    """A plugin that answers one hook with `answer`, and what that is given, once it is asked."""
    given: dict[str, Any] = {}
    names = list(inspect.signature(HOOKS[hook]).parameters)
    arguments = ", ".join(f"{name}={name}" for name in names)
    body = f"def {hook}(self, {', '.join(names)}):\n    given.update({arguments})\n    return answer"
    scope: dict[str, Any] = {"given": given, "answer": answer}
    exec(body, scope)
    if hook in LAB_CALLS:
        lab_class = type("MadeUpLab", (), {hook: hookspecs.hookimpl(scope[hook])})
        return LabPlugin("made-up", set_up("made-up", lab_class)), given
    return loaded(**{hook: scope[hook]}), given


def test_every_hook_is_tested_and_every_test_is_of_a_hook() -> None:
    assert set(ASK) == set(HOOKS)


@pytest.mark.parametrize("name", HOOKS)
def test_a_plugin_is_asked_with_every_argument_and_its_answer_comes_back(name: str) -> None:
    answer = (ANSWERS | LAB_ANSWERS)[name]
    plugin, given = asked(name, answer)
    assert ASK[name](plugin) == answer
    assert set(given) == set(inspect.signature(HOOKS[name]).parameters)
    if name == "detect":
        assert (given["threshold"], given["thresholds"]) == (0.25, (0.25, 0.25, 0.25))


@pytest.mark.parametrize("name", HOOKS)
def test_an_answer_of_another_type_is_refused_with_the_plugins_name(name: str) -> None:
    with pytest.raises(PluginFailedError, match=f"plugin `made-up` returned int from `{name}`, not ") as caught:
        ASK[name](asked(name, 3)[0])
    assert (caught.value.plugin, caught.value.hook) == ("made-up", name)


def test_hooks_that_a_plugin_leaves_out_have_defaults() -> None:
    plugin = loaded()
    for name in ("find", "planes", "flat_parts", "warnings", "openings", "places", "cross_row_landmarks"):
        assert CALLS[name](plugin) == []
    assert CALLS["relate"](plugin) == [THING]
    assert CALLS["draw"](plugin) == ()
    assert isinstance(CALLS["evaluate"](plugin), Score)
    assert dict(CALLS["survey_entry"](plugin).values) == {}
    assert asked("scene", SceneParts([], {}))[0].random_section(np.random.default_rng(0), SITE, None) is None


def blocks_of(name: str) -> list[str]:
    """The Python blocks of a hook's bay in the documentation."""
    section = re.search(rf"^## {name}\n(.*?)(?=^## |\Z)", DOCS, re.MULTILINE | re.DOTALL)
    assert section is not None, f"docs/hooks.md has no bay {name}"
    return re.findall(r"```python\n(.*?)```", section.group(1), re.DOTALL)


def signature_of(source: str) -> tuple[list[tuple[str, str]], str]:
    """Arguments with their types, and the answer's type, of the function in a piece of source, without quotes."""
    (function,) = ast.parse(textwrap.dedent(source)).body
    assert isinstance(function, ast.FunctionDef)
    return [(argument.arg, _type(argument.annotation)) for argument in function.args.args], _type(function.returns)


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
    assert {argument.arg for argument in function.args.args} - {"self"} <= set(
        inspect.signature(HOOKS[name]).parameters
    )
    assert "hookimpl" in {ast.unparse(decorator) for decorator in function.decorator_list}


def test_nothing_is_documented_that_is_no_hook() -> None:
    assert set(re.findall(r"^## ([a-z_]+)$", DOCS, re.MULTILINE)) == set(HOOKS)
