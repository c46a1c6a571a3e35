"""Rows that begin and end by themselves: which frames belong to an aisle, and what becomes of each aisle's map."""

from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

from savmap.apps.live import rows
from savmap.apps.live.rows import AisleWatch, LiveRows
from savmap.apps.live.session import LiveState
from savmap.apps.live.sources import LiveJob, live_job
from savmap.apps.split.records import DetectedPass, SplitResult
from savmap.errors import VideoError
from savmap.site.job import Job
from savmap.types import FrameTable, Panorama, RowMap, Trajectory
from savmap.video.motion import Motion

from ...video.made_up_video import evenly, picture, write_video

MAPPED = RowMap("1", FrameTable(np.zeros(0), ()), {}, Trajectory(np.zeros(0, np.int64), np.zeros((0, 4, 4))), {}, ())


def frame(number: int, fps: float = 10.0) -> Panorama:
    return Panorama(number, number / fps, picture(number))


def motion(stamp_s: float, turn: float) -> Motion:
    return Motion(stamp_s, turn, 0.0, (30.0, 30.0), 0.0, np.zeros(120), np.zeros(120))


def detected(end_s: float) -> SplitResult:
    return SplitResult((DetectedPass(0.0, end_s, 0.0, 0.0, ("left",), 0.9, 0.0),), np.zeros(0), np.zeros(0))


def inside(watch: AisleWatch, monkeypatch: pytest.MonkeyPatch, end_s: float, turns: list[float]) -> bool:
    """Whether the camera is in an aisle after a sample a second with these turns, of a pass that ended at `end_s`."""
    monkeypatch.setattr(rows, "find_passes", lambda *_: detected(end_s))
    watch._motions.extend(motion(float(stamp), turn) for stamp, turn in enumerate(turns))
    return watch._inside()


def test_a_pass_that_reaches_up_to_now_is_an_aisle(monkeypatch: pytest.MonkeyPatch) -> None:
    assert inside(AisleWatch(), monkeypatch, 9.0, [0.0] * 10)


def test_a_gap_does_not_end_an_aisle_and_a_long_one_does(monkeypatch: pytest.MonkeyPatch) -> None:
    watch = AisleWatch()
    watch.is_inside = True
    assert inside(watch, monkeypatch, 9.0, [0.0] * 16)
    assert not inside(watch, monkeypatch, 9.0, [0.0] * 19)


def test_a_gap_does_not_begin_one(monkeypatch: pytest.MonkeyPatch) -> None:
    assert not inside(AisleWatch(), monkeypatch, 9.0, [0.0] * 13)


def test_a_turn_ends_an_aisle(monkeypatch: pytest.MonkeyPatch) -> None:
    watch = AisleWatch()
    watch.is_inside = True
    assert not inside(watch, monkeypatch, 9.0, [*[0.0] * 10, 20.0, 20.0, 20.0])


def test_a_sample_a_second_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    stamps = []
    monkeypatch.setattr(rows, "motion_of", lambda pair: stamps.append(pair.stamp_s) or motion(pair.stamp_s, 0.0))
    watch = AisleWatch()
    for number in range(31):
        watch.take(frame(number))
    assert stamps == [0.0, 1.0, 2.0]


class FakeMapping:
    """Takes frames, and maps at the third one that is measured."""

    made: ClassVar[list["FakeMapping"]] = []

    def __init__(self, job: Job, row: str, *, others: dict[str, RowMap]) -> None:
        self.job, self.row, self.others, self.forgotten = job, row, dict(others), False
        self.numbers: list[int] = []
        self.measured = 0
        FakeMapping.made.append(self)

    @property
    def maps(self) -> dict[str, RowMap]:
        return {**self.others, **({self.row: replace(MAPPED, name=self.row)} if self.measured > 2 else {})}

    def take(self, panorama: Panorama, measures: bool) -> LiveState:
        self.numbers.append(panorama.frame)
        self.measured += measures
        return self.state("walking")

    def state(self, status: str) -> LiveState:
        return LiveState(status, frames=len(self.numbers), maps=int(self.measured > 2))

    def stop(self) -> None:
        return None

    def forget(self) -> None:
        self.forgotten = True


@pytest.fixture
def job(tmp_path: Path) -> LiveJob:
    return live_job(write_video(tmp_path / "a.mp4", evenly(4, 10)), ["shelves"], tmp_path / "out", None, 2.0)


def test_each_aisle_is_a_row(job: LiveJob, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rows, "LiveMapping", FakeMapping)
    monkeypatch.setattr(FakeMapping, "made", [])
    with LiveRows(job) as live:
        states = []
        for number in range(40):
            is_inside = number % 20 >= 5
            monkeypatch.setattr(live._watch, "take", lambda _, is_inside=is_inside: is_inside)
            states.append(live.take(frame(number)))
            live._watch.is_inside = is_inside
        assert list(live.maps) == ["1", "2"]
    first, second = FakeMapping.made
    assert list(first.job.site.rows) == ["1"]
    assert list(second.job.site.rows) == ["2"]
    assert first.numbers == second.numbers == list(range(20))
    assert first.measured == 15
    assert first.forgotten
    assert second.forgotten
    assert [states[19].frames, states[39].frames, states[39].footage_s, states[39].maps] == [20, 40, 3.9, 2]


def test_a_folder_of_pictures_is_refused(tmp_path: Path) -> None:
    (tmp_path / "pictures").mkdir()
    job = live_job(tmp_path / "pictures", ["shelves"], tmp_path / "out", None, 2.0)
    with pytest.raises(VideoError, match="--split takes a video or a camera"):
        LiveRows(job)
