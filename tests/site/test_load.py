"""Site files: what is good is read, what is bad gives one line with file, line and remedy."""

from pathlib import Path

import pytest

from savmap.errors import SiteError
from savmap.graph import Calibration, KnownMarker, LensDistance, Shutter, Stitching, VerticalScale
from savmap.site.load import load_alignment, load_site
from savmap.site.model import Site
from savmap.site.references import calibration_of, misnamed, references_of
from savmap.site.sections import Length, ReferenceSection

from ..video.made_up_video import write_recording

GOOD = """\
plugins:
  shelves: {threshold: 0.4}
references:
  camera_height_m: {value: 3.0, sigma: 0.02}
rows:
  A:
    passes:
      - {video: a.mp4, side: left}
    references:
      travel_m: 12
"""


def write(folder: Path, text: str) -> Path:
    path = folder / "site.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def test_paths_are_taken_from_the_files_folder(tmp_path: Path) -> None:
    site = load_site(write(tmp_path, GOOD))
    assert site.rows["A"].passes[0].video == tmp_path / "a.mp4"


def test_a_row_overrides_the_site(tmp_path: Path) -> None:
    references = load_site(write(tmp_path, GOOD)).row_references("A")
    assert references.travel_m == 12
    assert references.camera_height_m is not None
    assert references.camera_height_m.value == 3.0


def test_markers_become_references(tmp_path: Path) -> None:
    site = load_site(
        write(tmp_path, GOOD.replace("rows:", "  markers: [{dictionary: tag36h11, id: 7, size_m: 0.2}]\nrows:"))
    )
    assert references_of(site.row_references("A")).markers == (KnownMarker("tag36h11", 7, 0.2, 0.0005),)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(SiteError, match="no such site file"):
        load_site(tmp_path / "none.yaml")


@pytest.mark.parametrize(
    ("extra", "expected"),
    [
        ({}, [["A", "B"], ["C"]]),
        ({"joint": False}, [["A"], ["B"], ["C"]]),
    ],
)
def test_rows_of_one_drive_stand_together(extra: dict[str, object], expected: list[list[str]]) -> None:
    rows = {
        "A": {"passes": [{"video": "one.mp4", "side": "left"}]},
        "B": {"passes": [{"video": "two.mp4"}, {"video": "one.mp4", "side": "right"}]},
        "C": {"passes": [{"video": "one.mp4", "fps": 5.0}]},
    }
    assert Site.model_validate({"rows": rows, **extra}).joint_groups() == expected


def test_a_pass_may_join_rows_that_share_none_themselves() -> None:
    passes = {"A": ["one.mp4"], "B": ["two.mp4"], "C": ["two.mp4", "one.mp4"]}
    rows = {name: {"passes": [{"video": video} for video in videos]} for name, videos in passes.items()}
    assert Site.model_validate({"rows": rows}).joint_groups() == [["A", "B", "C"]]


def test_nothing_of_the_camera_is_estimated_unless_asked_for(tmp_path: Path) -> None:
    assert calibration_of(load_site(write(tmp_path, GOOD)).calibration) is None
    off = GOOD + "calibration: {panorama: false, rolling_shutter: false}\n"
    assert calibration_of(load_site(write(tmp_path, off)).calibration) is None


def test_what_of_the_camera_is_estimated(tmp_path: Path) -> None:
    usual = load_site(write(tmp_path, GOOD + "calibration: {panorama: true, rolling_shutter: true}\n")).calibration
    assert calibration_of(usual) == Calibration(Stitching(), Shutter())
    cropped = load_site(write(tmp_path, GOOD + "calibration: {vertical_scale: true}\n")).calibration
    assert calibration_of(cropped) == Calibration(vertical=VerticalScale())
    lenses = load_site(write(tmp_path, GOOD + "calibration: {lens_distance: true}\n")).calibration
    assert calibration_of(lenses) == Calibration(lens_distance=LensDistance())
    given = """\
calibration:
  panorama: {turn_sigma_deg: 2.0, scale_sigma: 0.01, blend_deg: 3}
  vertical_scale: {sigma: 0.05}
  lens_distance: {sigma_m: 0.02}
  rolling_shutter: {sigma_s: 0.03, axis: columns}
  front_deg: 90
"""
    section = load_site(write(tmp_path, GOOD + given)).calibration
    assert calibration_of(section) == Calibration(
        Stitching(2.0, 0.01, 3.0), Shutter(0.03, "columns"), 90.0, VerticalScale(0.05), LensDistance(0.02)
    )


NAMES = ["012", "010", "1:30", "0x1F", "1_000", "1.10", "no", "on", "true", "~", "8", "2021-02-30"]


def test_rows_are_called_as_they_are_written(tmp_path: Path) -> None:
    """YAML takes some of these for numbers, truth and nothing: aisle 010 became row 8, and replaced the row of that name."""
    rows = "".join(f"  {name}: {{passes: [{{video: a.mp4}}]}}\n" for name in NAMES)
    layout = "layout: {aisle_m: 3, rack_m: 2, length_m: 9, rows: [1:30, '010', no], lengths_m: {010: 8}}\n"
    site = load_site(write(tmp_path, f"{layout}rows:\n{rows}"))
    assert list(site.rows) == NAMES
    assert site.layout is not None
    assert (site.layout.rows, dict(site.layout.lengths_m)) == (("1:30", "010", "no"), {"010": 8})


def test_numbers_are_read_as_people_read_them(tmp_path: Path) -> None:
    site = load_site(write(tmp_path, "fps: 015\nplugin_timeout_s: 1_000\njoint: off\n" + GOOD))
    assert (site.fps, site.plugin_timeout_s, site.joint) == (15, 1000, False)


@pytest.mark.parametrize(
    ("between", "axis", "in_order"),
    [
        (("upright 5 / right", "upright 1 / left"), "x", ("upright 1 / left", "upright 5 / right")),
        (("upright 1 / left", "upright 5 / right"), "x", ("upright 1 / left", "upright 5 / right")),
        (("upright 2 / right", "upright 2 / left"), "x", ("upright 2 / left", "upright 2 / right")),
        (
            ("section 2 / beam 3 / upper", "section 2 / beam 1 / lower"),
            "y",
            ("section 2 / beam 1 / lower", "section 2 / beam 3 / upper"),
        ),
        (
            ("section 2 / beam 3 / upper", "section 1 / beam 4 / lower"),
            "y",
            ("section 2 / beam 3 / upper", "section 1 / beam 4 / lower"),
        ),
        (("sign 3 / upper left", "upright 1 / left"), "x", ("sign 3 / upper left", "upright 1 / left")),
    ],
)
def test_a_length_has_no_direction(between: tuple[str, str], axis: str, in_order: tuple[str, str]) -> None:
    length = Length.model_validate({"between": between, "value": 1.0, "sigma": 0.01, "axis": axis})
    assert length.in_order == in_order


def test_networks_are_taken_from_the_files_folder(tmp_path: Path) -> None:
    own = GOOD + "    plugins: {shelves: {model: /nets/own.onnx}}\n"
    site = load_site(write(tmp_path, own.replace("threshold: 0.4", "model: nets/all.onnx")))
    assert site.plugins["shelves"]["model"] == str(tmp_path / "nets" / "all.onnx")
    assert site.plugin_config("A", "shelves")["model"] == "/nets/own.onnx"


def test_urls_stay_as_they_are(tmp_path: Path) -> None:
    text = GOOD.replace("a.mp4", "memory://drives/a.mp4").replace("rows:", "survey: file:///s/survey.json\nrows:")
    site = load_site(write(tmp_path, text))
    assert str(site.rows["A"].passes[0].video) == "memory://drives/a.mp4"
    assert site.survey == Path("/s/survey.json")
    assert '"memory://drives/a.mp4"' in site.model_dump_json()


def test_sections_without_values_are_as_good_as_left_out(tmp_path: Path) -> None:
    text = GOOD.replace("  shelves: {threshold: 0.4}\n", "").replace("      travel_m: 12\n", "")
    site = load_site(write(tmp_path, text + "calibration:\nlayout:\nviews:\n"))
    assert site.plugins == {}
    assert site.row_references("A").travel_m is None


@pytest.mark.parametrize(
    ("name", "text", "says"),
    [
        ("map.json", '{"aligned": {}, "format": "savmap-map", "t": "' + 12880 * "A" + '"}', "is a map, not a site file"),
        ("map.json", '{"format": "savmap-map", "t": "' + 3_000_000 * "A" + '"}', "is a map, not a site file"),
        ("run.json", '{"format": "savmap-run"}', "is the record of a run, not a site file"),
        ("README.md", "# Title\n\n> words: `a`: b\n* [x](y): {z\n", "is neither a site file (YAML, see docs/site-file.md) nor a video (line "),
        ("README.md", "Just words.\n", "nor a video (a site file is a mapping with at least `rows:`"),
        ("notes.doc", "\udcff\udcd8", "nor a video (cannot be read as a site file: it is not a text file (byte 0 is not UTF-8))"),
        ("site.yaml", "Just words.\n", "a site file is a mapping with at least `rows:`"),
    ],
)  # fmt: skip
def test_another_file_is_called_what_it_is(tmp_path: Path, name: str, text: str, says: str) -> None:
    path = tmp_path / name
    path.write_bytes(text.encode(errors="surrogateescape"))
    with pytest.raises(SiteError) as caught:
        load_site(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert says in message
    assert "\n" not in message


@pytest.mark.parametrize("name", ["aisle.mp4", "aisle", "site.yaml"])
@pytest.mark.parametrize("lenses", [1, 2])
def test_a_video_is_called_one_whatever_its_name(tmp_path: Path, name: str, lenses: int) -> None:
    write_recording(tmp_path / "a.mkv", 5, lenses=lenses).rename(tmp_path / name)
    with pytest.raises(SiteError, match="is a video, not a site file; `savmap init` writes one for it"):
        load_site(tmp_path / name)


def test_a_resolved_site_is_a_site_file(tmp_path: Path) -> None:
    path = tmp_path / "site.resolved.json"
    path.write_text('{"format": "savmap-site", "rows": {"A": {"passes": [{"video": "a.mp4"}]}}}')
    assert list(load_site(path).rows) == ["A"]


def test_a_map_says_not_where_the_site_stands(tmp_path: Path) -> None:
    path = tmp_path / "map.json"
    path.write_text('{"format": "savmap-map"}')
    with pytest.raises(SiteError, match=r"is a map, not a file with `align:`$"):
        load_alignment(path)


@pytest.mark.parametrize("name", ["post 3 / left", "post 10", "marker tag36h11 7 / corner 1"])
def test_names_that_plugins_have_are_not_refused(name: str) -> None:
    section = ReferenceSection.model_validate({"points": [{"vertex": name, "axis": "x", "value": 1, "sigma": 0.1}]})
    assert not list(misnamed(section, ("post #", "post # / left")))


def test_names_that_no_plugin_has_are_told_with_the_nearest() -> None:
    content = {"lengths": [{"between": ["post 3 / lef", "quoin"], "value": 1, "sigma": 0.1}]}
    first, second = misnamed(ReferenceSection.model_validate(content), ("post #", "post # / left"))
    assert first == (("lengths", 0, "between", 0), "nothing is called `post 3 / lef`: did you mean `post 3 / left`?")
    assert second == (
        ("lengths", 0, "between", 1),
        "nothing is called `quoin`: known are post #, post # / left (#: a number)",
    )
