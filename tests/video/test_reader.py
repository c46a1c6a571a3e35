"""Passes of video: formats, sampling by time, damage, and the one-line errors."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pytest

from savmap.errors import VideoError
from savmap.video import decode
from savmap.video.clip import too_few
from savmap.video.reader import Clip, DecodeReport, expected_frames, panoramas, preview_frames, probe

from .made_up_video import evenly, picture, write_video


@pytest.fixture
def video(tmp_path: Path) -> Path:
    return write_video(tmp_path / "pass.mp4", evenly(60, 30))


@pytest.mark.parametrize(
    ("suffix", "codec", "pixel_format"),
    [
        ("mp4", "libx264", "yuv420p"),
        ("mov", "libx264", "yuv420p10le"),
        ("mkv", "libx265", "yuv420p"),
        ("mp4", "libx265", "yuv420p10le"),
    ],
)
def test_formats_give_the_pictures(tmp_path: Path, suffix: str, codec: str, pixel_format: str) -> None:
    path = write_video(tmp_path / f"a.{suffix}", evenly(6, 15), codec, pixel_format)
    info = probe(path)
    assert (info.width, info.height, info.pixel_format) == (128, 64, pixel_format)
    assert info.codec == {"libx264": "h264", "libx265": "hevc"}[codec]
    found = list(panoramas(Clip(path), first_frame=100))
    assert [panorama.frame for panorama in found] == list(range(100, 106))
    for index, panorama in enumerate(found):
        assert np.abs(panorama.image.astype(int) - picture(index)).mean() < 4


@pytest.mark.parametrize(
    ("rate", "fps", "step"),
    [(30, 15, 2), (60, 15, 4), (29.97, 15, 2), (15, 15, 1), (10, 15, 1), (30, 30, 1), (30, 10, 3)],
)
def test_sampling_rate(tmp_path: Path, rate: float, fps: float, step: int) -> None:
    path = write_video(tmp_path / "a.mp4", evenly(40, rate))
    stamps = [panorama.stamp_s for panorama in panoramas(Clip(path, fps=fps))]
    assert np.allclose(stamps, np.arange(0, 40, step) / rate, atol=2e-3)
    assert abs(expected_frames(Clip(path, fps=fps), probe(path)) - len(stamps)) <= 1


def test_variable_frame_rate_is_sampled_by_time(tmp_path: Path) -> None:
    fast, slow = np.arange(30) / 60, 0.6 + np.arange(10) / 8
    path = write_video(tmp_path / "a.mp4", [*fast, *slow])
    stamps = np.array([panorama.stamp_s for panorama in panoramas(Clip(path, fps=15))])
    assert np.allclose(stamps, [*fast[::4], *slow], atol=2e-3)


def test_range_is_half_open_and_frame_exact(video: Path) -> None:
    whole = {p.stamp_s: p.image for p in panoramas(Clip(video, fps=30))}
    parts = [list(panoramas(Clip(video, a, b, fps=30))) for a, b in [(None, 0.5), (0.5, 1.1), (1.1, None)]]
    assert [len(part) for part in parts] == [15, 18, 27]
    for panorama in parts[0] + parts[1] + parts[2]:
        assert np.array_equal(panorama.image, whole[panorama.stamp_s])


def test_frames_come_one_at_a_time(video: Path) -> None:
    report = DecodeReport()
    stream = panoramas(Clip(video, fps=30), report=report)
    for count in range(1, 5):
        assert next(stream).frame == count - 1
        assert report.decoded == count


@pytest.mark.parametrize(
    ("start", "end", "words"),
    [
        (2.5, None, r"outside the video, 2\.00 s long"),
        (1.0, 9.0, "outside the video"),
        (-1.0, 1.0, "outside the video"),
        (1.5, 1.0, "before its start"),
    ],
)
def test_range_outside_the_video_or_backwards(video: Path, start: float, end: float | None, words: str) -> None:
    with pytest.raises(VideoError, match=words):
        next(panoramas(Clip(video, start, end)))


def _damaged(path: Path, offsets: Sequence[float], count: int) -> Path:
    """Overwrite `count` bytes at these shares of the media data."""
    data = bytearray(path.read_bytes())
    first, length = data.find(b"mdat"), int.from_bytes(data[data.find(b"mdat") - 4 : data.find(b"mdat")], "big")
    for share in offsets:
        at = first + int(length * share)
        data[at : at + count] = bytes(255 - byte for byte in data[at : at + count])
    path.write_bytes(data)
    return path


@pytest.mark.parametrize("codec", ["libx264", "libx265"])
def test_damaged_frames_are_skipped_and_counted(tmp_path: Path, codec: str, capfd: pytest.CaptureFixture[str]) -> None:
    options = {"g": "5", "preset": "ultrafast"} if codec == "libx264" else {"x265-params": "log-level=none:keyint=5"}
    path = write_video(tmp_path / "a.mp4", evenly(60, 30), codec, size=(256, 128), options=options)
    _damaged(path, [0.3, 0.6], 150)
    capfd.readouterr()
    report = DecodeReport()
    found = list(panoramas(Clip(path, fps=30), report=report))
    assert 1 <= report.skipped <= 30
    assert report.used == len(found) == report.decoded == 60 - report.skipped
    assert f"{report.skipped} damaged frames skipped" in report.text()
    assert capfd.readouterr() == ("", "")


def test_truncated_file_gives_what_it_holds(tmp_path: Path) -> None:
    path = write_video(tmp_path / "a.mkv", evenly(90, 30))
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    report = DecodeReport()
    found = list(panoramas(Clip(path), report=report))
    assert 5 < len(found) < 45
    assert report.short_s > 0.5
    assert "ends" in report.text()


def test_nothing_decodable(video: Path) -> None:
    data = bytearray(video.read_bytes())
    first = data.find(b"mdat") + 4
    length = int.from_bytes(data[first - 8 : first - 4], "big") - 8
    data[first : first + length] = bytes(length)
    video.write_bytes(data)
    with pytest.raises(VideoError, match="can be decoded"):
        list(panoramas(Clip(video)))
    with pytest.raises(VideoError, match="can be decoded"):
        preview_frames(Clip(video))


def test_missing_empty_and_no_video(tmp_path: Path) -> None:
    text, empty = tmp_path / "notes.txt", tmp_path / "empty.mp4"
    text.write_text("this is no video\n" * 50)
    empty.touch()
    for path, words in [(tmp_path / "gone.mp4", "no such file"), (text, "not a video"), (empty, "empty")]:
        with pytest.raises(VideoError, match=words) as caught:
            probe(path)
        assert "\n" not in str(caught.value)


def test_a_file_with_sound_only(tmp_path: Path) -> None:
    path = tmp_path / "sound.mp4"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("aac", rate=44100)
        frame = av.AudioFrame.from_ndarray(np.zeros((1, 1024), np.float32), format="fltp", layout="mono")
        frame.sample_rate = 44100
        container.mux(stream.encode(frame))
        container.mux(stream.encode())
    with pytest.raises(VideoError, match="no video stream"):
        probe(path)


def test_not_two_to_one(tmp_path: Path) -> None:
    path = write_video(tmp_path / "flat.mp4", evenly(3, 30), size=(160, 90))
    with pytest.raises(VideoError, match="160x90, not 2:1"):
        probe(path)


def write_pictures(folder: Path, count: int, repeated: int = 1) -> Path:
    folder.mkdir()
    for index in range(count):
        shown = picture(index - index % repeated)
        cv2.imwrite(str(folder / f"{index:04}.png"), cv2.cvtColor(shown, cv2.COLOR_RGB2BGR))
    return folder


def test_folder_of_pictures(tmp_path: Path) -> None:
    folder = write_pictures(tmp_path / "pictures", 20)
    found = list(panoramas(Clip(folder, 0.2, fps=5, images_fps=10)))
    assert [panorama.stamp_s for panorama in found] == pytest.approx(np.arange(0.2, 2, 0.2))
    assert np.array_equal(found[1].image, picture(4))
    assert probe(folder, 10).duration_s == pytest.approx(2.0)


def test_damaged_pictures_are_skipped_and_counted(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    folder = write_pictures(tmp_path / "pictures", 10)
    cv2.imwrite(str(folder / "0003.jpg"), picture(3))
    (folder / "0003.png").unlink()
    (folder / "0003.jpg").write_bytes((folder / "0003.jpg").read_bytes()[:900])
    (folder / "0005.png").write_bytes(b"no picture")
    cv2.imwrite(str(folder / "0007.png"), picture(7, 64, 32))
    report = DecodeReport()
    found = list(panoramas(Clip(folder, images_fps=10), report=report))
    assert [round(panorama.stamp_s * 10) for panorama in found] == [0, 1, 2, 4, 6, 8, 9]
    assert (report.decoded, report.skipped, report.used) == (7, 3, 7)
    assert capfd.readouterr() == ("", "")


def test_a_folder_with_few_pictures_is_told_how_they_are_counted(tmp_path: Path) -> None:
    assert "a folder's pictures count as 30 a second: `fps: 30` takes them all" in too_few(Clip(tmp_path), 2, "pass 1")
    for clip in (Clip(tmp_path, fps=30.0), Clip(tmp_path / "a.mp4")):
        assert too_few(clip, 2, "pass 1").endswith("2 frames in the range of pass 1 are too few to map from")


def test_folder_errors(tmp_path: Path) -> None:
    (tmp_path / "none").mkdir()
    with pytest.raises(VideoError, match="holds no pictures"):
        probe(tmp_path / "none")
    (tmp_path / "none" / "a.png").write_bytes(b"x")
    with pytest.raises(VideoError, match="none of the 1 pictures"):
        probe(tmp_path / "none")
    (tmp_path / "flat").mkdir()
    cv2.imwrite(str(tmp_path / "flat" / "a.png"), picture(0, 90, 60))
    with pytest.raises(VideoError, match="90x60, not 2:1"):
        probe(tmp_path / "flat")


@pytest.mark.parametrize("kind", ["video", "folder"])
def test_scouting_takes_key_frames_and_close_pairs(tmp_path: Path, video: Path, kind: str) -> None:
    path = video if kind == "video" else write_pictures(tmp_path / "pictures", 60)
    keys, pairs = preview_frames(Clip(path), keys=6, pairs=2, max_height=32)
    stamps = np.array([key.stamp_s for key in keys])
    assert np.allclose(stamps, 2 * (np.arange(6) + 0.5) / 6, atol=0.04)
    assert [b.stamp_s - a.stamp_s for a, b in pairs] == pytest.approx([1 / 15, 1 / 15], abs=0.02)
    assert all(key.image.shape == (32, 64, 3) for key in keys)
    expected = cv2.resize(picture(round(stamps[3] * 30)), (64, 32), interpolation=cv2.INTER_AREA)
    assert np.abs(keys[3].image.astype(int) - expected).mean() < 4


def test_scouting_decodes_key_frames_alone_where_they_are_close(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two hundred frames, a key frame every ten: five wanted and three that follow cost what lies next to them."""
    coding = {"x265-params": "log-level=none:keyint=10:min-keyint=10:scenecut=0:bframes=0"}
    path = write_video(tmp_path / "a.mp4", evenly(200, 30), "libx265", options=coding)
    inner, decoded, packets = decode._frames, list[float](), list[set[float]]()

    def counted(container: Any, stream: Any, expected: set[float]) -> Iterator[Any]:
        packets.append(expected)
        for frame in inner(container, stream, expected):
            decoded.append(frame[0])
            yield frame

    monkeypatch.setattr(decode, "_frames", counted)
    keys, pairs = preview_frames(Clip(path))
    stamps = np.array([key.stamp_s for key in keys])
    assert np.allclose(np.round(stamps * 3), stamps * 3, atol=0.01)
    assert np.abs(stamps - 200 / 30 * (np.arange(5) + 0.5) / 5).max() <= 0.2
    assert [b.stamp_s - a.stamp_s for a, b in pairs] == pytest.approx([1 / 15] * 3, abs=0.01)
    assert len(decoded) == 5 + 2 * 3
    assert sum(map(len, packets)) <= len(decoded) + 1


@pytest.mark.parametrize("repeated", [4, 60])
def test_pairs_of_repeated_frames_are_taken_further_apart(tmp_path: Path, repeated: int) -> None:
    """Frames that never differ are previewed all the same."""
    folder = write_pictures(tmp_path / "pictures", 60, repeated)
    keys, pairs = preview_frames(Clip(folder, images_fps=15.0))
    assert (len(keys), len(pairs)) == (5, 3)
    assert any(np.abs(b.image.astype(int) - a.image).mean() > 1 for a, b in pairs) == (repeated < 60)


def test_fewer_frames_than_the_header_says_are_paired_all_the_same(tmp_path: Path) -> None:
    """The header says 30 Hz, and a frame comes every sixth of a second."""
    path = write_video(tmp_path / "a.mkv", evenly(24, 6))
    assert probe(path).rate_fps == pytest.approx(30.0)
    keys, pairs = preview_frames(Clip(path))
    assert len(keys) == 5
    assert [b.stamp_s - a.stamp_s for a, b in pairs] == pytest.approx([1 / 6] * 3, abs=0.01)


@pytest.mark.parametrize("suffix", ["mkv", "ts"])
def test_a_recording_that_begins_at_one_hour(tmp_path: Path, suffix: str) -> None:
    """As editing programs and streams write them: times count from the first frame, and so does the length."""
    path = write_video(tmp_path / f"a.{suffix}", [3600 + stamp for stamp in evenly(60, 30)])
    assert probe(path).duration_s == pytest.approx(2.0, abs=0.1)
    report = DecodeReport()
    stamps = [panorama.stamp_s for panorama in panoramas(Clip(path, 1.0, fps=30), report=report)]
    assert np.allclose(stamps, 1 + np.arange(30) / 30, atol=2e-3)
    assert report.complete
    keys, pairs = preview_frames(Clip(path))
    assert len(keys) == 5
    assert len(pairs) == 3
