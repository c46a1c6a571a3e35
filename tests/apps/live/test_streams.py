"""Footage that is still being made: folders that grow, cameras, and panoramas that are handed over."""

import threading
import time
from collections.abc import Callable, Iterator
from itertools import count, pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import av
import cv2
import numpy as np
import pytest

from savmap.apps.live import streams
from savmap.apps.live.streams import FrameRecorder, camera_frames, growing_folder, paced
from savmap.errors import OutputError, VideoError
from savmap.types import Panorama
from savmap.video.clip import Clip
from savmap.video.reader import panoramas

from ...video.made_up_video import evenly, picture, write_video


def fill(folder: Path, count: int, pause_s: float = 0.0) -> None:
    for number in range(count):
        cv2.imwrite(str(folder / f"{number:04d}.png"), picture(number))
        time.sleep(pause_s)


def test_growing_folder_gives_what_a_run_over_it_reads(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Time stands while pictures are written."""
    clip, ticks = Clip(tmp_path, fps=15, images_fps=30), count(0.0, 0.3)
    writer = threading.Thread(target=fill, args=(tmp_path, 12, 0.02))
    clock = SimpleNamespace(monotonic=lambda: 0.0 if writer.is_alive() else next(ticks), sleep=time.sleep)
    monkeypatch.setattr(streams, "time", clock)
    writer.start()
    came = list(growing_folder(clip, 1.0))
    writer.join()
    read = list(panoramas(clip))
    assert [(item.frame, item.stamp_s) for item in came] == [(item.frame, item.stamp_s) for item in read]
    assert all(np.array_equal(a.image, b.image) for a, b in zip(came, read, strict=True))


def test_picture_that_is_still_written_is_waited_for(tmp_path: Path) -> None:
    fill(tmp_path, 2)
    content = (tmp_path / "0001.png").read_bytes()
    (tmp_path / "0001.png").write_bytes(content[: len(content) // 2])
    frames = growing_folder(Clip(tmp_path, fps=30), 600.0)
    assert next(frames).frame == 0
    threading.Timer(0.1, (tmp_path / "0001.png").write_bytes, [content]).start()
    assert np.array_equal(next(frames).image, cv2.cvtColor(picture(1), cv2.COLOR_BGR2RGB))


def test_folder_in_which_nothing_comes(tmp_path: Path) -> None:
    with pytest.raises(VideoError, match=r"no picture came within 0\.1 s; write panoramas into it, or raise --idle"):
        next(growing_folder(Clip(tmp_path), 0.1))


def test_picture_in_a_growing_folder_that_is_no_panorama(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "0.png"), picture(0, 100, 80))
    with pytest.raises(VideoError, match="100x80, not 2:1"):
        next(growing_folder(Clip(tmp_path), 1.0))


def test_camera_is_recorded_as_it_comes(tmp_path: Path) -> None:
    """A file takes the camera's place: FFmpeg opens both alike."""
    video, recording = write_video(tmp_path / "a.mp4", evenly(20, 25)), tmp_path / "recording.mkv"
    came = list(camera_frames(str(video), recording, 30.0))
    read = list(panoramas(Clip(recording, fps=30)))
    assert [item.frame for item in came] == list(range(20))
    assert len(read) == 19, "the last packet may be cut off"
    for item in read:
        same = min(came, key=lambda other: abs(other.stamp_s - item.stamp_s))
        assert item.stamp_s == pytest.approx(same.stamp_s, abs=2e-3)
        assert np.array_equal(item.image, same.image)


class Odd:
    """A camera whose packets have other times than its own."""

    def __init__(self, source: Any, times: Callable[[int], int | None]) -> None:
        self.source, self.times = source, times

    def __getattr__(self, name: str) -> Any:
        return getattr(self.source, name)

    def __enter__(self) -> "Odd":
        return self

    def __exit__(self, *_: object) -> None:
        self.source.close()

    def demux(self, stream: Any) -> Iterator[Any]:
        for number, packet in enumerate(packet for packet in self.source.demux(stream) if packet.size):
            packet.pts = packet.dts = self.times(number)
            yield packet


FRAME = 600
"""A frame's time in ticks of the video."""
TIMES: dict[str, Callable[[int], int | None]] = {
    "stand still": lambda number: 7,
    "step back": lambda number: FRAME * (number if number < 10 else number - 10),
    "step back again and again": lambda number: FRAME * (number % 3),
    "jump ahead": lambda number: FRAME * number + (0 if number < 10 else 10**9),
    "missing": lambda number: None,
    "missing now and then": lambda number: FRAME * number if number % 2 else None,
}


@pytest.mark.parametrize("times", TIMES)
def test_camera_with_odd_times_is_recorded_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, times: str
) -> None:
    video = write_video(tmp_path / "a.mp4", evenly(20, 25), options={"g": "10", "bf": "0"})
    opened = av.open

    def camera(file: str, mode: str = "r", *given: Any, **options: Any) -> Any:
        made = opened(file, mode, *given, **options)
        return Odd(made, TIMES[times]) if file == str(video) else made

    monkeypatch.setattr("savmap.apps.live.streams.av.open", camera)
    came = list(camera_frames(str(video), tmp_path / "recording.mkv", 30.0))
    monkeypatch.undo()
    assert len(came) == 20
    assert all(a.stamp_s < b.stamp_s < a.stamp_s + 5 for a, b in pairwise(came))
    assert len(list(panoramas(Clip(tmp_path / "recording.mkv", fps=30)))) == 19
    assert [record.message for record in caplog.records] == [
        "the camera's times are missing, stand still or jump: pictures count from when they came"
    ]


def test_camera_without_times_is_recorded_whole(tmp_path: Path) -> None:
    video = write_video(tmp_path / "a.h264", evenly(20, 25), options={"g": "10", "bf": "0"})
    assert len(list(camera_frames(str(video), tmp_path / "recording.mkv", 30.0))) == 20
    assert len(list(panoramas(Clip(tmp_path / "recording.mkv", fps=30)))) == 19


def test_camera_that_cannot_be_opened(tmp_path: Path) -> None:
    with pytest.raises(VideoError, match=r"rtsp://127\.0\.0\.1:9/x: cannot be opened .*; is the camera on"):
        next(camera_frames("rtsp://127.0.0.1:9/x", tmp_path / "recording.mkv", 15.0))
    assert not (tmp_path / "recording.mkv").exists()


def test_camera_that_sends_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("savmap.apps.live.streams.OPENING_S", 0.2)
    with pytest.raises(VideoError, match=r"cannot be opened \(nothing came for 0\.2 s\); is the camera on"):
        next(camera_frames("udp://127.0.0.1:0", tmp_path / "recording.mkv", 15.0))


def test_recording_that_cannot_be_written(tmp_path: Path) -> None:
    video = write_video(tmp_path / "a.mp4", evenly(3, 25))
    with pytest.raises(OutputError, match="the recording cannot be written"):
        next(camera_frames(str(video), tmp_path / "absent" / "recording.mkv", 15.0))


def test_panoramas_that_are_handed_over_are_recorded_with_their_times(tmp_path: Path) -> None:
    recorder, stamps = FrameRecorder(tmp_path / "recording.mkv"), [0.0, 0.2, 0.25, 0.9]
    for number, stamp in enumerate(stamps):
        recorder.write(stamp, picture(number))
    with pytest.raises(VideoError, match="times must ascend"):
        recorder.write(0.9, picture(4))
    recorder.close()
    read = list(panoramas(Clip(tmp_path / "recording.mkv", fps=60)))
    assert np.allclose([item.stamp_s for item in read], stamps, atol=1e-3)
    assert max(int(np.abs(item.image.astype(int) - picture(n)).max()) for n, item in enumerate(read)) < 24


def test_recording_that_is_cut_off_can_be_read(tmp_path: Path) -> None:
    path = tmp_path / "recording.mkv"
    recorder = FrameRecorder(path)
    for number in range(90):
        recorder.write(number / 30, picture(number))
    cut = tmp_path / "cut.mkv"
    cut.write_bytes(path.read_bytes())  # the file is never ended
    assert len(list(panoramas(Clip(cut, fps=30)))) >= 30


def test_file_is_played_at_its_pace() -> None:
    frames = [Panorama(number, number / 10, picture(number)) for number in range(4)]
    begun = time.monotonic()
    assert [item.frame for item in paced(frames, 2.0)] == [0, 1, 2, 3]
    assert time.monotonic() - begun >= 0.14
