"""Site files that are wrong: each mistake is one line that says file, line, key and remedy in a user's words, at once."""

import json
import os
import re
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from pydantic import BaseModel

from savmap.errors import SiteError
from savmap.files.validation import annotations_at, fields_of, is_model
from savmap.lab.scenes import SceneError
from savmap.lab.sim.scene.files import load_scene
from savmap.site.job import chosen_plugins, job_for
from savmap.site.load import load_alignment, load_site, notes_on, problems_in, read_draft, site_of
from savmap.site.model import Site
from savmap.site.overrides import overrides_of
from savmap.site.preflight import settings_problems

ROWS = {"A": {"passes": [{"video": "a.mp4"}]}}
AFTER = "\nrows: {A: {passes: [{video: a.mp4}]}}\n"
HERE = "<here>"
Location = tuple[Any, ...]
WRONG: tuple[Any, ...] = ("abc", "3,055", -1e9, True, [1, 2], ["a"], [[1]], [{"x": 1}], {"x": 1})
INTERNAL = re.compile(
    r"pydantic|constrained|function-|tuple|nullable|instance of|<class|Section|valid dictionary|parse|interpret"
)


def said(path: Path) -> list[str]:
    """All that is said of a site file."""
    try:
        draft = read_draft(path)
    except SiteError as error:
        return [str(error)]
    wrong = [line for _, line in problems_in(draft)]
    if not wrong:
        site = site_of(draft)
        wrong = [*map(str, settings_problems(site, chosen_plugins(site, None)[0], draft.places))]
    return [*wrong, *notes_on(draft)]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        # no YAML, or too much of it
        ("rows: {A: x}\ncalibration: [1", "site.yaml:2: not valid YAML"),
        ("rows:\n\tA: 1\n", "site.yaml:2: not valid YAML: found character '\\t' that cannot start any token; if it is a tab, put spaces"),
        ("rows: {A: x}\n- 1\n", "site.yaml:2: not valid YAML"),
        ('rows:\n  "\\ud800": {passes: [{video: a.mp4}]}\n', "site.yaml:2: not valid YAML: a text holds half a character"),
        ("fps: .inf", "site.yaml:1: not valid YAML: .inf is not a finite number"),
        ("fps: !!float abc", "site.yaml:1: not valid YAML: 'abc' is no float"),
        (f"fps: {'1' * 3000}", "site.yaml:1: not valid YAML: 11111111111111111111 is not a finite number"),
        ("rows: " + 900 * "[" + 900 * "]", "site.yaml: not valid YAML: it is nested too deeply"),
        ("# x\n" * 1_000_000, "is larger than 2 MB"),
        # keys
        ("row: {}", "site.yaml:1: unknown key `row`: did you mean `rows`?"),
        ("references: {camera_height_mm: 3}", "site.yaml:1: unknown key `references.camera_height_mm`: wrong unit? Use `camera_height_m`"),
        ("calibration: {panorama: {turn_sigma: 1}}", "unknown key `calibration.panorama.turn_sigma`: did you mean `turn_sigma_deg`?"),
        ("references: {markers: [{dictionary: tag36h11, id: 7, size_mm: 200}]}", "wrong unit? Use `size_m`"),
        ("references:\n  camera_height_m: {value: 2,5}", "site.yaml:2: unknown key `references.camera_height_m.5`: is it from a number with a decimal comma"),
        ("rows:\n  A: {passes: [{video: a.mp4}]}\n  8: {passes: [{video: b.mp4}]}\n  '8': {}\n", "site.yaml:4: `rows.8` is given twice, first in line 3"),
        ("layout: {aisle_m: 3, rack_m: 2, lengths_m: {3: 11}}", "site.yaml:1: `layout.lengths_m.3`: there is no row `3`; the site's rows are A"),
        # names and paths
        ('rows: {"..": {passes: [{video: a.mp4}]}}', "a row's name is more than dots and blanks"),
        (f"rows: {{{'ü' * 30}: {{passes: [{{video: a.mp4}}]}}}}", "at most 100 letters"),
        ('rows: {"\\e[31mred": {passes: [{video: a.mp4}]}}', "a row's name holds no control characters"),
        ("survey: " + "a/" * 1900, "a path is too long"),
        ('survey: "a\\0b"', "a path holds a control character"),
        ('survey: "D:\\video"', "site.yaml:1: not valid YAML: in double quotation marks a backslash and what follows it are one character"),
        ('survey: "C:\\Users"', "site.yaml:1: not valid YAML: in double quotation marks a backslash and what follows it are one character"),
        ('survey: "C:\\Projekte"', "site.yaml:1: not valid YAML: in double quotation marks a backslash and what follows it are one character"),
        ('survey: "a\\new"', "a path holds a control character (a backslash in double quotation marks may make one)"),
        ("survey: ''", "a path is expected, not an empty text"),
        # values
        ("rows:\n  A:\n    passes:\n      - {video: a.mp4, side: up}\n", "site.yaml:4: `rows.A.passes[0].side`: input should be 'left' or 'right'"),
        ("fps: true", "site.yaml:1: `fps`: a number is expected (it is True)"),
        ("fps: yes", "`fps`: a number is expected (it is 'yes')"),
        ("fps: 2,5", "site.yaml:1: `fps`: a decimal point is expected: 2.5"),
        ("fps: 1,234", "`fps`: a decimal point is expected: 1.234 or 1234 (it is '1,234')"),
        ("fps: 1,234.5", "`fps`: a decimal point is expected: 1234.5 (it is '1,234.5')"),
        ("fps: 1.234,5", "`fps`: a decimal point is expected: 1234.5"),
        ("fps: 1 234,5", "`fps`: a decimal point is expected: 1234.5"),
        ("fps: 1'234.5", "`fps`: a decimal point is expected: 1234.5"),
        ("fps: 1\u202f234,5", "`fps`: a decimal point is expected: 1234.5"),
        ("plugins:\n  shelves:\n    lowest_beam_bottom_height_m: [0,3, 0,2]", "site.yaml:3: not valid YAML: 0,3 are two numbers: write 0.3, or a space behind the comma"),
        ("plugin_timeout_s: 1:30", "`plugin_timeout_s`: a number is expected (it is '1:30')"),
        ("layout: {aisle_m: 3, rack_m: 2, rows: [true]}", "text is expected: put it in quotation marks (it is True)"),
        ("layout: {aisle_m: 3, rack_m: 2, rows: [010]}", "text is expected: put it in quotation marks (it is 10)"),
        ("references:\n  camera_height_m: 3,055", "site.yaml:2: `references.camera_height_m.value`: a decimal point is expected: 3.055"),
        ("references: {camera_height_m: {value: 3000}}", "`references.camera_height_m.value`: input should be less than 50 (it is 3000; lengths are metres"),
        ("references:\n  camera_height_m: [1, 2]", "a section with keys is expected: value, sigma (it is [1, 2])"),
        ("references:\n  lengths: [{between: [a, b], value: -14.1, sigma: 0.01}]", "site.yaml:2: `references.lengths[0].value`: input should be greater than 0"),
        ("references:\n  lengths: [{between: [a, a], value: 14.1, sigma: 0.01}]", "`references.lengths[0].between`: two different edges are expected, not twice a"),
        ("references: {markers: [{dictionary: abc, id: 7, size_m: 0.2}]}", "tag16h5, tag25h9, tag36h10, tag36h11, or 4x4_50 to 7x7_1000 is expected (it is 'abc')"),
        ("references: {markers: [{dictionary: tag36h11, id: 7, size_m: 0.2}, {dictionary: tag36h11, id: 7, size_m: 0.3}]}", "given twice"),
        ("calibration: {rolling_shutter: fast}", "`calibration.rolling_shutter`: a section with keys is expected"),
        ("align:\n  points:\n  - {at: a, world_m: [1, 2, a]}\n  - {at: b, world_m: [1]}", "site.yaml:3: `align.points[0].world_m[2]`: a number is expected"),
        ("align:\n  points:\n  - {at: a, world_m: [1, 2, 3, 4]}\n  - {at: b, world_m: [1, 2]}", "`align.points[0].world_m`: at most 3 entries are expected"),
        # defaults of passes, and plugins' settings
        ("views: {face: {yaw_deg: 0, hfov_deg: 500}}", "site.yaml:1: `views.face.hfov_deg`"),
        ("rows:\n  A:\n    fps: 0\n    passes: [{video: a.mp4}]\n", "site.yaml:3: `rows.A.fps`: input should be greater than 0"),
        ("plugins:\n  shelves:\n    bay_pitch_m: 2,7", "site.yaml:3: `plugins.shelves.bay_pitch_m`: a decimal point is expected: 2.7"),
        ("plugins:\n  shelves:\n    lowest_beam_bottom_height_m: [0.3, a]", "`plugins.shelves.lowest_beam_bottom_height_m.values[1]`: a number is expected"),
        ("plugins:\n  shelves:\n    lowest_beam_bottom_height_m: 28.2", "less than 10 (it is 28.2; lengths are metres"),
        # a colon without its space
        ("rows:\n  A:\n    passes:\n      - video: a.mp4\n        side:right\n        start_s: 2\n", "site.yaml:5: not valid YAML: a colon and a space stand between a key and its value: write `side: right`"),
        ("rows:\n  A:\n    passes:\n      - video: a.mp4\n        side\uff1aright\n", "site.yaml:5: not valid YAML: a colon and a space stand between a key and its value: write `side: right`"),
        ("rows:\n  A:\n    passes:\n      - video:a.mp4\n", "site.yaml:4: `rows.A.passes[0]`: a colon and a space stand between a key and its value: write `video: a.mp4`"),
        ("layout: {aisle_m: 3, rack_m: 2, lengths_m: {A:2}}", "site.yaml:1: `layout.lengths_m.A:2`: a colon and a space stand between a key and its value: write `A: 2`"),
    ],
    ids=lambda text: text[-60:],
)  # fmt: skip
def test_a_mistake_is_one_line(tmp_path: Path, text: str, expected: str) -> None:
    path = tmp_path / "site.yaml"
    path.write_text(text if "row" in text[:8] else text + AFTER, encoding="utf-8")
    begin = time.process_time()
    lines = said(path)
    assert any(expected in line for line in lines), lines
    assert all(line.startswith(str(path)) and "\n" not in line and len(line) < 500 for line in lines)
    assert time.process_time() - begin < 60  # no pattern that takes for ever


def test_what_is_wrong_is_shown_in_short(tmp_path: Path) -> None:
    deep = "".join(f"  a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 4)}]\n" for n in range(1, 7))
    (tmp_path / "site.yaml").write_text(f"x:\n  a0: &a0 0\n{deep}fps: *a6{AFTER}")
    assert max(map(len, said(tmp_path / "site.yaml"))) < 500


def sections(model: type[BaseModel], at: Location = ()) -> Iterator[tuple[Location, type[BaseModel]]]:
    """Every section that the model may hold, one entry of each list and mapping: its location and its model."""
    yield at, model
    for key in fields_of(model):
        for part in ((), ("A",), (0,)):
            inner = [kind for kind in annotations_at(model, (key, *part)) if is_model(kind)]
            for kind in inner:
                yield from sections(kind, (*at, key, *part))
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


def missed(lines: list[str], expected: list[str]) -> list[str]:
    """What no line about line 2 of the file says."""
    return [text for text in expected if not any("site.yaml:2: " in line and text in line for line in lines)]


def test_all_levels_are_tried() -> None:
    assert len(SECTIONS) > 20
    assert {(), ("rows", "A", "passes", 0), ("references", "lengths", 0), ("align", "anchor")} <= set(SECTIONS)


@pytest.mark.parametrize("at", KEYS)
def test_keys_at_every_level(tmp_path: Path, at: Location) -> None:
    """That run into their values, that are unknown, that have no value, and that are null."""
    keys = KEYS[at]
    for colon in (":", "\uff1a", "\uff1a "):
        lines = said(written(tmp_path, at, f"{{{', '.join(f'{key}{colon}right' for key in keys)}}}"))
        assert not missed(lines, [f"write `{key}: right`" for key in keys])
    lines = said(written(tmp_path, at, f"{{{', '.join(f'{key}x: ' for key in keys)}}}"))
    assert not missed([line for line in lines if "unknown key" in line], [f"{key}x`" for key in keys])
    given = [key for key in keys if key != "rows"]
    lines = said(written(tmp_path, at, f"{{{', '.join(f'{key}: ' for key in given)}}}"))
    assert not missed([line for line in lines if "no value" in line], [f"{key}`" for key in given])
    optional = [key for key, field in fields_of(SECTIONS[at]).items() if not field.is_required()]
    lines = said(written(tmp_path, at, f"{{{', '.join(f'{key}: null' for key in optional)}}}"))
    assert not any("no value" in line for line in lines), lines


@pytest.mark.parametrize("at", KEYS)
def test_no_message_names_parts_of_the_program(tmp_path: Path, at: Location) -> None:
    for key in KEYS[at]:
        for value in WRONG:
            for line in said(written(tmp_path, at, json.dumps({key: value}))):
                assert not INTERNAL.search(line), line


@pytest.mark.parametrize(
    ("plugins", "expected"),
    [
        ("{shelves: {bay_pitch_m:2.7}}", "write `bay_pitch_m: 2.7`"),
        ("{shelves: {bay_pitch_m: }}", "`plugins.shelves.bay_pitch_m`: it has no value"),
        ("{shelves: {bay_pitch_m: {values: }}}", "unknown key `plugins.shelves.bay_pitch_m.values`"),
        ("{shelves: {every: 1:30}}", "`plugins.shelves.every`: a whole number is expected (it is '1:30')"),
        ("{shelves: false}", "`plugins.shelves`: a section with keys is expected (it is False)"),
    ],
)
def test_settings_of_plugins_for_all_rows_and_for_one(tmp_path: Path, plugins: str, expected: str) -> None:
    for at, text in (
        (("plugins",), expected),
        (("rows", "A", "plugins"), expected.replace("`plugins.", "`rows.A.plugins.")),
    ):
        lines = said(written(tmp_path, at, plugins))
        assert not missed(lines, [text]), lines
    assert said(written(tmp_path, ("plugins",), "{shelves: }")) == []


def test_an_override_is_read_as_the_file_is(tmp_path: Path) -> None:
    path = written(tmp_path, (), "{fps: }")
    assert load_site(path, overrides_of(["fps=5"], {})).fps == 5
    with pytest.raises(SiteError, match="--set fps: `fps`: a number is expected"):
        load_site(path, overrides_of(["fps=1:30"], {}))


def test_empty_sections_are_noted_when_mapping(tmp_path: Path) -> None:
    job = job_for(written(tmp_path, (), "{references: , calibration: }"), ["shelves"], tmp_path / "out")
    assert [note.partition(": ")[2] for note in job.notes] == [
        "`references` has no value, and is as good as left out",
        "`calibration` has no value, and is as good as left out",
    ]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("{x_m:1, y_m: 2}", "write `x_m: 1`"),
        ("{x_m: , y_m: 2}", "`x_m`: it has no value"),
        (
            "align: {x_m: 1,5, y_m: 2, heading_deg: 1}",
            "unknown key `align.5`: is it from a number with a decimal comma?",
        ),
        ("align: 3", "`align`: a section with keys is expected"),
        ("align: [1, 2]", "`align`: a section with keys is expected"),
    ],
)
def test_an_alignment_of_its_own(tmp_path: Path, text: str, expected: str) -> None:
    (tmp_path / "align.yaml").write_text(text)
    with pytest.raises(SiteError, match=r"align.yaml:1: ") as caught:
        load_alignment(tmp_path / "align.yaml")
    assert expected in str(caught.value)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("rows: [", "scene.yaml:1: cannot be read as a scene file"),
        ("cart: {frames: 1:30}\n", "scene.yaml: cart.frames: "),
        (AFTER, "is a site file, which `savmap map` takes"),
        ("format: savmap-site\n", "is a site file, which `savmap map` takes"),
    ],
)
def test_a_broken_scene_is_one_line(tmp_path: Path, text: str, expected: str) -> None:
    path = tmp_path / "scene.yaml"
    path.write_text(text)
    with pytest.raises(SceneError) as caught:
        load_scene(path)
    assert expected in str(caught.value)
    assert "\n" not in str(caught.value)


def test_pipes_are_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "a.yaml")
    with pytest.raises(SiteError, match="is a device or a pipe, not a file"):
        load_site(tmp_path / "a.yaml")
    with pytest.raises(SceneError, match="is a device or a pipe, not a file"):
        load_scene(tmp_path / "a.yaml")
