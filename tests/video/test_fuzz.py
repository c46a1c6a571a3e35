"""Broken media: every file ends in a clear error or in frames with a report."""

import struct
from pathlib import Path

import numpy as np
import pytest

from savmap.errors import VideoError
from savmap.video.clip import Clip, DecodeReport, VideoInfo
from savmap.video.container import BELIEVED_AFTER, in_order
from savmap.video.reader import panoramas, preview_frames, probe

from . import broken_media as broken

INFO = VideoInfo(Path("a.ts"), 128, 64, "h264", "yuv420p", 30.0, 60.0)


@pytest.mark.parametrize("kind", broken.KINDS)
def test_broken_files_end_in_a_clear_error_or_a_report(
    tmp_path: Path, kind: str, capfd: pytest.CaptureFixture[str]
) -> None:
    path = broken.KINDS[kind](tmp_path, np.random.default_rng([7, *kind.encode()]))
    capfd.readouterr()
    broken.walk(path)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(("codec", "container"), broken.BASES)
def test_sound_files_come_whole(tmp_path: Path, codec: str, container: str) -> None:
    found = broken.walk(broken.put(tmp_path, f"a.{container}", broken.base(codec, container)))
    assert (found.outcome, found.frames, found.smeared) == ("whole", broken.FRAMES, 0)


def test_play_lists_open_no_other_file(tmp_path: Path) -> None:
    broken.put(tmp_path, "other.mp4", broken.base("libx264", "mp4"))
    for text in broken.PLAYLISTS[:2]:
        with pytest.raises(VideoError, match="not a video file"):
            probe(broken.put(tmp_path, "list.mp4", text.replace("{}", "other.mp4").encode()))


def test_pipes_and_devices_are_refused(tmp_path: Path) -> None:
    path = broken.KINDS["named pipe"](tmp_path, np.random.default_rng(20))
    with pytest.raises(VideoError, match="device or a pipe"):
        probe(path)


def test_absurd_sizes_are_refused_before_any_memory_is_taken(tmp_path: Path) -> None:
    folder = tmp_path / "pictures"
    folder.mkdir()
    for width, words in [(18000, "18000x9000; at most 16384x8192"), (60000, "far too large")]:
        broken.put(folder, "a.png", broken.png(width, width // 2, 2))
        with pytest.raises(VideoError, match=words):
            probe(folder)
    data = bytearray(broken.base("mjpeg", "mov"))
    first = data.index(b"\xff\xc0") + 5
    data[first : first + 4] = struct.pack(">HH", 16000, 32000)
    report = DecodeReport()
    found = list(panoramas(Clip(broken.put(tmp_path, "a.mov", data), fps=30), report=report))
    assert (len(found), report.skipped) == (broken.FRAMES - 1, 1)


def test_one_frame_is_found_by_scouting(tmp_path: Path) -> None:
    keys, pairs = preview_frames(Clip(broken.encode(tmp_path / "a.mp4", count=1)))
    assert (len(keys), len(pairs)) == (1, 0)


def test_damage_skips_frames_up_to_the_next_key_frame(tmp_path: Path) -> None:
    path = broken.put(tmp_path, "a.mp4", broken.base("libx264", "mp4"))
    data = bytearray(path.read_bytes())
    at = data.index(b"mdat") + 4
    third = (len(data) - at) // 3
    data[at + third : at + third + 40] = bytes(40)
    path.write_bytes(data)
    report = DecodeReport()
    found = list(panoramas(Clip(path, fps=30), report=report))
    assert report.skipped == broken.FRAMES - len(found) > 1
    assert not any(broken.is_smeared(one) for one in found)


def test_a_gap_is_told(tmp_path: Path) -> None:
    path = broken.encode(tmp_path / "a.mkv", "mjpeg", stamps=lambda index: index / 30 + (4 if index > 20 else 0))
    report = DecodeReport()
    assert len(list(panoramas(Clip(path, fps=30), report=report))) == broken.FRAMES
    assert not report.complete
    assert "no frame for 4.0 s" in report.text()


@pytest.mark.parametrize(
    ("stamps", "follow"),
    [
        ([0, 1, 2, 3], [0, 1, 2, 3]),
        ([0, 1, 500, 2, 3], [0, 1, 2, 3]),
        ([0, 1, 0.5, 1, 2], [0, 1, 2]),
        ([500, 0, 1], [0, 1]),
        ([0, *range(100, 100 + BELIEVED_AFTER + 2)], [0, 100 + BELIEVED_AFTER, 101 + BELIEVED_AFTER]),
        ([0, 1, 500, *range(2, 12)], [0, *range(1, 12)]),
        ([50, *range(BELIEVED_AFTER), 51], [50, 51]),
        ([50, 4, 3, 2, 1, 0, 4, 3, 2, 1, 51], [50, 51]),
    ],
)
def test_times_that_leap_or_go_back_are_not_believed(stamps: list[float], follow: list[float]) -> None:
    given = ((float(stamp), stamp) for stamp in stamps)
    assert [stamp for stamp, _, follows in in_order(given, 45.0 if stamps[0] == 50 else 0.0, INFO) if follows] == follow


def test_times_that_begin_again_are_another_recording_s() -> None:
    given = ((float(stamp), stamp) for stamp in [*range(9), *range(BELIEVED_AFTER + 1)])
    with pytest.raises(
        VideoError, match=r"a.ts: holds two recordings.*: the times begin again after 8\.0 s; give each"
    ):
        list(in_order(given, 0.0, INFO))
