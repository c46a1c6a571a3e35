"""Small videos of smooth pictures with given time stamps."""

from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np

from savmap.geometry.cameras import Camera, Equirectangular

DEMO = Path(__file__).parents[2] / "savmap" / "demo" / "aisle-dev.mp4"
H264 = {"g": "10"}
H265 = {"x265-params": "log-level=none:keyint=10"}


def picture(index: int, width: int = 128, height: int = 64) -> np.ndarray:
    """A smooth coloured picture that differs from frame to frame."""
    x, y = np.meshgrid(np.linspace(0, 2 * np.pi, width), np.linspace(0, 1, height))
    channels = [128 + 90 * np.sin(x + index / 5), 40 + 170 * y, 128 + 90 * np.cos(2 * x - index / 7)]
    return np.stack(channels, axis=-1).astype(np.uint8)


def write_video(
    path: Path,
    stamps: Sequence[float],
    codec: str = "libx264",
    pixel_format: str = "yuv420p",
    size: tuple[int, int] = (128, 64),
    options: dict[str, str] | None = None,
) -> Path:
    options = options or (H265 if codec == "libx265" else H264)
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=30, options=options)
        stream.width, stream.height = size
        stream.pix_fmt = pixel_format
        stream.codec_context.time_base = Fraction(1, 9000)
        for index, stamp in enumerate(stamps):
            frame = av.VideoFrame.from_ndarray(picture(index, *size), format="rgb24")
            frame.pts, frame.time_base = round(stamp * 9000), Fraction(1, 9000)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


def demos_beginning(path: Path, seconds: float) -> Path:
    """The first seconds of the demo's clip, its packets as they are."""
    with av.open(str(DEMO)) as whole, av.open(str(path), "w") as part:
        filmed = whole.streams.video[0]
        written = part.add_stream_from_template(filmed)
        for packet in whole.demux(filmed):
            if packet.dts is not None and packet.dts * packet.time_base < seconds:
                packet.stream = written
                part.mux(packet)
    return path


def seen_by(camera: Camera, panorama: np.ndarray) -> np.ndarray:
    """What a camera in the middle of a panorama (H, 2H, 3) sees of it, black where it sees nothing."""
    y, x = np.mgrid[0 : camera.height, 0 : camera.width]
    rays = camera.rays(np.stack([x, y], axis=-1).astype(float))
    seen = np.isfinite(rays[..., 0])
    at = Equirectangular(len(panorama)).pixels(np.nan_to_num(rays, nan=1.0)).astype(np.float32)
    picture = cv2.remap(panorama, at[..., 0], at[..., 1], cv2.INTER_CUBIC, borderMode=cv2.BORDER_WRAP)
    return np.asarray(picture * seen[..., None], np.uint8)


def refilmed(clip: Path, path: Path, camera: Camera) -> Path:
    """A clip of panoramas as another camera would have filmed it."""
    with av.open(str(clip)) as whole, av.open(str(path), "w") as container:
        filmed = whole.streams.video[0]
        stream = container.add_stream("libx264", rate=filmed.average_rate, options={"crf": "14", "preset": "fast"})
        stream.width, stream.height, stream.pix_fmt = camera.width, camera.height, "yuv420p"
        for frame in whole.decode(filmed):
            shown = seen_by(camera, frame.to_ndarray(format="rgb24"))
            container.mux(stream.encode(av.VideoFrame.from_ndarray(shown, format="rgb24")))
        container.mux(stream.encode())
    return path


def evenly(count: int, fps: float) -> list[float]:
    return [i / fps for i in range(count)]


def write_recording(
    path: Path,
    count: int,
    codec: str = "libx264",
    container: str | None = None,
    options: dict[str, str] | None = None,
    first: int = 0,
    lenses: int = 1,
) -> Path:
    """A video of `count` pictures at 25 a second from 0 on, as codecs of fixed rates take them; `container`: FFmpeg's name of its kind,
    if the file's does not say it; `lenses`: so many streams of the same."""
    with av.open(str(path), "w", format=container, options=options or {}) as made:
        streams = [made.add_stream(codec, rate=25) for _ in range(lenses)]
        for stream in streams:
            stream.width, stream.height, stream.pix_fmt = 128, 64, "yuv420p"
            stream.gop_size = 10
        for index in range(count):
            for stream in streams:
                frame = av.VideoFrame.from_ndarray(picture(first + index), format="rgb24")
                frame.pts, frame.time_base = index, Fraction(1, 25)
                made.mux(stream.encode(frame))
        for stream in streams:
            made.mux(stream.encode())
    return path
