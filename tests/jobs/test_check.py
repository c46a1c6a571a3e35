"""`savmap check`: every problem is told with its place, and what a run will take is measured."""

import re
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from savmap import demo
from savmap.errors import ModelError, PluginError, SavmapError, StructureError
from savmap.jobs import check as checking
from savmap.jobs import preview as previewing
from savmap.jobs.check import FRAMES, CheckError, ResourceEstimate, check, duration, resource_estimate
from savmap.pipeline.drive import RowWalk
from savmap.pipeline.view_plans import PassPlan
from savmap.site.job import job_for
from savmap.site.model import Pass
from savmap.site.preflight import require_ready
from savmap.types import Panorama, ViewPlan, ViewSpec
from savmap.types.progress import Monitor, NoteCollector
from savmap.video.clip import Clip, DecodeReport
from savmap.video.reader import panoramas
from savmap.vision.view_planning import PassPreview
from savmap.vision.views import Renderer

from ..video.made_up_video import evenly, write_recording, write_video
from ..video.spherical_boxes import insert, stereo

GOOD = """\
plugins:
  shelves: {}
references:
  camera_height_m: {value: 3.0}
rows:
  A:
    passes:
      - {video: a.mp4}
"""
NEEDS = ResourceEstimate(40, 100.0, 5.0, 1.0, 100.0)
SURVEY = '{"format": "savmap-survey", "version": 1, "units": "m", "rows": {"X": {}}}'


@pytest.fixture(scope="module")
def video(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_video(tmp_path_factory.mktemp("video") / "a.mp4", evenly(40, 10.0))


@pytest.fixture
def folder(tmp_path: Path, video: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a good site file; what a run will take is not measured."""
    (tmp_path / "a.mp4").symlink_to(video)
    (tmp_path / "text.mp4").write_text("not a video", encoding="utf-8")
    (tmp_path / "survey.json").write_text(SURVEY, encoding="utf-8")
    monkeypatch.setattr(checking, "resource_estimate", lambda job, footage, plans: NEEDS)
    return tmp_path


def checked(folder: Path, text: str, output: str = "out", pictures: bool = False) -> tuple[list[str], int]:
    """What is told of a site file, without the lines about networks, and the exit code."""
    (folder / "site.yaml").write_text(text, encoding="utf-8")
    notes = NoteCollector()
    try:
        problems = check(folder / "site.yaml", None, folder / output, notes, pictures=pictures)
    except SavmapError as error:
        return [str(error)], error.exit_code
    lines = [line.replace(f"{folder}/", "") for line in notes.lines]
    code = CheckError(folder / "site.yaml", problems).exit_code if problems else 0
    return [line for line in lines if not line.startswith("network of ")], code


def test_networks_are_told_with_their_kind_and_provider(folder: Path) -> None:
    (folder / "site.yaml").write_text("providers: [openvino, cpu]\n" + GOOD, encoding="utf-8")
    notes = NoteCollector()
    check(folder / "site.yaml", None, folder / "out", notes, pictures=False)
    (said,) = [line for line in notes.lines if line.startswith("network of ")]
    assert said.startswith("network of shelves: shelves.int8.onnx: semantic, 640x480, on ")


def test_nothing_wrong(folder: Path) -> None:
    before = set(folder.iterdir())
    lines, code = checked(folder, GOOD)
    assert code == 0
    assert lines[0] == "row A, pass 1: 40 frames"
    assert lines[1] == "40 frames; measuring them will take about 2 min with one worker on this machine"
    assert set(folder.iterdir()) - before == {folder / "site.yaml"}


@pytest.mark.parametrize(
    ("old", "new", "code", "line"),
    [
        ("a.mp4", "none.mp4", 4, "site.yaml:8: none.mp4: no such file or folder"),
        ("a.mp4", "text.mp4", 4, "site.yaml:8: text.mp4: not a video file"),
        (
            "a.mp4}",
            "a.mp4, start_s: 1, end_s: 9}",
            4,
            "site.yaml:8: a.mp4: 1 s to 9 s is outside the video, 3.93 s long",
        ),
        ("a.mp4}", "a.mp4, end_s: 0.2}", 7, "site.yaml:8: a.mp4: 2 frames in the range of pass 1 are too few"),
        (
            "shelves: {}",
            "shelves: {model: none.onnx}",
            6,
            "site.yaml:2: plugin `shelves`: none.onnx: no such model file",
        ),
        (
            "shelves: {}",
            "shelves: {model: text.mp4}",
            6,
            "site.yaml:2: plugin `shelves`: text.mp4: not a usable ONNX model (",
        ),
        ("shelves: {}", "shelfs: {}", 5, "site.yaml:2: unknown plugin `shelfs`: did you mean `shelves`?"),
        ("shelves: {}", "shelves: {treshold: 1}", 3, "site.yaml:2: unknown key `plugins.shelves.treshold`: did you"),
        ("  camera_height_m: {value: 3.0}", "  travel_m: 3", 8, "site.yaml:6: row A: the map's scale is not known"),
        (
            "  camera_height_m: {value: 3.0}",
            "  markers: [{dictionary: 4x4_50, id: 50, size_m: 0.2}]",
            3,
            "site.yaml:4: references.markers: 4x4_50 has the numbers 0 to 49, not 50",
        ),
        (
            "rows:",
            "  lengths:\n  - {between: [upright 1 / left, upright 5 / rigth], value: 9, sigma: 0.1}\nrows:",
            3,
            "site.yaml:6: nothing is called `upright 5 / rigth`: did you mean `upright 5 / right`?",
        ),
        (
            "rows:",
            "  points: [{vertex: bay 2 / beam 1 / lower lft, axis: y, value: 9, sigma: 0.1}]\nrows:",
            3,
            "site.yaml:5: nothing is called `bay 2 / beam 1 / lower lft`: did you mean `bay 2 / beam 1 / lower left`?",
        ),
        (
            "rows:",
            "  points: [{vertex: x, axis: y, value: 9, sigma: 0.1}]\nrows:",
            3,
            "site.yaml:5: nothing is called `x`: known are upright # / foot,",
        ),
        ("plugins:", "survey: none.json\nplugins:", 9, "site.yaml:1: none.json: cannot be read"),
        (
            "shelves: {}",
            "shelves: {lowest_beam_bottom_height_m: [0.3, 0.2], bay_pitch_m: [2.7, 2.7, 2.7]}",
            3,
            "site.yaml:2: `plugins.shelves`: `lowest_beam_bottom_height_m` and `bay_pitch_m` have one value a bay, not 2",
        ),
        ("shelves: {}", "lights: {}", 7, "site.yaml:8: row A: `lights` alone does not locate the camera"),
        (
            "plugins:",
            "survey: survey.json\nplugins:",
            3,
            "site.yaml:1: survey.json: has none of the site's rows; it has X",
        ),
    ],
)
def test_each_kind_of_problem_has_its_place_and_code(folder: Path, old: str, new: str, code: int, line: str) -> None:
    lines, found = checked(folder, GOOD.replace(old, new))
    assert found == code
    assert [one for one in lines if one.startswith(line)], lines


def test_what_a_file_says_of_its_camera_is_told(folder: Path, video: Path) -> None:
    (folder / "eyes.mp4").write_bytes(video.read_bytes())
    insert(folder / "eyes.mp4", stereo(2))
    lines, code = checked(folder, GOOD.replace("a.mp4", "eyes.mp4"))
    assert code == 4
    assert lines[0].startswith("site.yaml:8: eyes.mp4: is stereo by its metadata (left and right eye side by side)")


def test_a_survey_that_plugins_cannot_read(folder: Path) -> None:
    (folder / "survey.json").write_text(SURVEY.replace('"X": {}', '"A": {"sections": 3}'), encoding="utf-8")
    lines, code = checked(folder, "survey: survey.json\n" + GOOD)
    assert code == 9
    assert lines[0].startswith("site.yaml:1: survey.json: row A: ")


def test_everything_is_told_at_once_and_sound_rows_are_checked(folder: Path) -> None:
    more = """\
  B:
    passes:
      - {video: a.mp4, side: up, fsp: 3}
  C:
    passes: [{video: none.mp4}]
layout: {aisle_m: 3, rack_m: 2, length_m: 9, rows: [A, B, X]}
"""
    (folder / "file").touch()
    lines, code = checked(folder, GOOD + more, output="file/out")
    assert code == 3
    assert [line.split(" ")[0] for line in lines[:6]] == [
        "site.yaml:11:",
        "site.yaml:11:",
        "site.yaml:14:",
        "file/out:",
        "site.yaml:13:",
        "row",
    ]


def test_the_same_face_under_two_names_is_checked(folder: Path) -> None:
    """One line a pair; whether a row with a side is the face that one without is aimed at, only a map tells."""
    more = "  B: {passes: [{video: a.mp4}]}\n  C: {passes: [{video: a.mp4, side: left}, {video: a.mp4, side: left, fps: 8}]}\n"
    lines, code = checked(folder, GOOD + more)
    assert code == 3
    same = "site.yaml:9: rows A and B look at the same frames (A, pass 1), and neither has a `side`: one face would be mapped"
    assert lines[0].startswith(same)
    assert lines[1].startswith(
        "site.yaml:10: two passes of row C look at the same frames (C, pass 1), both to the left"
    )
    assert lines[2].startswith("row A, pass 1: 40")
    assert not any("no problem found" in line for line in lines)


def test_what_is_likely_wrong_is_asked(folder: Path) -> None:
    lengths = "  lengths:\n  - {between: [upright 1 / left, upright 9 / right], value: 14.162, sigma: 0.003}\nrows:"
    good = GOOD.replace("{value: 3.0}", "{value: 10.02}").replace("rows:", lengths)
    lines, code = checked(
        folder, good.replace("shelves: {}", "shelves: {lowest_beam_bottom_height_m: [0.3, 0.2, 4.2]}")
    )
    assert code == 0
    assert lines[0] == "site.yaml:4: is the camera 10.02 m high? 10.02 feet are 3.05 m"
    assert lines[1].startswith("site.yaml:8: row A: is a value missing? There are 3, and references name 8 bays")
    assert lines[-2].startswith("not checked, for only a map tells")
    assert lines[-1] == "site.yaml: no problem found; 2 questions above"


def test_what_concerns_all_rows_comes_first(folder: Path) -> None:
    lines, code = checked(folder, GOOD.replace("references:", "reference:"))
    assert code == 3
    assert lines[0] == "site.yaml:3: unknown key `reference`: did you mean `references`?"
    assert lines[1] == "site.yaml: the rest is checked once this is put right"


@pytest.mark.slow
def test_short_clips_are_sound_where_all_is_read(folder: Path) -> None:
    """From the fewest frames that are mapped to more than a second of them, and at the file's end."""
    rows = ""
    for suffix, codec in (
        ("mp4", "libx264"),
        ("mkv", "libx264"),
        ("ts", "libx264"),
        ("avi", "mpeg4"),
        ("webm", "libvpx-vp9"),
    ):
        for count, start_s, fps in ((5, 0.0, 15.0), (8, 0.0, 15.0), (12, 0.0, 25.0), (20, 0.0, 15.0), (40, 1.35, 25.0)):
            path = write_recording(folder / f"{count}.{suffix}", count, codec)
            rows += f"  {path.name}: {{passes: [{{video: {path.name}, start_s: {start_s}, fps: {fps}}}]}}\n"
            report = DecodeReport()
            assert len(list(panoramas(Clip(path, start_s or None, fps=fps), report=report))) >= 3
            assert report.complete
    lines, code = checked(folder, GOOD + rows)
    assert code == 0, lines


@pytest.mark.parametrize("share", [0.3, 0.5])
def test_a_file_that_is_cut_off_is_short_for_both(folder: Path, share: float) -> None:
    whole = write_recording(folder / "b.mkv", 75).read_bytes()
    (folder / "b.mkv").write_bytes(whole[: int(share * len(whole))])
    report = DecodeReport()
    list(panoramas(Clip(folder / "b.mkv"), report=report))
    assert report.short_s > 0
    lines, code = checked(folder, GOOD.replace("a.mp4", "b.mkv"))
    assert code == 4
    assert "site.yaml:8: b.mkv: nothing can be decoded after" in lines[1]


def aimed(name: str, row_pass: Pass, *_: object) -> PassPlan:
    """In place of `plan_shown`."""
    return PassPlan(name, row_pass.clip, {"shelves": ViewPlan((ViewSpec("face", 0.0),))})


@pytest.fixture
def without_networks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Views are chosen without a look at pictures."""
    keys = tuple(Panorama(n, float(n), np.full((64, 128, 3), 90, np.uint8)) for n in range(5))
    preview = PassPreview(keys, (), Renderer(), np.eye(3))
    monkeypatch.setattr(previewing, "looked_at", lambda row_pass, _: (row_pass, preview, None))
    monkeypatch.setattr(previewing, "plan_shown", aimed)


@pytest.mark.usefixtures("without_networks")
def test_rows_have_pictures_of_their_own(folder: Path) -> None:
    two = "[{video: a.mp4, side: left, end_s: 2}, {video: a.mp4, side: left, start_s: 2}]"
    lines, code = checked(folder, f"{GOOD}  B/1:\n    passes: {two}\n", pictures=True)
    assert code == 0, lines
    assert lines[0] == "row A, pass 1: 40 frames, views in out/views-A-pass-1.jpg"
    assert {path.name for path in (folder / "out").iterdir()} == {
        "views-A-pass-1.jpg",
        "views-B%2F1-pass-1.jpg",
        "views-B%2F1-pass-2.jpg",
    }


@pytest.mark.usefixtures("without_networks")
def test_needs_are_measured_on_a_few_frames(video: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of each kind of footage, whatever the first frames show: that these are no row is none of the site's problems."""
    asked: list[int] = []

    def frames() -> Iterator[int]:
        for number in range(1000):
            asked.append(number)
            time.sleep(0.2 if number < 2 else 0.01)
            yield number

    def driven(clip: Clip, rows: Sequence[RowWalk], renderer: Renderer, monitor: Monitor) -> None:
        for number in monitor.each(frames(), "measuring"):
            rows[0].take_measured(float(number), None)
        rows[0].failure = StructureError("the camera stands")

    found: list[ResourceEstimate] = []

    def kept(job: Any, footage: Any, plans: Any) -> ResourceEstimate:
        found.append(resource_estimate(job, footage, plans))
        return found[-1]

    (tmp_path / "a.mp4").symlink_to(video)
    monkeypatch.setattr(checking, "drive_along", driven)
    monkeypatch.setattr(checking, "resource_estimate", kept)
    again = GOOD + "  B: {passes: [{video: a.mp4, fps: 5, side: right}, {video: a.mp4, side: left}]}\n"
    assert checked(tmp_path, again)[1] == 0
    assert len(asked) == 2 * FRAMES  # one kind of footage at each rate
    assert found[0].frames == 100
    assert 0.5 < found[0].measure_s < 20
    assert 0.01 < found[0].after_s < 10
    assert found[0].disk_mb > 0
    assert found[0].memory_mb > 10
    assert list(found[0].lines())[1].startswith("solving and writing come on top: about ")


@pytest.mark.usefixtures("without_networks")
def test_frames_that_cannot_be_measured_are_a_problem(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def driven(clip: Clip, rows: Sequence[RowWalk], renderer: Renderer, monitor: Monitor) -> None:
        rows[0].failure = PluginError("plugin `shelves` failed in `extract_features`")

    monkeypatch.setattr(checking, "resource_estimate", resource_estimate)
    monkeypatch.setattr(checking, "drive_along", driven)
    lines, code = checked(folder, GOOD)
    assert (code, lines[-1]) == (5, "plugin `shelves` failed in `extract_features`")


@pytest.mark.parametrize(("seconds", "words"), [(3.2, "3 s"), (99, "99 s"), (240, "4 min"), (7000, "1 h 57 min")])
def test_times_are_told_in_words(seconds: float, words: str) -> None:
    assert duration(seconds) == words


DEMO = Path(demo.SITE).read_text(encoding="utf-8")
TUTORIAL = Path(__file__).parents[2] / "docs" / "tutorial" / "own-aisle.md"


@pytest.fixture
def aisle(tmp_path: Path) -> Path:
    """A folder with the demo's footage, under the tutorial's name, too."""
    for name in ("aisle-dev.mp4", "aisle.mp4", "survey.json"):
        (tmp_path / name).symlink_to(demo.SITE.parent / name.replace("aisle.mp4", "aisle-dev.mp4"))
    return tmp_path


@pytest.mark.slow
@pytest.mark.parametrize("start_s", [0.0, 3.0])
def test_sample_site_files_have_no_problem(aisle: Path, start_s: float) -> None:
    """The first frames of a pass may show no whole bay."""
    (block,) = re.findall(r"```yaml\n(.*?)```", TUTORIAL.read_text(encoding="utf-8"), re.DOTALL)
    for text in (DEMO, block) if not start_s else (block.replace("side: left", f"side: left, start_s: {start_s}"),):
        lines, code = checked(aisle, text, pictures=True)
        assert (code, lines[-1]) == (0, "site.yaml: no problem found"), lines


@pytest.mark.parametrize(
    ("old", "new", "code", "line"),
    [
        ("value: 3.055", "value: 10.02", 0, "site.yaml:10: is the camera 10.02 m high? 10.02 feet are 3.05 m"),
        ("value: 3.055", "value: 3055", 3, "site.yaml:10: `references.camera_height_m.value`: input should be less"),
        ("value: 3.055", "value: 3,055", 3, "site.yaml:10: unknown key `references.camera_height_m.055`"),
        ("value: 14.162", "value: 1416200", 3, "site.yaml:18: `rows.A.references.lengths[0].value`: input should be"),
        (", 0.30011]", "]", 0, "site.yaml:20: row A: is a value missing? There are 3, and references name 4 bays"),
        ("upright 5 / right", "upright 9 / right", 0, "site.yaml:20: row A: is a value missing? There are 4, and"),
        ("upright 5 / right", "post 5 / right", 3, "site.yaml:18: nothing is called `post 5 / right`: did you mean"),
        ("aisle-dev.mp4", "aisle-dev.mp5", 4, "site.yaml:15: aisle-dev.mp5: no such file or folder"),
        (
            "side: left}",
            "side: left}\n      - {video: aisle-dev.mp4, side: left}",
            3,
            "site.yaml:14: two passes of row A",
        ),
        ("side: left", "side: Left", 3, "site.yaml:15: `rows.A.passes[0].side`: input should be 'left' or 'right'"),
        (
            "side: left",
            "side: right",
            0,
            "not checked, for only a map tells: whether each `side` shows the face that was",
        ),
    ],
)
def test_ten_wrong_site_files_get_the_right_answer(folder: Path, old: str, new: str, code: int, line: str) -> None:
    (folder / "survey.json").write_bytes((demo.SITE.parent / "survey.json").read_bytes())
    assert old in DEMO
    lines, found = checked(folder, DEMO.replace(old, new, 1).replace("aisle-dev.mp4", "a.mp4"))
    assert (found, [one for one in lines if one.startswith(line)] != []) == (code, True), lines


@pytest.mark.parametrize("model", ["none.onnx", "text.mp4"])
def test_a_run_refuses_a_broken_network_at_once(folder: Path, monkeypatch: pytest.MonkeyPatch, model: str) -> None:
    monkeypatch.chdir(folder)
    Path("site.yaml").write_text(GOOD.replace("shelves: {}", f"shelves: {{model: {model}}}"), encoding="utf-8")
    with pytest.raises(ModelError, match=rf"^site.yaml:2: plugin `shelves`: {model}: (no such|not a usable ONNX)"):
        require_ready(job_for(Path("site.yaml"), None, Path("out")))
