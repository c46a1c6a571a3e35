"""Plugins' settings in a site: told with the line where they stand, and what of them may tell the scale."""

from pathlib import Path
from typing import Any

import pytest

from savmap.site.load import read_draft, site_of
from savmap.site.model import Site
from savmap.site.overrides import overrides_of
from savmap.site.preflight import settings_problems, tells_scale

SITE = """\
plugins:
  shelves:
    threshhold: 0.4
  lights: {line: maybe}
rows:
  A: {passes: [{video: a.mp4}]}
  B:
    passes: [{video: a.mp4}]
    plugins:
      shelves: {beam_setback_m: 5}
"""


def problems(folder: Path, text: str, plugins: list[str], *options: str) -> list[str]:
    path = folder / "site.yaml"
    path.write_text(text, encoding="utf-8")
    draft = read_draft(path, overrides_of(options, {}))
    return [str(one).removeprefix(f"{folder}/") for one in settings_problems(site_of(draft), plugins, draft.places)]


def test_every_wrong_setting_is_told_once_with_its_line(tmp_path: Path) -> None:
    found = problems(tmp_path, SITE, ["shelves", "lights", "shelfs"])
    assert [one[:40] for one in found] == [
        "site.yaml:3: unknown key `plugins.shelve",
        "site.yaml:10: `rows.B.plugins.shelves.be",
        "site.yaml:4: `plugins.lights.line`: true",
        "unknown plugin `shelfs`: did you mean `s",
    ]


def test_an_option_is_named_in_place_of_the_line(tmp_path: Path) -> None:
    found = problems(tmp_path, SITE.replace("hh", "h"), ["shelves"], "rows.A.plugins.shelves.beam_setback_m=7")
    assert found[0].startswith("--set rows.A.plugins.shelves.beam_setback_m: `rows.A.plugins.shelves.beam_setback_m`")


def test_a_value_that_is_no_yaml_is_text_for_its_key(tmp_path: Path) -> None:
    text = SITE.replace("threshhold: 0.4", "threshold: 0.4").replace("  lights: {line: maybe}\n", "  signs: {}\n")
    assert problems(tmp_path, text, ["signs"], "plugins.signs.pattern=[A-Z]+") == []
    (found,) = problems(tmp_path, text, ["signs"], "plugins.signs.pattern=[A-Z")
    assert found.startswith("--set plugins.signs.pattern: `plugins.signs.pattern`: is not a regular expression: unterm")


HEIGHT = {"values": 0.3}


@pytest.mark.parametrize(
    ("references", "settings", "tells"),
    [
        ({}, {}, False),
        ({"camera_height_m": {"value": 3}}, {}, True),
        ({"points": [{"vertex": "a", "axis": "y", "value": 1, "sigma": 0.01}]}, {}, False),
        ({"points": 2 * [{"vertex": "a", "axis": "y", "value": 1, "sigma": 0.01}]}, {}, True),
        ({"travel_m": 12}, {"shelves": {"threshold": 0.4}, "lights": {"line": True}}, False),
        ({}, {"shelves": {"lowest_beam_bottom_height_m": HEIGHT}}, True),
        ({}, {"shelves": {"bay_pitch_m": None}}, False),
    ],
)
def test_what_may_tell_the_scale(references: dict[str, Any], settings: dict[str, Any], tells: bool) -> None:
    rows = {"A": {"passes": [{"video": "a.mp4"}]}}
    site = Site.model_validate({"references": references, "plugins": settings, "rows": rows})
    assert tells_scale(site, "A", ["shelves", "lights"]) is tells


@pytest.mark.parametrize("given", [0.3, [0.3, 4.2], {"values": [0.3, 4.2]}])
def test_heights_of_lowest_beams_may_stand_alone(given: object) -> None:
    from savmap_shelves.settings import ShelvesSettings as Settings

    known = Settings.model_validate({"lowest_beam_bottom_height_m": given}).lowest_beam_bottom_height_m
    assert known is not None
    assert known.values == (0.3 if given == 0.3 else (0.3, 4.2))
    assert known.sigma == 0.002


@pytest.mark.parametrize("given", [2.7, [2.7, None], {"value": 2.7}])
def test_pitches_of_bays_may_stand_alone(given: object) -> None:
    from savmap_shelves.settings import ShelvesSettings as Settings

    known = Settings.model_validate({"bay_pitch_m": given}).bay_pitch_m
    assert known is not None
    assert known.value == ((2.7, None) if isinstance(given, list) else 2.7)
    assert known.sigma == 0.003


def test_sections_may_have_no_height_but_not_all() -> None:
    from savmap_shelves.settings import ShelvesSettings as Settings

    known = Settings.model_validate({"lowest_beam_bottom_height_m": [0.3, None]}).lowest_beam_bottom_height_m
    assert known is not None
    assert known.values == (0.3, None)
    with pytest.raises(ValueError, match="no value is given"):
        Settings.model_validate({"lowest_beam_bottom_height_m": [None, None]})


def test_a_height_in_another_unit_is_refused() -> None:
    from savmap_shelves.settings import ShelvesSettings as Settings

    with pytest.raises(ValueError, match="less than 10"):
        Settings.model_validate({"lowest_beam_bottom_height_m": [0.3, 42.4]})
