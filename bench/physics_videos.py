"""Videos as lists of pictures: read, and written in the packings that cameras and editing programs give."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
from av.container import OutputContainer
from av.video.reformatter import ColorRange
from av.video.stream import VideoStream
from numpy.typing import NDArray

from savmap.video.reader import Clip, panoramas

Image = NDArray[np.uint8]
Frames = list[tuple[float, Image]]
"""Times (s) and RGB pictures."""

QUALITY = {"crf": "14", "preset": "ultrafast", "g": "10"}
TICKS = 90000
SOUND_HZ = 48000


@dataclass(frozen=True)
class Packing:
    """How pictures become a file. `stream`: options of the encoder; `muxer`: of the container. `full`: luma from 0 to 255, and whether
    the file says so. `matrix`: the colour space's number (ITU-T H.273) that the file says. `degrees`: the player is to turn by.
    `timecode`: a track of it, as editing programs write. `start_s`: the first frame's time in the file. `rate`: frames a second that the
    header says; 0: those that there are."""

    suffix: str = ".mp4"
    codec: str = "libx264"
    pixels: str = "yuv420p"
    stream: Mapping[str, str] = field(default_factory=lambda: QUALITY)
    muxer: Mapping[str, str] = field(default_factory=dict)
    bit_rate: int = 0
    full: bool = False
    says_full: bool | None = None
    matrix: int | None = None
    degrees: float = 0.0
    streams: int = 1
    sound: bool = False
    timecode: str = ""
    rate: int = 0
    start_s: float = 0.0


def read(video: Path) -> Frames:
    """All frames of a video."""
    return [(panorama.stamp_s, panorama.image) for panorama in panoramas(Clip(video, fps=1000.0))]


def write(path: Path, frames: Frames, packing: Packing | None = None) -> None:
    """A video of pictures with their times."""
    packing = packing or Packing()
    with av.open(str(path), "w", options=dict(packing.muxer)) as container:
        opened = [_video(container, packing, frames) for _ in range(packing.streams)]
        sound = container.add_stream("aac", rate=SOUND_HZ) if packing.sound else None
        for stamp, picture in frames:
            ticks = round((stamp + packing.start_s) * TICKS)
            for stream in opened:
                container.mux(stream.encode(_frame(picture, ticks, packing)))
        for stream in opened:
            container.mux(stream.encode())
        if sound is not None:
            for start in range(0, int(frames[-1][0] * SOUND_HZ), 1024):
                heard = av.AudioFrame.from_ndarray(np.zeros((1, 1024), np.float32), format="fltp", layout="mono")
                heard.sample_rate, heard.pts = SOUND_HZ, start + round(packing.start_s * SOUND_HZ)
                container.mux(sound.encode(heard))
            container.mux(sound.encode(None))


def _video(container: OutputContainer, packing: Packing, frames: Frames) -> VideoStream:
    usual = Fraction(len(frames) - 1) / Fraction(frames[-1][0] - frames[0][0]).limit_denominator(TICKS)
    rate = packing.rate or usual.limit_denominator(1001)
    stream = container.add_stream(packing.codec, rate=rate, options=dict(packing.stream))
    assert isinstance(stream, VideoStream)
    stream.height, stream.width, stream.pix_fmt = *frames[0][1].shape[:2], packing.pixels
    if packing.timecode:
        stream.metadata["timecode"] = packing.timecode
    context = stream.codec_context
    context.time_base = Fraction(1, TICKS)
    if packing.bit_rate:
        context.bit_rate = packing.bit_rate
    if packing.says_full is not None:
        context.color_range = int(ColorRange.JPEG if packing.says_full else ColorRange.MPEG)
    if packing.matrix is not None:
        context.colorspace = context.color_primaries = context.color_trc = packing.matrix
    stream.set_display_rotation(packing.degrees)
    return stream


def _frame(picture: Image, ticks: int, packing: Packing) -> av.VideoFrame:
    frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(picture), format="rgb24")
    wanted = ColorRange.JPEG if packing.full else ColorRange.MPEG
    frame = frame.reformat(format=packing.pixels, dst_color_range=wanted, dst_colorspace=packing.matrix)
    if packing.says_full is not None:
        frame.color_range = ColorRange.JPEG if packing.says_full else ColorRange.MPEG
    frame.pts, frame.time_base = ticks, Fraction(1, TICKS)
    return frame
