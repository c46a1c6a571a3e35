"""What files say of their camera: refused with words where it is no upright panorama of one eye."""

from pathlib import Path

import av
import numpy as np
import pytest

from savmap.errors import VideoError
from savmap.pipeline.trust.footage import require_panoramas
from savmap.site.sections import CameraSection
from savmap.video.reader import Clip, check_camera, preview_frames, probe, probe_clip

from .made_up_video import demos_beginning, evenly, refilmed, write_video
from .spherical_boxes import CUBE_MAP, EQUIRECTANGULAR, HALF, TO_SAMPLE, TO_TRACK, insert, sphere, stereo, v1

STITCHED = {"Spherical": "true", "Stitched": "true", "StitchingSoftware": "a", "ProjectionType": "equirectangular"}


@pytest.fixture
def video(tmp_path: Path) -> Path:
    return write_video(tmp_path / "a.mp4", evenly(12, 30))


@pytest.mark.parametrize(
    ("boxes", "words"),
    [
        (stereo(2) + sphere(EQUIRECTANGULAR), "stereo by its metadata .left and right eye side by side."),
        (stereo(1) + sphere(EQUIRECTANGULAR), "one another"),
        (sphere(CUBE_MAP), "holds a cube map"),
        (sphere(HALF), "a part of a panorama"),
        (sphere(EQUIRECTANGULAR, roll=180), "tilted by 180 degrees"),
        (sphere(EQUIRECTANGULAR, pitch=-90), "tilted by 90 degrees"),
        (v1(**STITCHED, StereoMode="left-right"), "stereo"),
        (stereo(0) + sphere(EQUIRECTANGULAR, yaw=170, pitch=20, roll=-15), None),
        (v1(**STITCHED, StereoMode="mono"), None),
        (b"", None),
    ],
)
def test_what_is_no_upright_panorama_is_refused(video: Path, boxes: bytes, words: str | None) -> None:
    insert(video, boxes, TO_TRACK if b"uuid" in boxes else TO_SAMPLE)
    if words is None:
        assert preview_frames(Clip(video))[0]
        return
    with pytest.raises(VideoError, match=words):
        preview_frames(Clip(video))


def streams(path: Path, *sizes: tuple[int, int], degrees: float = 0.0, mirrored: bool = False) -> Path:
    """A video with a stream of each size; the first stream's pictures are `10 i` grey, the second's 100 more."""
    with av.open(str(path), "w") as container:
        opened = []
        for width, height in sizes:
            stream = container.add_stream("libx264", rate=30)
            stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
            stream.set_display_rotation(degrees, hflip=mirrored)
            opened.append(stream)
        for index in range(10):
            for number, stream in enumerate(opened):
                grey = np.full((stream.height, stream.width, 3), 10 * index + 100 * number, np.uint8)
                container.mux(stream.encode(av.VideoFrame.from_ndarray(grey, format="rgb24")))
        for stream in opened:
            container.mux(stream.encode())
    return path


@pytest.mark.parametrize(
    ("suffix", "degrees", "mirrored", "words"), [("mp4", 180, False, "turned by 180"), ("mkv", 0, True, "mirrored")]
)
def test_a_flag_to_turn_is_refused(tmp_path: Path, suffix: str, degrees: float, mirrored: bool, words: str) -> None:
    path = streams(tmp_path / f"a.{suffix}", (128, 64), degrees=degrees, mirrored=mirrored)
    with pytest.raises(VideoError, match=words):
        preview_frames(Clip(path))


@pytest.mark.parametrize("sizes", [[(64, 32), (128, 64)], [(128, 64), (64, 32)], [(96, 96), (128, 64)]])
def test_the_stream_with_the_panoramas_is_read(tmp_path: Path, sizes: list[tuple[int, int]]) -> None:
    path = streams(tmp_path / "a.mp4", *sizes)
    assert probe(path).width == 128
    keys, _ = preview_frames(Clip(path))
    assert all((key.image.mean() > 95) == (sizes[1] == (128, 64)) for key in keys)


def test_two_streams_of_one_size_are_refused(tmp_path: Path) -> None:
    with pytest.raises(VideoError, match=r"2 video streams .* stitch"):
        probe(streams(tmp_path / "a.mp4", (64, 64), (64, 64)))


def test_whole_panoramas_are_no_other_cameras_pictures(tmp_path: Path) -> None:
    panoramic = demos_beginning(tmp_path / "a.mp4", 0.5)
    check_camera(Clip(panoramic), probe(panoramic))
    for model in ("pinhole", "fisheye", "fisheye-pair"):
        clip = Clip(panoramic, camera=CameraSection(model=model))
        with pytest.raises(VideoError, match="seem to be whole panoramas: leave `camera` out"):
            check_camera(clip, probe_clip(clip))


@pytest.mark.parametrize("model", ["pinhole", "fisheye-pair"])
def test_pictures_of_other_cameras_are_theirs(tmp_path: Path, model: str) -> None:
    """Twice as wide as high, too."""
    section = CameraSection(model=model)
    beginning = demos_beginning(tmp_path / "a.mp4", 0.5)
    clip = Clip(refilmed(beginning, tmp_path / "b.mp4", section.camera(512, 256)), camera=section)
    check_camera(clip, probe_clip(clip))
    taken_for_panoramas = preview_frames(Clip(clip.path), keys=1, pairs=0)[0]
    with pytest.raises(VideoError):
        require_panoramas(Clip(clip.path), taken_for_panoramas)
