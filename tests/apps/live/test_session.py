"""A live session: which frames are measured, when maps are made, what is on disk, and how it ends."""

import itertools
import json
import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import BaseModel, ConfigDict

import savmap
from savmap.apps.live import mapper, session, sources
from savmap.apps.live.mapper import LivePlan, Mapper, MapReply, MapRequest, ProvisionalMaps
from savmap.apps.live.session import STATE, LiveMapping, LiveState, end_told
from savmap.apps.live.sources import live_job, recorded_job, recordings
from savmap.apps.split.records import DetectedPass, SplitResult
from savmap.apps.split.site_rows import new_site
from savmap.errors import (
    MustCheckError,
    OutputError,
    PluginError,
    SavmapError,
    SiteError,
    StructureError,
    VideoError,
)
from savmap.files.journal import Journal
from savmap.files.serialization import packed, unpacked
from savmap.files.urls import where
from savmap.jobs.cache_keys import measurement_key, strips_key
from savmap.maps.map_file import write_map
from savmap.pipeline.drive import RowWalk
from savmap.pipeline.key_frames import KeyFrames
from savmap.pipeline.records import FrameRecord, RowMeasurements, WalkedRow
from savmap.pipeline.view_plans import PassPlan
from savmap.plugin.manager import LoadedPlugin, loaded_plugin
from savmap.site.job import Job, job_for
from savmap.types import (
    Detection,
    Feature,
    FrameTable,
    MapWarning,
    Panorama,
    RowMap,
    SiteMap,
    Trajectory,
    Verdict,
    View,
    ViewPlan,
    ViewSpec,
)
from savmap.types.progress import SilentMonitor
from savmap.vision.odometry import Followed, Follower

from ...plugin.made_up_plugin import plugin_class
from ...video.made_up_video import evenly, picture, write_video

LAMPS = Path(__file__).parents[3] / "plugins" / "lights" / "savmap_lights" / "model" / "lights.onnx"
AHEAD = ViewSpec("ahead", 10.0, width=96, height=64)
PASSES = (
    DetectedPass(0.5, 6.25, 0.0, 9.0, ("left", "right"), 0.9, 0.0),
    DetectedPass(9.0, 15.5, 180.0, 9.0, ("right",), 0.9, 0.0),
)
MAPPED = RowMap("1", FrameTable(np.zeros(0), ()), {}, Trajectory(np.zeros(0, np.int64), np.zeros((0, 4, 4))), {}, ())


class Config(BaseModel):
    model_config = ConfigDict(extra="forbid")
    threshold: float = 0.01


def watcher(extract: Callable[[View], list[Feature]]) -> LoadedPlugin:
    def extract_features(self: object, view: View, detections: list[Detection]) -> list[Feature]:
        return extract(view)

    return loaded_plugin(
        "watcher", plugin_class(classes=("light",), model=LAMPS, extract_features=extract_features), Config()
    )


class FakeMapper:
    """Answers every request with the same map."""

    asked: list[MapRequest]

    def __init__(self, *_: object) -> None:
        self.is_busy, self.is_alive, self.closed = False, True, False
        FakeMapper.asked = []

    def request(self, asked: MapRequest) -> None:
        FakeMapper.asked.append(asked)
        self.is_busy = True

    def reply(self) -> MapReply | None:
        if not self.is_busy:
            return None
        self.is_busy = False
        return MapReply(MAPPED, "", len(FakeMapper.asked[-1].measured), 0.1)

    def close(self) -> None:
        self.closed = True


@pytest.fixture(autouse=True)
def every_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every frame is a key frame: nothing is followed in these pictures."""
    monkeypatch.setattr(KeyFrames, "is_key", lambda *_: True)
    nothing = Followed(np.zeros(0, np.int64), np.zeros((0, 2), np.float32))
    monkeypatch.setattr(Follower, "update", lambda *_: nothing)


@pytest.fixture
def job(tmp_path: Path) -> Job:
    video = write_video(tmp_path / "a.mp4", evenly(40, 10))
    return live_job(video, ["shelves"], tmp_path / "out", None, 2.0, "left").walked


@pytest.fixture
def plan(monkeypatch: pytest.MonkeyPatch, job: Job) -> list[PassPlan]:
    """What views are chosen, and the plugin that looks at them; a stand-in for the process that maps."""
    return planned(monkeypatch, job, lambda view: [])


def planned(monkeypatch: pytest.MonkeyPatch, job: Job, extract: Callable[[View], list[Feature]]) -> list[PassPlan]:
    plugin, chosen = watcher(extract), list[PassPlan]()

    def plan_shown(name: str, row_pass: Any, *_: object) -> PassPlan:
        chosen.append(PassPlan(name, row_pass.clip, {"watcher": ViewPlan((AHEAD,), np.eye(3))}, row_pass.side))
        return chosen[-1]

    request = session.request_for
    monkeypatch.setattr(session, "request_for", lambda *given: replace(request(*given), plugins=[plugin]))
    monkeypatch.setattr(session, "plan_shown", plan_shown)
    monkeypatch.setattr(session.PassPreview, "of_frames", lambda *_: None)
    monkeypatch.setattr(session, "Mapper", FakeMapper)
    return chosen


def frames(count: int, pause_s: float = 0.0, first: int = 0) -> Iterator[Panorama]:
    for number in range(first, count):
        time.sleep(pause_s)
        yield Panorama(number, number / 10, picture(number))


def begun(job: Job) -> RowWalk:
    """A walk that measures nothing and knows no face."""
    walk = RowWalk.__new__(RowWalk)
    walk.plan = PassPlan("pass 1", job.site.rows["1"].passes[0].clip, {})
    return walk


def until(reached: Callable[[], bool]) -> None:
    end = time.monotonic() + 600
    while not reached() and time.monotonic() < end:
        time.sleep(0.02)
    assert reached()


def test_views_are_chosen_by_the_first_frames(job: Job, plan: list[PassPlan]) -> None:
    with LiveMapping(job, "1") as live:
        for panorama in frames(session.PREVIEWED - 1):
            live.take(panorama)
        time.sleep(0.1)
        assert not plan
        live.take(next(frames(session.PREVIEWED, first=session.PREVIEWED - 1)))
        until(lambda: bool(plan))


def test_every_frame_is_measured_or_passed_over(job: Job, plan: list[PassPlan]) -> None:
    with LiveMapping(job, "1") as live:
        for panorama in frames(40, 0.01):
            state = live.take(panorama)
        until(lambda: live.state("walking").measured + live.state("walking").passed_over == 40)
        assert state.frames == 40
    content = json.loads((job.output / STATE).read_text())
    assert content["status"] == "stopped"
    assert content["measured"] + content["passed_over"] == 40
    assert content["footage_s"] == 3.9


def test_maps_follow_what_is_measured(job: Job, plan: list[PassPlan], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session, "FIRST_MAP", 3)
    monkeypatch.setattr(session, "FURTHER", 2)
    with LiveMapping(job, "1") as live:
        for panorama in frames(40, 0.02):
            live.take(panorama)
        further = iter(range(40, 1000))
        until(lambda: live.take(panorama_after(next(further))).maps >= 2)
        assert live.latest is MAPPED
        sizes = [len(asked.measured) for asked in FakeMapper.asked]
        assert sizes == sorted(sizes)
        assert sizes[0] >= 3


def test_once_views_are_chosen_key_frames_alone_are_measured(
    job: Job, plan: list[PassPlan], monkeypatch: pytest.MonkeyPatch
) -> None:
    numbers = itertools.count()
    monkeypatch.setattr(KeyFrames, "is_key", lambda *_: next(numbers) % 3 == 0)
    count = session.PREVIEWED + 30
    with LiveMapping(job, "1") as live:
        for panorama in frames(session.PREVIEWED):
            live.take(panorama)
        until(lambda: live._walk is not None)
        for panorama in frames(count, first=session.PREVIEWED):
            state = live.take(panorama)
        until(lambda: live.state("walking").measured + live.state("walking").passed_over == session.PREVIEWED + 10)
        assert state.frames == count
        assert all(number % 3 == 0 for number in live.measured if number >= session.PREVIEWED)


def panorama_after(number: int) -> Panorama:
    return Panorama(number, number / 10, picture(number))


@pytest.mark.slow
def test_a_session_goes_on_where_it_stood(job: Job, plan: list[PassPlan]) -> None:
    with LiveMapping(job, "1") as live:
        for panorama in frames(40, 0.02):
            live.take(panorama)
        until(lambda: live.state("walking").measured > 3)
    measured = live.state("stopped").measured
    with LiveMapping(job, "1", resume=True) as again:
        assert again.resumed == measured
        for panorama in frames(40):
            again.take(panorama)
        assert again.state("walking").measured >= measured
    assert len(plan) == 1
    with LiveMapping(job, "1") as fresh:
        assert fresh.resumed == 0


def test_measuring_that_fails_ends_the_session(job: Job, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(view: View) -> list[Feature]:
        raise PluginError("plugin `watcher` failed")

    planned(monkeypatch, job, fails)
    with LiveMapping(job, "1") as live:
        taken = (live.take(panorama) for panorama in frames(400, 0.02))
        with pytest.raises(PluginError, match="plugin `watcher` failed"):
            list(taken)


def test_nothing_to_be_mapped_is_said_and_looked_for_again(
    job: Job, plan: list[PassPlan], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []

    def nothing(*_: object) -> None:
        asked.append(1)
        raise StructureError("no structure is seen")

    monkeypatch.setattr(session, "plan_shown", nothing)
    with LiveMapping(job, "1") as live:
        for panorama in frames(40):
            live.take(panorama)
        until(lambda: len(asked) > 1)
        state = live.take(panorama_after(40))
    assert "Nothing is seen that can be mapped: no structure is seen." in [item.text for item in state.advice]


def test_what_is_not_seen_together_is_said_once_it_is_sure(
    job: Job, plan: list[PassPlan], monkeypatch: pytest.MonkeyPatch
) -> None:
    with LiveMapping(job, "1") as live:
        live._walk, codes = begun(job), []
        for frames_mapped in (session.FIRST_MAP, session.SURE_UNSEEN):
            live._reply = MapReply(None, "no picture shows two of them", frames_mapped, 1.0, is_unseen=True)
            codes.append([item.code for item in live.take(panorama_after(frames_mapped)).advice])
        assert codes == [[], ["not-seen"]]


def test_a_machine_too_slow_to_begin_says_lag(job: Job, plan: list[PassPlan], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(LiveMapping, "_plan", lambda _: False)  # as while views are being chosen
    with LiveMapping(job, "1") as live:
        states = [live.take(panorama_after(number)) for number in range(session.PREVIEWED + 60)]
    said = ["lag" in [item.code for item in state.advice] for state in states]
    assert said == [False] * (session.PREVIEWED + 50) + [True] * 10
    assert states[-1].lag_s == 6.0


@pytest.mark.parametrize(
    "failure", [None, MustCheckError("mapped, but"), StructureError("no row"), KeyboardInterrupt()]
)
def test_state_tells_how_the_final_map_ended(tmp_path: Path, failure: BaseException | None) -> None:
    verdict = Verdict((MapWarning("camera-motion"),) if isinstance(failure, MustCheckError) else ())
    (tmp_path / STATE).write_text(LiveState("stopped", frames=9, measured=2, problem="x").as_json())
    with suppress(SavmapError, KeyboardInterrupt), end_told(tmp_path):
        assert json.loads((tmp_path / STATE).read_text())["status"] == "mapping"
        if failure is not None and not isinstance(failure, MustCheckError):
            raise failure
        write_map(SiteMap({"1": replace(MAPPED, verdict=verdict)}, {}), tmp_path / "map.json")
        if failure is not None:
            raise failure
    state = json.loads((tmp_path / STATE).read_text())
    mapped = failure is None or isinstance(failure, MustCheckError)
    assert (state["status"], state["frames"], state["elements"]) == ("mapped" if mapped else "failed", 9, 0)
    problems = {MustCheckError: "1 of 1 row must be checked: 1", StructureError: "no row"}
    assert state["problem"] == problems.get(type(failure), "it was interrupted" if failure else "")


def test_choosing_views_ends_with_the_session(job: Job, plan: list[PassPlan], monkeypatch: pytest.MonkeyPatch) -> None:
    begun = threading.Event()

    def looks_for_ever(*_: object) -> None:
        while True:
            begun.set()
            live._renderer.render(panorama_after(0), AHEAD)

    monkeypatch.setattr(session, "plan_shown", looks_for_ever)
    live = LiveMapping(job, "1")
    for panorama in frames(session.PREVIEWED):
        live.take(panorama)
    assert begun.wait(600)
    live.stop()
    assert not live._worker.is_alive()
    assert live._failure is None


def test_unknown_scale_is_said(tmp_path: Path, plan: list[PassPlan]) -> None:
    bare = live_job(tmp_path / "a.mp4", ["shelves"], tmp_path / "out").walked
    with LiveMapping(bare, "1") as live:
        state = live.take(panorama_after(0))
    assert [item.code for item in state.advice] == ["no-scale"]


def test_a_folder_elsewhere_is_refused(job: Job) -> None:
    with pytest.raises(OutputError, match="give a folder of this machine"):
        LiveMapping(replace(job, output=where("memory://out")), "1")


def test_plan_goes_to_another_process_and_back(job: Job, plan: list[PassPlan]) -> None:
    request = session.request_for(job, "1")
    live_plan = LivePlan({"watcher": ViewPlan((AHEAD,), np.eye(3))})
    pass_plan = live_plan.planned(request)
    assert pass_plan.side == "left"
    assert np.array_equal(pass_plan.attitude(), np.eye(3))


def test_an_interrupt_is_left_to_the_process_that_walks(job: Job) -> None:
    maps = Mapper(job, "1", "key", LivePlan({}), {})
    try:
        assert maps._process.pid is not None
        for _ in range(5):  # also while it still begins
            os.kill(maps._process.pid, signal.SIGINT)
            time.sleep(0.1)
        assert maps.is_alive
    finally:
        maps.close()
    assert not maps.is_alive


def test_a_hook_that_is_stuck_ends_the_process_that_maps(job: Job) -> None:
    limits = list[float]()
    line, other = multiprocessing.Pipe()
    limited = replace(job, site=job.site.model_copy(update={"plugin_timeout_s": 7.0}))
    other.close()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(mapper, "limit_hooks", limits.append)
        mapper._serve(line, limited, "1", "key", LivePlan({}), packed({}))
    assert limits == [7.0]


def test_a_long_row_is_mapped_from_evenly_chosen_frames(monkeypatch: pytest.MonkeyPatch, job: Job) -> None:
    monkeypatch.setattr(mapper, "MOST_MAPPED", 4)
    read = list[int]()
    with Journal() as journal:
        for number in range(10):
            journal.add("1", number, FrameRecord({}))
        maps = ProvisionalMaps(job, "1", journal, LivePlan({}), {})
        monkeypatch.setattr(journal, "get", lambda kind, row, number: read.append(number) or FrameRecord({}))
        assert sorted(maps._read(frozenset({0, 1, 11}))) == [0, 1]
        assert sorted(maps._read(frozenset(range(12)))) == [0, 3, 6, 9]
    assert read == [0, 1, 3, 6, 9]


def test_a_provisional_map_begins_with_the_drives_path(
    monkeypatch: pytest.MonkeyPatch, job: Job, plan: list[PassPlan]
) -> None:
    """What the other process is asked for has it."""
    found = list[RowMeasurements]()

    def find_structures(walked: WalkedRow, monitor: object) -> None:
        found.append(walked.measurements)
        raise StructureError("no light shows")

    monkeypatch.setattr(mapper, "find_structures", find_structures)
    monkeypatch.setattr(mapper, "request_for", session.request_for)
    live_plan = LivePlan({"watcher": ViewPlan((AHEAD,), np.eye(3))})
    path = Trajectory(np.array([1, 3]), np.tile(np.eye(4), (2, 1, 1)))
    asked = unpacked(packed(MapRequest((0.0, 0.1, 0.2, 0.3), frozenset({1, 3}), path)), MapRequest)
    reply = ProvisionalMaps(job, "1", Journal(), live_plan, {}).map(asked)
    assert (reply.problem, reply.is_unseen, reply.frames) == ("no light shows", True, 2)
    (measurements,) = found
    assert len(measurements.facts.frames) == 4
    assert measurements.walked is not None
    assert measurements.walked.frames.tolist() == [1, 3]


def test_one_row_of_one_pass_is_filmed(tmp_path: Path) -> None:
    video = write_video(tmp_path / "a.mp4", evenly(4, 10))
    site = tmp_path / "site.yaml"
    site.write_text(
        f"plugins: {{shelves: {{}}}}\nrows: {{A: {{passes: [{{video: {video}}}, {{video: {video}, start_s: 0.1}}]}}}}\n"
    )
    with pytest.raises(SiteError, match="row A has 2 passes; a live session films one"):
        live_job(site, None, tmp_path / "out")
    with pytest.raises(SiteError, match="has no row `B`; it has A"):
        live_job(site, None, tmp_path / "out", "B")
    job = recorded_job(site, None, tmp_path / "out")
    assert job.clip.path == tmp_path / "out" / "recording.mkv"
    assert len(job.recorded.site.rows["A"].passes) == 1


def test_rows_of_a_recording_are_those_of_split(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sources, "find", lambda *_, **__: SplitResult(PASSES, np.zeros(0), np.zeros(0)))
    video = write_video(tmp_path / "a.mp4", evenly(200, 10))
    found = live_job(video, ["shelves"], tmp_path / "out", None, 2.0).with_rows_found(SilentMonitor())
    new_site(PASSES, video, tmp_path / "rows.yaml")
    text = (tmp_path / "rows.yaml").read_text()
    (tmp_path / "rows.yaml").write_text(text + "references: {camera_height_m: {value: 2.0}}\n")
    split = job_for(tmp_path / "rows.yaml", ["shelves"], tmp_path / "out")
    assert list(found.site.rows) == ["pass-1-left", "pass-1-right", "pass-2-right"]
    assert found.site == split.site
    assert strips_key(found, measurement_key(found, "pass-2-right")) == strips_key(
        split, measurement_key(split, "pass-2-right")
    )


def test_each_recording_is_split(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sources, "find", lambda *_, **__: SplitResult(PASSES[1:], np.zeros(0), np.zeros(0)))
    write_video(tmp_path / "recording.mkv", evenly(200, 10))
    job = recorded_job(None, ["shelves"], tmp_path, resume=True, side="left").with_rows_found(SilentMonitor())
    videos = {name: row.passes[0].video.name for name, row in job.site.rows.items()}
    assert videos == {"pass-1-right": "recording.mkv", "pass-2-right": "recording-2.mkv"}


def test_a_session_along_a_mapped_row(tmp_path: Path, plan: list[PassPlan]) -> None:
    write_map(SiteMap({"A": replace(MAPPED, name="A")}, {}), tmp_path / "earlier" / "map.json")
    video = write_video(tmp_path / "b.mp4", evenly(4, 10))
    job = live_job(video, ["shelves"], tmp_path / "out").coming_back(tmp_path / "earlier", "A")
    assert (job.walked.against, job.recorded.against_row) == (tmp_path / "earlier" / "map.json", "A")
    with LiveMapping(job.walked, job.row) as live:
        live._walk = begun(job.walked)
        live._reply = MapReply(None, "it looks alike at two places", session.SURE_UNSEEN, 1.0, is_unseen=True)
        (advice,) = live.take(panorama_after(0)).advice  # no reference is missing: the map tells the scale
    assert advice.text == "Not recognised in the earlier map: it looks alike at two places."
    with pytest.raises(SiteError, match="has no such row; it has A"):
        live_job(video, ["shelves"], tmp_path / "out").coming_back(tmp_path / "earlier", "B")
    with pytest.raises(SiteError, match="lies where this run writes its map"):
        live_job(video, ["shelves"], tmp_path / "earlier").coming_back(tmp_path / "earlier")


def test_recordings_are_never_written_over(tmp_path: Path) -> None:
    write_video(tmp_path / "recording.mkv", evenly(4, 10))
    with pytest.raises(OutputError, match=r"recording\.mkv: is an earlier session's recording; go on with --resume"):
        recorded_job(None, ["shelves"], tmp_path)
    job = recorded_job(None, ["shelves"], tmp_path, resume=True)
    assert recordings(tmp_path) == [tmp_path / "recording.mkv"]
    names = [row_pass.video.name for row_pass in job.recorded.site.rows[job.row].passes]
    assert names == ["recording.mkv", "recording-2.mkv"]
    assert job.clip.path.name == "recording-2.mkv"


def test_live_session_of_the_api(tmp_path: Path, job: Job, plan: list[PassPlan]) -> None:
    with savmap.LiveSession(None, ["shelves"], output=tmp_path / "api", camera_height_m=2.0) as live:
        for number in range(30):
            state = live.add(number / 30, picture(number))
        assert live.map() is None
        with pytest.raises(VideoError, match=r"a panorama is \(H, 2H, 3\) uint8 RGB, and this is \(4, 4, 3\) uint8"):
            live.add(2.0, np.zeros((4, 4, 3), np.uint8))
    assert 14 <= state.frames <= 16
    assert (tmp_path / "api" / "recording.mkv").stat().st_size > 1000
