"""A plugin that is installed and cannot be used is listed with the reason; all else works."""

import json
from pathlib import Path

import pytest

from savmap.cli.commands.installation import plugin_lines, schema_of
from savmap.cli.commands.results import export
from savmap.errors import PluginError, SiteError
from savmap.maps.map_file import write_map
from savmap.plugin import manager
from savmap.site.job import chosen_plugins
from savmap.site.model import Site
from savmap.site.template import starter_text
from savmap.types import SiteMap

MODULES = {
    "unimportable": "import a_module_that_is_not_there\n",
    "leaving": "raise SystemExit(0)\n",
    "incomplete": "class Plugin:\n    name = 'incomplete'\n",
    "misled": "from pathlib import Path\nclass Plugin:\n    name, classes, model = 'misled', ('post',), Path('m')\n"
    "    ifc_classes = {'IfcColumn': ('post',)}\n",
}
REASONS = {
    "unimportable": "cannot be imported: ModuleNotFoundError: No module named 'a_module_that_is_not_there'",
    "leaving": "cannot be imported: SystemExit: 0",
    "incomplete": "cannot be used: `classes` must be a tuple of names",
    "misled": "cannot be used: `ifc_classes` must be a mapping of classes of IFC to labels",
}


@pytest.fixture(params=sorted(MODULES), autouse=True)
def broken(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """The name of a broken plugin that is installed beside ours."""
    name = str(request.param)
    record = tmp_path / "packages" / f"{name}-1.0.dist-info"
    record.mkdir(parents=True)
    (record / "entry_points.txt").write_text(f"[savmap.plugins]\n{name} = made_up_{name}:Plugin\n", encoding="utf-8")
    (record / "METADATA").write_text(f"Name: {name}\nVersion: 1.0\n", encoding="utf-8")
    (record.parent / f"made_up_{name}.py").write_text(MODULES[name], encoding="utf-8")
    monkeypatch.syspath_prepend(str(record.parent))
    return name


def test_it_is_listed_with_the_reason_beside_the_others(broken: str) -> None:
    lines = list(plugin_lines())
    (line,) = [line for line in lines if line.startswith("  broken ")]
    assert REASONS[broken] in line
    assert {"shelves", "lights", "signs", broken} <= {line.split()[0] for line in lines if not line.startswith(" ")}


def test_maps_are_exported_and_an_unknown_format_names_it(broken: str, tmp_path: Path) -> None:
    write_map(SiteMap({}, {}), tmp_path / "map.json")
    export(tmp_path / "map.json", tmp_path / "map.csv", "csv")
    assert (tmp_path / "map.csv").is_file()
    with pytest.raises(SiteError, match=r"known formats are .*csv, .*ply") as caught:
        export(tmp_path / "map.json", tmp_path / "map.obj", "obj")
    assert REASONS[broken] in str(caught.value)


def test_the_schema_of_site_files_has_the_others(broken: str) -> None:
    settings = json.loads(schema_of("site"))["properties"]["plugins"]["properties"]
    assert "shelves" in settings
    assert broken not in settings


def test_a_site_file_to_start_from_says_it(broken: str) -> None:
    text = starter_text([], Path())
    assert REASONS[broken] in text
    assert "\n  shelves:\n" in text


def test_a_bare_video_is_mapped_with_the_others_and_a_note(broken: str) -> None:
    names, note = chosen_plugins(Site.model_validate({"rows": {"A": {"passes": [{"video": "a.mp4"}]}}}), None)
    assert "shelves" in names
    assert broken not in names
    assert f"; not {broken}: plugin `{broken}`" in note
    assert REASONS[broken] in note


def test_where_it_is_named_it_is_refused(broken: str) -> None:
    with pytest.raises(PluginError, match=f"plugin `{broken}`"):
        manager.open_plugin(broken, {})
