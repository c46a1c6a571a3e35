"""Values of a wrong kind in a site file: each is told in a user's words, at its key, without names of the program's parts."""

import re
from pathlib import Path
from typing import Any

import pytest
import yaml

from savmap.errors import SiteError
from savmap.site.job import chosen_plugins
from savmap.site.load import load_alignment, load_site, problems_in, read_draft, site_of
from savmap.site.model import Pass, Row, Site
from savmap.site.preflight import settings_problems
from savmap.site.references import references_of
from savmap.site.sections import AlignSection, CalibrationSection, LayoutSection, PlaceSection, ReferenceSection

ROWS = "\nrows: {A: {passes: [{video: a.mp4}]}}\n"
WRONG: tuple[Any, ...] = ("abc", "3,055", -1e9, True, [1, 2], ["a"], [[1]], [{"x": 1}], {"x": 1})
INTERNAL = re.compile(
    r"pydantic|constrained|function-|tuple|nullable|instance of|<class|Section|valid dictionary|parse|interpret"
)
SECTIONS = {
    (): Site,
    ("references",): ReferenceSection,
    ("layout",): LayoutSection,
    ("align",): AlignSection,
    ("calibration",): CalibrationSection,
    ("rows", "A"): Row,
    ("rows", "A", "passes", 0): Pass,
    ("rows", "A", "place"): PlaceSection,
}
ONES: dict[tuple[str, str], list[dict[str, Any]]] = {
    ("references", "lengths"): [{"between": ["a", "b"], "value": 1, "sigma": 0.1}],
    ("references", "points"): [{"vertex": "a", "axis": "x", "value": 1, "sigma": 0.1}],
    ("references", "markers"): [{"dictionary": "tag36h11", "id": 1, "size_m": 0.2}],
    ("align", "points"): 2 * [{"row": "A", "at": "u", "world_m": [1, 2]}],
    ("align", "lines"): [{"through": ["u"], "world_m": [[0, 0], [1, 1]]}],
}


def lines_of(tmp_path: Path, text: str) -> list[str]:
    path = tmp_path / "site.yaml"
    path.write_text(text, encoding="utf-8")
    draft = read_draft(path)
    wrong = [line for _, line in problems_in(draft)]
    if wrong:
        return wrong
    site = site_of(draft)
    return [str(problem) for problem in settings_problems(site, chosen_plugins(site, None)[0], draft.places)]


def content_with(location: tuple[Any, ...], value: Any) -> dict[str, Any]:
    content: dict[str, Any] = {"rows": {"A": {"passes": [{"video": "a.mp4"}]}}}
    inside: Any = content
    for key in location[:-1]:
        inside = inside[key] if isinstance(inside, list) else inside.setdefault(key, {})
    inside[location[-1]] = value
    return content


@pytest.mark.parametrize("location", SECTIONS)
def test_no_message_names_parts_of_the_program(tmp_path: Path, location: tuple[Any, ...]) -> None:
    for key in SECTIONS[location].model_fields:
        for value in WRONG:
            for line in lines_of(tmp_path, yaml.safe_dump(content_with((*location, key), value))):
                assert not INTERNAL.search(line), line


@pytest.mark.parametrize("location", ONES)
def test_nor_does_one_about_an_entry_of_a_list(tmp_path: Path, location: tuple[str, str]) -> None:
    for key in ONES[location][0]:
        for value in WRONG:
            changed = [{**ONES[location][0], key: value}, *ONES[location][1:]]
            for line in lines_of(tmp_path, yaml.safe_dump(content_with(location, changed))):
                assert not INTERNAL.search(line), line


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("references:\n  camera_height_m: 3,055", "site.yaml:2: `references.camera_height_m.value`: a decimal point is expected: 3.055"),
        ("references:\n  camera_height_m: {value: 2,5}", "site.yaml:2: unknown key `references.camera_height_m.5`: is it from a number with a decimal comma"),
        ("layout: {aisle_m: 3, rack_m: 2, lengths_m: {3: 11}}", "site.yaml:1: `layout.lengths_m.3`: there is no row `3`; the site's rows are A"),
        ("references: {camera_height_m: {value: yes}}", "site.yaml:1: `references.camera_height_m.value`: a number is expected"),
        ("fps: true", "`fps`: a number is expected"),
        ("references:\n  lengths: [{between: [a, b], value: -14.1, sigma: 0.01}]", "site.yaml:2: `references.lengths[0].value`: input should be greater than 0"),
        ("references:\n  lengths: [{between: [a, a], value: 14.1, sigma: 0.01}]", "`references.lengths[0].between`: two different edges are expected, not twice a"),
        ("fps: 2,5", "site.yaml:1: `fps`: a decimal point is expected: 2.5"),
        ("references:\n  camera_height_m: [1, 2]", "a section with keys is expected: value, sigma (it is [1, 2])"),
        ("references: {markers: [{dictionary: abc, id: 7, size_m: 0.2}]}", "tag16h5, tag25h9, tag36h10, tag36h11, or 4x4_50 to 7x7_1000 is expected (it is 'abc')"),
        ("align:\n  points:\n  - {at: a, world_m: [1, 2, a]}\n  - {at: b, world_m: [1]}", "site.yaml:3: `align.points[0].world_m[2]`: a number is expected"),
        ("align:\n  points:\n  - {at: a, world_m: [1, 2, 3, 4]}\n  - {at: b, world_m: [1, 2]}", "`align.points[0].world_m`: at most 3 entries are expected"),
        ("plugins:\n  shelves:\n    bay_pitch_m: 2,7", "site.yaml:3: `plugins.shelves.bay_pitch_m`: a decimal point is expected: 2.7"),
        ("plugins:\n  shelves:\n    lowest_beam_bottom_height_m: [0.3, a]", "`plugins.shelves.lowest_beam_bottom_height_m.values[1]`: a number is expected"),
        ("plugins:\n  shelves:\n    lowest_beam_bottom_height_m: 28.2", "less than 10 (it is 28.2; lengths are metres"),
        ("plugins:\n  shelves:\n    lowest_beam_bottom_height_m: 0,3", "a decimal point is expected: 0.3"),
    ],
)  # fmt: skip
def test_a_wrong_kind_is_told_with_what_is_expected(tmp_path: Path, text: str, expected: str) -> None:
    assert expected in lines_of(tmp_path, text + ROWS)[0]


def test_the_cameras_height_may_stand_alone(tmp_path: Path) -> None:
    path = tmp_path / "site.yaml"
    path.write_text("references: {camera_height_m: 3.055}" + ROWS)
    (height,) = references_of(load_site(path).row_references("A")).camera_heights
    assert (height.value_m, height.sigma_m) == (3.055, 0.02)


@pytest.mark.parametrize("value", ["3", "abc", "[1, 2]", "true"])
def test_a_section_alone_in_its_file_is_told_too(tmp_path: Path, value: str) -> None:
    (tmp_path / "align.yaml").write_text(f"align: {value}\n")
    with pytest.raises(SiteError, match=r"align.yaml:1: `align`: a section with keys is expected"):
        load_alignment(tmp_path / "align.yaml")
