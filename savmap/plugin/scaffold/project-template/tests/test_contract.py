"""The contract that savmap's engine relies on."""

from importlib.metadata import entry_points

from savmap.plugin import check_plugin
from savmap_pillars.plugin import Pillars


def test_the_contract_holds() -> None:
    check_plugin(Pillars)


def test_savmap_finds_the_plugin_by_its_entry_point() -> None:
    (point,) = entry_points(group="savmap.plugins", name="pillars")
    assert point.load() is Pillars
