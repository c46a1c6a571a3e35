"""The command `savmap live`: what ends the walk, and what is mapped then."""

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from savmap.apps.live import console as live
from savmap.apps.live.session import STATE, LiveState
from savmap.apps.live.sources import LiveJob, live_job
from savmap.errors import VideoError
from savmap.maps.map_file import write_map
from savmap.site.job import Job
from savmap.types import Panorama, RowMap, SiteMap

from ...video.made_up_video import evenly, picture, write_video


class FakeMapping:
    """Counts frames, and measures nothing."""

    def __init__(self, *_: object) -> None:
        self.resumed, self.count, self.row = 0, 0, "1"

    def take(self, panorama: Panorama) -> LiveState:
        self.count += 1
        return LiveState("walking", frames=self.count, maps=self.count // 3)

    @property
    def maps(self) -> dict[str, RowMap]:
        return {}

    def __enter__(self) -> "FakeMapping":
        return self

    def __exit__(self, *_: object) -> None:
        return None


@pytest.fixture
def job(tmp_path: Path) -> LiveJob:
    return live_job(write_video(tmp_path / "a.mp4", evenly(4, 10)), ["shelves"], tmp_path / "out", None, 2.0)


@pytest.fixture
def mapped(monkeypatch: pytest.MonkeyPatch) -> list[Job]:
    jobs: list[Job] = []

    def maps(job: Job) -> None:
        jobs.append(job)
        write_map(SiteMap({}, {}), job.output / "map.json")

    monkeypatch.setattr(live, "LiveMapping", FakeMapping)
    monkeypatch.setattr(live, "LiveRows", FakeMapping)
    monkeypatch.setattr(live, "map_and_print", maps)
    return jobs


def frames(count: int, ending: BaseException | None = None) -> Iterator[Panorama]:
    for number in range(count):
        yield Panorama(number, number / 10, picture(number))
    if ending is not None:
        raise ending


@pytest.mark.parametrize("ending", [None, KeyboardInterrupt(), VideoError("rtsp://x: the source is lost (timed out)")])
def test_what_was_recorded_is_mapped_however_the_walk_ends(
    job: LiveJob, mapped: list[Job], ending: BaseException | None, capsys: Any
) -> None:
    live.walk_and_print(job, frames(3, ending), False)
    assert mapped == [job.recorded]
    assert json.loads((job.walked.output / STATE).read_text())["status"] == "mapped"
    said = capsys.readouterr().err
    assert ("the source is lost (timed out); mapping what was recorded" in said) == isinstance(ending, VideoError)


def test_a_source_that_never_began_is_an_error(job: LiveJob, mapped: list[Job]) -> None:
    with pytest.raises(VideoError, match="cannot be opened"):
        live.walk_and_print(job, frames(0, VideoError("/dev/video9: cannot be opened")), False)
    assert mapped == []


def test_the_rows_that_are_found_are_mapped(
    job: LiveJob, mapped: list[Job], monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    rows = dict.fromkeys(("pass-1-left", "pass-2-right"), job.recorded.site.rows["1"])
    several = replace(job.recorded, site=job.recorded.site.model_copy(update={"rows": rows}))
    monkeypatch.setattr(LiveJob, "with_rows_found", lambda *_: several)
    live.walk_and_print(job, frames(3), False, splits=True)
    assert mapped == [several]
    assert "rows that were filmed: pass-1-left, pass-2-right" in capsys.readouterr().err


@pytest.mark.extra("ros")
def test_maps_and_advice_are_recorded(job: LiveJob, mapped: list[Job]) -> None:
    from mcap.reader import make_reader

    live.walk_and_print(job, frames(3), False, records=True)
    with (job.walked.output / "live.mcap").open("rb") as stream:
        topics = [channel.topic for _, channel, _ in make_reader(stream).iter_messages()]
    assert topics == ["/advice", "/map"]
