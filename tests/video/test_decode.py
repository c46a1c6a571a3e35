"""Decoding: frames as planes show what the same frames show in RGB; frames at chosen times cost few others."""

from pathlib import Path

import av
import numpy as np
import pytest
from av.video.reformatter import VideoReformatter

from savmap.types import FilmedPanorama, Planes
from savmap.video.clip import DecodeReport
from savmap.video.container import exact_key_times, probe_file
from savmap.video.decode import frames_from, picture_of, rgb_from_yuv
from savmap.video.reader import Clip, panoramas, preview_frames

from .made_up_video import evenly, picture, write_video

BT601, BT709, SMPTE240 = 5, 1, 7


def frame_of(name: str, space: int, full: bool, size: tuple[int, int] = (256, 128)) -> av.VideoFrame:
    """A frame of slowly changing values of luma and colour that all stand for colours."""
    width, height = size
    rng = np.random.default_rng(4)
    luma = rng.integers(70, 180, (height // 8, width // 8)).repeat(8, 0).repeat(8, 1)
    blue, red = (rng.integers(108, 148, (height // 8, width // 8)).repeat(4, 0).repeat(4, 1) for _ in range(2))
    flat = np.concatenate([plane.ravel() for plane in (luma, blue, red)]).astype(np.uint8)
    frame = av.VideoFrame.from_ndarray(flat.reshape(height * 3 // 2, width), format="yuv420p")
    frame = frame.reformat(format=name) if name != "yuv420p" else frame
    frame.colorspace, frame.color_range = space, 2 if full else 1
    return frame


@pytest.mark.parametrize("full", [False, True])
@pytest.mark.parametrize("space", [BT601, BT709, 2])
def test_colours_are_those_of_the_converter(space: int, full: bool) -> None:
    frame = frame_of("yuv420p", space, full)
    planes = picture_of(frame, VideoReformatter())
    assert isinstance(planes, Planes)
    theirs = VideoReformatter().reformat(frame, format="rgb24").to_ndarray().astype(int)
    difference = planes.rgb.astype(int) - theirs
    assert np.abs(difference).max() <= 4  # the converter is quick and cuts its results off
    assert np.abs(difference).mean() < 1.5


def test_planes_lie_in_the_frame_and_are_the_same_from_a_device() -> None:
    frame = frame_of("yuv420p", BT709, False, (208, 104))
    theirs = frame.reformat(format="nv12")
    planes, other = (picture_of(each, VideoReformatter()) for each in (frame, theirs))
    assert theirs.format.name == "nv12"
    assert isinstance(planes, Planes)
    assert isinstance(other, Planes)
    for name in ("luma", "blue", "red"):
        assert np.array_equal(getattr(planes, name), getattr(other, name))
    assert planes.luma.shape == (104, 208)
    assert np.shares_memory(planes.luma, np.frombuffer(memoryview(frame.planes[0]), np.uint8))


@pytest.mark.parametrize(("name", "space"), [("yuv444p", BT601), ("yuv420p", SMPTE240)])
def test_other_frames_come_as_rgb(name: str, space: int) -> None:
    found = picture_of(frame_of(name, space, False), VideoReformatter())
    assert isinstance(found, np.ndarray)
    assert found.shape == (128, 256, 3)


@pytest.mark.parametrize("full", [False, True])
def test_matrix_converts_black_white_and_primaries(full: bool) -> None:
    matrix = rgb_from_yuv(0.2126, 0.0722, full)
    low, high, half = (0, 255, 127.5) if full else (16, 235, 112)
    assert matrix @ [low, 128, 128, 1] == pytest.approx([0, 0, 0], abs=1e-6)
    assert matrix @ [high, 128, 128, 1] == pytest.approx([255, 255, 255], abs=1e-6)
    luma = low + 0.2126 * (high - low)
    assert matrix @ [luma, 128 - half * 0.2126 / 0.9278, 128 + half, 1] == pytest.approx([255, 0, 0], abs=1e-6)


def test_a_video_s_panoramas_make_their_picture_when_asked(tmp_path: Path) -> None:
    path = write_video(tmp_path / "a.mp4", evenly(6, 15))
    found = list(panoramas(Clip(path)))
    for index, panorama in enumerate(found):
        assert isinstance(panorama, FilmedPanorama)
        assert "image" not in vars(panorama)
        assert panorama.height == 64
        assert panorama.image is panorama.image
        assert np.abs(panorama.image.astype(int) - picture(index)).mean() < 4


def test_shrunk_key_frames_stay_planes(tmp_path: Path) -> None:
    path = write_video(tmp_path / "a.mp4", evenly(60, 30))
    keys, _ = preview_frames(Clip(path), keys=3, pairs=1, max_height=60)
    assert all(isinstance(key, FilmedPanorama) and key.planes.blue.shape == (16, 32) for key in keys)


def plain_video(path: Path, b_frames: int = 0) -> Path:
    """Two hundred frames, a key frame every ten."""
    coding = f"log-level=none:keyint=10:min-keyint=10:scenecut=0:bframes={b_frames}"
    return write_video(path, evenly(200, 30), "libx265", options={"x265-params": coding})


def test_frames_at_key_frames_cost_one_each(tmp_path: Path) -> None:
    info, report = probe_file(plain_video(tmp_path / "a.mp4")), DecodeReport()
    keys = exact_key_times(info)
    np.testing.assert_allclose(keys, np.arange(20) / 3, atol=1e-3)
    found = [next(frames)[0] for frames in frames_from(info, keys[[2, 5, 6]].tolist(), report=report)]
    assert found == keys[[2, 5, 6]].tolist()
    assert report.decoded == 3


def test_no_frame_is_decoded_twice(tmp_path: Path) -> None:
    info, report = probe_file(plain_video(tmp_path / "a.mp4")), DecodeReport()
    wanted = [0.1, 0.15, 0.3, 4.0]
    found = [next(frames)[0] for frames in frames_from(info, wanted, margin_s=0, report=report)]
    assert found == pytest.approx([0.1, 5 / 30, 0.3, 4.0], abs=1e-3)
    assert report.decoded == 10 + 1


def test_with_b_frames_the_first_frame_in_time_is_found(tmp_path: Path) -> None:
    info = probe_file(plain_video(tmp_path / "a.mp4", b_frames=3))
    assert not len(exact_key_times(info))
    wanted = [1 / 3, 61 / 30, 121 / 30]
    found = [next(frames)[0] for frames in frames_from(info, wanted)]
    assert found == pytest.approx(wanted, abs=1e-3)
