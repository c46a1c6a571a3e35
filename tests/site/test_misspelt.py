"""Keys that run into their values, have none, or are numbers in YAML that nobody meant: said at every level of the site file."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from pydantic import BaseModel

from savmap.errors import SiteError
from savmap.files.validation import annotations_at, fields_of
from savmap.site.job import chosen_plugins, job_for
from savmap.site.load import load_alignment, load_site, notes_on, problems_in, read_draft, site_of
from savmap.site.model import Site
from savmap.site.preflight import settings_problems

ROWS = {"A": {"passes": [{"video": "a.mp4"}]}}
HERE = "<here>"
Location = tuple[Any, ...]


def sections(model: type[BaseModel], at: Location = ()) -> Iterator[tuple[Location, type[BaseModel]]]:
    """Every section that the model may hold, one entry of each list and mapping: its location and its model."""
    yield at, model
    for key in fields_of(model):
        for part in ((), ("A",), (0,)):
            inner = [
                one
                for one in annotations_at(model, (key, *part))
                if isinstance(one, type) and issubclass(one, BaseModel)
            ]
            for one in inner:
                yield from sections(one, (*at, key, *part))
            if inner:
                break


SECTIONS = dict(sections(Site))
KEYS = {at: list(fields_of(model)) for at, model in SECTIONS.items()}


def put(content: Any, at: Location, value: Any) -> Any:
    if not at:
        return value
    if isinstance(at[0], int):
        return [put(None, at[1:], value)]
    return {**(content or {}), at[0]: put((content or {}).get(at[0]), at[1:], value)}


def written(folder: Path, at: Location, section: str) -> Path:
    """A site file with a flow section at a location, which stands in line 2."""
    content = put({"rows": ROWS}, at, HERE)
    text = json.dumps(content) if at else f'{{"rows": {json.dumps(ROWS)}, {section[1:]}'
    path = folder / "site.yaml"
    path.write_text("\n" + text.replace(json.dumps(HERE), section) + "\n", encoding="utf-8")
    return path


def said(path: Path) -> list[str]:
    draft = read_draft(path)
    wrong = [line for _, line in problems_in(draft)]
    if wrong:
        return [*wrong, *notes_on(draft)]
    site = site_of(draft)
    problems = settings_problems(site, chosen_plugins(site, None)[0], draft.places)
    return [*map(str, problems), *notes_on(draft)]


def test_all_levels_are_tried() -> None:
    assert len(SECTIONS) > 20
    assert {(), ("rows", "A", "passes", 0), ("references", "lengths", 0), ("align", "anchor")} <= set(SECTIONS)


def missed(lines: list[str], expected: list[str]) -> list[str]:
    """What no line about line 2 of the file says."""
    return [text for text in expected if not any("site.yaml:2: " in line and text in line for line in lines)]


@pytest.mark.parametrize("colon", [":", "\uff1a", "\uff1a "])
@pytest.mark.parametrize("at", KEYS)
def test_keys_that_run_into_their_values(tmp_path: Path, at: Location, colon: str) -> None:
    section = ", ".join(f"{key}{colon}right" for key in KEYS[at])
    assert not missed(said(written(tmp_path, at, f"{{{section}}}")), [f"write `{key}: right`" for key in KEYS[at]])


@pytest.mark.parametrize("at", KEYS)
def test_unknown_keys_without_a_value(tmp_path: Path, at: Location) -> None:
    lines = said(written(tmp_path, at, f"{{{', '.join(f'{key}x: ' for key in KEYS[at])}}}"))
    assert not missed([line for line in lines if "unknown key" in line], [f"{key}x`" for key in KEYS[at]])


@pytest.mark.parametrize("at", KEYS)
def test_known_keys_without_a_value(tmp_path: Path, at: Location) -> None:
    keys = [key for key in KEYS[at] if key != "rows"]
    lines = said(written(tmp_path, at, f"{{{', '.join(f'{key}: ' for key in keys)}}}"))
    assert not missed([line for line in lines if "no value" in line], [f"{key}`" for key in keys])


@pytest.mark.parametrize("at", [("views", "A"), ("rows", "B"), ("layout", "lengths_m", "A"), ("plugins", "shelves")])
def test_a_name_that_runs_into_its_value(tmp_path: Path, at: Location) -> None:
    lines = said(written(tmp_path, at[:-1], f"{{{at[-1]}:2}}"))
    assert any("site.yaml:2: " in line and f"write `{at[-1]}: 2`" in line for line in lines), lines


@pytest.mark.parametrize(
    ("plugins", "expected"),
    [
        ("{shelves: {bay_pitch_m:2.7}}", "write `bay_pitch_m: 2.7`"),
        ("{shelves: {bay_pitch_m: }}", "`plugins.shelves.bay_pitch_m`: it has no value"),
        ("{shelves: {threshold: }}", "`plugins.shelves.threshold`: it has no value"),
        ("{shelves: {bay_pitch_m: {values: }}}", "unknown key `plugins.shelves.bay_pitch_m.values`"),
        ("{shelves: {every: 1:30}}", "`plugins.shelves.every`: a plain number is expected: write 90 (it is '1:30')"),
        ("{shelves: false}", "`plugins.shelves`: a section with keys is expected (it is False)"),
    ],
)
@pytest.mark.parametrize("of_row", [False, True])
def test_settings_of_plugins(tmp_path: Path, plugins: str, expected: str, of_row: bool) -> None:
    at = ("rows", "A", "plugins") if of_row else ("plugins",)
    expected = expected.replace("`plugins.", "`rows.A.plugins.") if of_row else expected
    lines = said(written(tmp_path, at, plugins))
    assert any("site.yaml:2: " in line and expected in line for line in lines), lines


def test_a_plugin_needs_no_settings(tmp_path: Path) -> None:
    assert said(written(tmp_path, ("plugins",), "{shelves: }")) == []


@pytest.mark.parametrize("at", KEYS)
def test_null_in_words_is_as_good_as_left_out(tmp_path: Path, at: Location) -> None:
    keys = [key for key, field in fields_of(SECTIONS[at]).items() if not field.is_required()]
    lines = said(written(tmp_path, at, f"{{{', '.join(f'{key}: null' for key in keys)}}}"))
    assert not any("no value" in line for line in lines), lines


@pytest.mark.parametrize(
    ("text", "line", "expected"),
    [
        (
            "rows:\n  A:\n    passes:\n      - video: a.mp4\n        side:right\n        start_s: 2\n",
            5,
            "write `side: right`",
        ),
        ("rows:\n  A:\n    passes:\n      - video: a.mp4\n        side\uff1aright\n", 5, "write `side: right`"),
        ("fps:5\nrows: {A: {passes: [{video: a.mp4}]}}\n", 1, "write `fps: 5`"),
        ("references:\n  travel_m:12\nrows: {A: {passes: [{video: a.mp4}]}}\n", 1, "write `travel_m: 12`"),
        ("rows:\n  A:\n    passes:\n      - video:a.mp4\n", 4, "write `video: a.mp4`"),
    ],
)
def test_lines_without_the_space(tmp_path: Path, text: str, line: int, expected: str) -> None:
    path = tmp_path / "site.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(SiteError) as caught:
        load_site(path)
    assert str(caught.value).startswith(f"{path}:{line}: ")
    assert expected in str(caught.value)


@pytest.mark.parametrize(
    ("at", "section", "expected"),
    [
        ((), "{fps: yes}", "`fps`: a number is expected (it is 'yes')"),
        (("rows", "A", "passes"), "[{video: a.mp4, start_s: 1:30}]", "`rows.A.passes[0].start_s`: a plain number is expected: write 90"),
        (("rows", "A", "passes"), "[{video: a.mp4, end_s: 1:00:02.5}]", "a plain number is expected: write 3602.5"),
        (("layout",), "{aisle_m: 3, rack_m: 2, rows: [true]}", "text is expected: put it in quotation marks (it is True)"),
        (("layout",), "{aisle_m: 3, rack_m: 2, rows: [010]}", "text is expected: put it in quotation marks (it is 10)"),
    ],
)  # fmt: skip
def test_words_and_numbers_in_one_anothers_place(tmp_path: Path, at: Location, section: str, expected: str) -> None:
    lines = said(written(tmp_path, at, section))
    assert any("site.yaml:2: " in line and expected in line for line in lines), lines


def test_numbers_are_read_as_people_read_them(tmp_path: Path) -> None:
    path = tmp_path / "site.yaml"
    path.write_text("fps: 015\nplugin_timeout_s: 1_000\njoint: off\nrows: {A: {passes: [{video: a.mp4}]}}\n")
    site = load_site(path)
    assert (site.fps, site.plugin_timeout_s, site.joint) == (15, 1000, False)


def test_names_stay_as_they_are_written(tmp_path: Path) -> None:
    path = tmp_path / "site.yaml"
    path.write_text(
        "rows: {010: {passes: [{video: a.mp4}]}, 1:30: {passes: [{video: b.mp4}]}}\n"
        "layout: {aisle_m: 3, rack_m: 2, length_m: 9, rows: [1:30, '010'], lengths_m: {010: 8}}\n"
    )
    site = load_site(path)
    assert site.layout is not None
    assert (site.layout.rows, dict(site.layout.lengths_m)) == (("1:30", "010"), {"010": 8})


def test_an_override_is_read_as_the_file_is(tmp_path: Path) -> None:
    from savmap.site.overrides import overrides_of

    path = written(tmp_path, (), "{fps: }")
    assert load_site(path, overrides_of(["fps=5"], {})).fps == 5
    with pytest.raises(SiteError, match="--set fps: `fps`: a plain number is expected: write 90"):
        load_site(path, overrides_of(["fps=1:30"], {}))


def test_empty_sections_are_noted_when_mapping(tmp_path: Path) -> None:
    job = job_for(written(tmp_path, (), "{references: , calibration: }"), ["shelves"], tmp_path / "out")
    assert [note.partition(": ")[2] for note in job.notes] == [
        "`references` has no value, and is as good as left out",
        "`calibration` has no value, and is as good as left out",
    ]


def test_an_alignment_of_its_own(tmp_path: Path) -> None:
    path = tmp_path / "align.yaml"
    for text, expected in (
        ("{x_m:1, y_m: 2}", "write `x_m: 1`"),
        ("{x_m: , y_m: 2}", "`x_m`: it has no value"),
        (
            "align: {x_m: 1,5, y_m: 2, heading_deg: 1}",
            "unknown key `align.5`: is it from a number with a decimal comma?",
        ),
    ):
        path.write_text(text)
        with pytest.raises(SiteError, match=r"align.yaml:1: ") as caught:
            load_alignment(path)
        assert expected in str(caught.value)
