"""Each of our plugins keeps the contract that any plugin must keep."""

from pathlib import Path

import pytest
from pydantic import BaseModel, ConfigDict

from savmap.plugin.contract import check_plugin
from savmap.plugin.hookspecs import hookimpl
from savmap.plugin.manager import load_class
from savmap.types import View


@pytest.mark.parametrize("name", ["shelves", "lights", "signs"])
def test_our_plugins_keep_the_contract(name: str) -> None:
    check_plugin(load_class(name))


class Lax(BaseModel):
    model_config = ConfigDict(extra="allow")


class Strict(BaseModel):
    model_config = ConfigDict(extra="forbid")


class Broken:
    name = "broken"
    classes = ("thing",)
    model = Path("none.onnx")
    Config = Strict

    def __init__(self, config: Strict) -> None: ...

    @hookimpl
    def extract_features(self, view: View) -> list[int]:
        return [1]


@pytest.mark.parametrize(
    ("changes", "clause"),
    [
        ({"classes": ["thing"]}, "`classes` must be a tuple"),
        ({"Config": Lax}, "must refuse unknown keys"),
        ({"model": "none.onnx"}, "`model` must be a Path"),
        ({}, "extract_features"),
    ],
)
def test_a_broken_plugin_is_told_which_clause(changes: dict[str, object], clause: str) -> None:
    with pytest.raises(AssertionError, match="breaks its contract") as caught:
        check_plugin(type("Changed", (Broken,), changes), require_model=False)
    assert clause in str(caught.value)
