"""Broken media: every file ends in a clear error or in frames with a report."""

import struct
import sys
from pathlib import Path

import numpy as np
import pytest

BENCH = Path(__file__).parent.parent.parent / "bench"
sys.path.insert(0, str(BENCH))

import broken  # noqa: E402
import broken_headers  # noqa: E402
import broken_streams  # noqa: E402
import broken_things  # noqa: E402
import fuzz_walk  # noqa: E402

from savmap.errors import VideoError  # noqa: E402
from savmap.video.clip import Clip, DecodeReport, VideoInfo  # noqa: E402
from savmap.video.container import BELIEVED_AFTER, in_order  # noqa: E402
from savmap.video.reader import panoramas, preview_frames, probe  # noqa: E402

INFO = VideoInfo(Path("a.ts"), 128, 64, "h264", "yuv420p", 30.0, 60.0)
MAKERS = {**broken.BYTEWISE, **broken_headers.HEADERS, **broken_streams.STREAMS, **broken_things.THINGS}
KINDS = (
    *("cut off", "bits flipped", "head damaged", "block missing", "blocks swapped"),
    *("mp4 edit list", "mp4 box sizes", "mp4 picture size in header", "mkv times", "mkv header", "ts packets"),
    *("packets mixed up", "packets of rubbish", "one time leaps", "times go back", "times random"),
    *("few frames", "size changes", "sizes of motion jpeg"),
)
"""Each way in which a file breaks; `bench/fuzz.py` has all."""


@pytest.mark.parametrize("kind", KINDS)
def test_broken_files_end_in_a_clear_error_or_a_report(
    tmp_path: Path, kind: str, capfd: pytest.CaptureFixture[str]
) -> None:
    path = MAKERS[kind](tmp_path, np.random.default_rng([7, *kind.encode()]))
    capfd.readouterr()
    assert fuzz_walk.walk(path).outcome in ("refused", "reported", "whole")
    assert capfd.readouterr() == ("", "")
    assert fuzz_walk.peak_mb() < 4000


@pytest.mark.parametrize(("codec", "container"), broken.BASES)
def test_sound_files_come_whole(tmp_path: Path, codec: str, container: str) -> None:
    found = fuzz_walk.walk(broken.put(tmp_path, f"a.{container}", broken.base(codec, container)))
    assert (found.outcome, found.frames, found.smeared) == ("whole", broken.FRAMES, 0)


def test_play_lists_open_no_other_file(tmp_path: Path) -> None:
    broken.put(tmp_path, "other.mp4", broken.base("libx264", "mp4"))
    for text in broken_things.PLAYLISTS[:2]:
        with pytest.raises(VideoError, match="not a video file"):
            probe(broken.put(tmp_path, "list.mp4", text.replace("{}", "other.mp4").encode()))


def test_pipes_and_devices_are_refused(tmp_path: Path) -> None:
    path = broken_things.THINGS["named pipe"](tmp_path, np.random.default_rng(20))
    with pytest.raises(VideoError, match="device or a pipe"):
        probe(path)


def test_absurd_sizes_are_refused_before_any_memory_is_taken(tmp_path: Path) -> None:
    folder = tmp_path / "pictures"
    folder.mkdir()
    for width, words in [(18000, "18000x9000; at most 16384x8192"), (60000, "far too large")]:
        broken.put(folder, "a.png", broken_things.png(width, width // 2, 2))
        with pytest.raises(VideoError, match=words):
            probe(folder)
    before = fuzz_walk.peak_mb()
    data = bytearray(broken.base("mjpeg", "mov"))
    first = data.index(b"\xff\xc0") + 5
    data[first : first + 4] = struct.pack(">HH", 16000, 32000)
    report = DecodeReport()
    found = list(panoramas(Clip(broken.put(tmp_path, "a.mov", data), fps=30), report=report))
    assert (len(found), report.skipped) == (broken.FRAMES - 1, 1)
    assert fuzz_walk.peak_mb() < before + 200


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
    assert not any(fuzz_walk.is_smeared(one) for one in found)


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
