"""`savmap check`: every problem is told with its place, and what a run will take is measured."""

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from savmap.errors import ModelError, SavmapError
from savmap.files.journal import Journal
from savmap.jobs import check as checking
from savmap.jobs.check import FRAMES, CheckError, ResourceEstimate, check, duration, resource_estimate
from savmap.maps.run_record import RowRun, RunLog, write_log
from savmap.pipeline.records import MeasuredRow, RowMeasurements, RowRequest
from savmap.pipeline.view_plans import PassPlan
from savmap.site.job import job_for
from savmap.site.preflight import require_ready
from savmap.types import FrameTable, Panorama, RowFacts, ViewPlan, ViewSpec
from savmap.types.progress import Monitor, NoteCollector
from savmap.video.clip import Clip, DecodeReport
from savmap.video.reader import panoramas
from savmap.vision.markers import MarkerTracks
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
    monkeypatch.setattr(checking, "resource_estimate", lambda job, footage: NEEDS)
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
    lines, code = checked(
        folder, GOOD + "  B: {passes: [{video: a.mp4}]}\n  C: {passes: [{video: a.mp4, side: left}]}\n"
    )
    assert code == 0
    assert lines[0].startswith("rows A and B look at the same frames (A, pass 1), and neither has a `side`")
    assert lines[1].startswith("row A, pass 1: 40")


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


def test_rows_have_pictures_of_their_own(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def aimed(name: str, one: Any, *_: object) -> PassPlan:
        return PassPlan(name, Clip(one.video), {"all": ViewPlan((ViewSpec("face", 0.0),))})

    def previewed(clip: Clip, renderer: Renderer) -> PassPreview:
        keys = tuple(Panorama(n, float(n), np.full((64, 128, 3), 90, np.uint8)) for n in range(5))
        return PassPreview(keys, (), renderer, np.eye(3))

    monkeypatch.setattr("savmap.jobs.preview.plan_pass", aimed)
    monkeypatch.setattr("savmap.jobs.preview.preview_of", previewed)
    lines, code = checked(
        folder,
        GOOD + "  B/1:\n    passes: [{video: a.mp4, side: left}, {video: a.mp4, side: left, fps: 8}]\n",
        pictures=True,
    )
    assert code == 0, lines
    assert lines[0] == "row A, pass 1: 40 frames, views in out/views-A-pass-1.jpg"
    assert {path.name for path in (folder / "out").iterdir()} == {
        "views-A-pass-1.jpg",
        "views-B%2F1-pass-1.jpg",
        "views-B%2F1-pass-2.jpg",
    }


def test_needs_are_measured_on_a_few_frames(video: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[int] = []

    def frames() -> Iterator[int]:
        for number in range(1000):
            asked.append(number)
            time.sleep(0.2 if number < 2 else 0.01)
            yield number

    def measured(rows: list[RowRequest], journal: Journal, monitor: Monitor) -> list[MeasuredRow]:
        (row,) = rows
        seen = list(monitor.each(frames(), "measuring"))
        facts = RowFacts(row.name, FrameTable(np.arange(len(seen), dtype=float), ("pass 1",) * len(seen)), {}, {})
        return [MeasuredRow(row, RowMeasurements(facts, {}, {}, frozenset(), (), MarkerTracks({}, {})))]

    found: list[ResourceEstimate] = []

    def kept(job: Any, footage: Any) -> ResourceEstimate:
        found.append(resource_estimate(job, footage))
        return found[-1]

    (tmp_path / "a.mp4").symlink_to(video)
    monkeypatch.setattr(checking, "measure", measured)
    monkeypatch.setattr(checking, "resource_estimate", kept)
    again = GOOD + "  B: {passes: [{video: a.mp4, fps: 5}, {video: a.mp4}]}\n"
    checked(tmp_path, again)
    assert len(asked) == 2 * FRAMES  # one kind of footage at each rate
    assert found[0].frames == 100
    assert 1.0 < found[0].measure_s < 20
    assert 0.01 < found[0].after_s < 10
    assert found[0].disk_mb > 0
    assert found[0].memory_mb > 10
    write_log(
        RunLog(rows={"A": RowRun(status="mapped", used=40, seconds={"solved": 4.0})}), tmp_path / "out" / "run.json"
    )
    checked(tmp_path, again)
    assert found[1].after_s > 10.0
    assert list(found[1].lines())[1].startswith(
        "solving and writing come on top: about 10 s; so does measuring once more"
    )


@pytest.mark.parametrize(("seconds", "words"), [(3.2, "3 s"), (99, "99 s"), (240, "4 min"), (7000, "1 h 57 min")])
def test_times_are_told_in_words(seconds: float, words: str) -> None:
    assert duration(seconds) == words


@pytest.mark.parametrize("model", ["none.onnx", "text.mp4"])
def test_a_run_refuses_a_broken_network_at_once(folder: Path, monkeypatch: pytest.MonkeyPatch, model: str) -> None:
    monkeypatch.chdir(folder)
    Path("site.yaml").write_text(GOOD.replace("shelves: {}", f"shelves: {{model: {model}}}"), encoding="utf-8")
    with pytest.raises(ModelError, match=rf"^site.yaml:2: plugin `shelves`: {model}: (no such|not a usable ONNX)"):
        require_ready(job_for(Path("site.yaml"), None, Path("out")))
