"""The published JSON Schema of site files is current, and says what the program checks."""

import json
from pathlib import Path
from typing import Any

import pytest
import yaml

from savmap.cli.commands.installation import schema_of
from savmap.site.layout import placements
from savmap.site.load import read_draft, site_of
from savmap.site.preflight import settings_problems
from savmap.site.schema import schema_text

ROOT = Path(__file__).parents[2]
SCHEMA = ROOT / "docs" / "site.schema.json"
EXAMPLE = yaml.safe_load((ROOT / "examples" / "aisle-dev" / "site.yaml").read_text(encoding="utf-8"))
OURS = [path.name for path in (ROOT / "plugins").iterdir()]


def errors(content: object) -> list[str]:
    import jsonschema

    validator = jsonschema.Draft202012Validator(json.loads(SCHEMA.read_text(encoding="utf-8")))
    return [one.json_path for one in validator.iter_errors(content)]


def test_the_published_schema_is_current() -> None:
    assert SCHEMA.read_text(encoding="utf-8") == schema_text(OURS), "savmap schema site > docs/site.schema.json"


def test_the_command_prints_both() -> None:
    assert json.loads(schema_of("site"))["title"] == "savmap site file"
    assert "RowEntry" in json.loads(schema_of("map"))["$defs"]


def test_the_example_is_valid() -> None:
    assert errors(EXAMPLE) == []


def test_the_site_file_of_the_documentation_is_valid(tmp_path: Path) -> None:
    text = (ROOT / "docs" / "site-file.md").read_text(encoding="utf-8").split("```yaml\n")[1].split("```")[0]
    assert errors(yaml.safe_load(text)) == []
    (tmp_path / "site.yaml").write_text(text, encoding="utf-8")
    draft = read_draft(tmp_path / "site.yaml")
    site = site_of(draft)
    assert list(settings_problems(site, list(site.plugins), draft.places)) == []
    assert placements(site)["A"].heading_deg == 0


@pytest.mark.parametrize(
    ("change", "wrong"),
    [
        ({"rows": {"A": {"passes": [{}]}}, "video": "a.mp4"}, []),
        ({"calibration": {"panorama": True, "rolling_shutter": {"axis": "rows"}}}, []),
        ({"plugins": {"shelves": None, "others": {"anything": 1}}}, []),
        ({"plugins": {"shelves": {"threshhold": 0.4}}}, ["$.plugins.shelves"]),
        ({"rows": {"A": {"passes": [{"video": "a.mp4", "side": "up"}]}}}, ["$.rows.A.passes[0].side"]),
        ({"rows": {"A": {"passes": []}}}, ["$.rows.A.passes"]),
        ({"rows": {}}, ["$.rows"]),
        ({"row": {}}, ["$"]),
        ({"layout": {"aisle_m": 3}}, ["$.layout"]),
    ],
)
def test_the_schema_says_what_the_program_checks(change: dict[str, Any], wrong: list[str]) -> None:
    assert errors({**EXAMPLE, **change}) == wrong


def test_every_key_is_described() -> None:
    schema = json.loads(SCHEMA.read_text(encoding="utf-8"))
    sections = {"site": schema, **schema["$defs"]}
    keys = {f"{name}.{key}": one for name, section in sections.items() for key, one in section["properties"].items()}
    assert len(keys) > 70
    assert [key for key, one in keys.items() if not one.get("description")] == []
