"""Two small grey pictures a moment apart, about once a second of a long recording, at a small part of the cost of decoding all.

Samples are taken at key frames, which are found by seeking, with the few frames until the second picture. Where key frames
are further apart than samples, what lies between is decoded.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import av.error
import numpy as np
from av.container import InputContainer
from av.video.frame import VideoFrame
from av.video.reformatter import VideoReformatter
from av.video.stream import VideoStream

from savmap.errors import VideoError
from savmap.split.settings import Settings
from savmap.types import Floats, array_record
from savmap.video.clip import Image, VideoInfo
from savmap.video.decode import opened

_INSTANT_S = 1e-4


@dataclass(frozen=True, eq=False)
@array_record
class Glance:
    """Two grey panoramas `first`, `second` (H, 2H) uint8, the first at `stamp_s` in the recording, `gap_s` apart."""

    stamp_s: float
    gap_s: float
    first: Image
    second: Image


@dataclass
class GlanceReport:
    """How many frames were decoded for how many glances."""

    decoded: int = 0
    glances: int = 0

    def share(self, info: VideoInfo) -> float:
        """The frames decoded as a share of all."""
        return self.decoded / max(info.duration_s * info.rate_fps, 1.0)


def glances(info: VideoInfo, stamps_s: Sequence[float], settings: Settings, report: GlanceReport) -> Iterator[Glance]:
    """The glances of a recording at times in ascending order, or just after them.

    Damaged frames are passed over. Raises VideoError for what cannot be read.
    """
    with opened(info.path) as (container, stream):
        keys = np.array(key_stamps(stream))
        stream.thread_type = "SLICE" if 2 * np.isin(stamps_s, keys).sum() > len(stamps_s) else "AUTO"
        shrink = _Shrink(settings.width)
        frames, entry = _frames(container, stream, report), 0
        for stamp in stamps_s:
            ahead = int(np.searchsorted(keys, stamp + _INSTANT_S)) - 1
            if ahead > entry:
                _seek(container, stream, keys, ahead)
                frames, entry = _frames(container, stream, report), ahead
            found = _pair(_timed(frames, stream), stamp, settings.apart_s, info, shrink)
            if found is not None:
                report.glances += 1
                yield found


def coarse_stamps(info: VideoInfo, every_s: float) -> list[float]:
    """Times to look at first: key frames at least three quarters of `every_s` apart, and evenly between those further apart."""
    with opened(info.path) as (_, stream):
        return sample_stamps(key_stamps(stream), info.duration_s, every_s)


def pictures_at(info: VideoInfo, stamps_s: Sequence[float], width: int) -> list[Image]:
    """RGB pictures (width / 2, width, 3) at these times, or the next ones; black where there is none."""
    report, shrink = GlanceReport(), _Shrink(width, "rgb24")
    pictures = []
    with opened(info.path) as (container, stream):
        stream.thread_type = "SLICE"
        keys = np.array(key_stamps(stream))
        for stamp in stamps_s:
            _seek(container, stream, keys, int(np.searchsorted(keys, stamp, side="right").clip(1)) - 1)
            frames = _timed(_frames(container, stream, report), stream)
            frame = next((one for at, one in frames if at >= stamp - _INSTANT_S and _good(one, info)), None)
            pictures.append(np.zeros((width // 2, width, 3), np.uint8) if frame is None else shrink(frame))
    return pictures


def key_stamps(stream: VideoStream) -> list[float]:
    """Times of the key frames that the container's index names, by decoding time; the beginning alone without an index."""
    base, zero = float(stream.time_base or 0), stream.start_time or 0
    stamps = [(entry.timestamp - zero) * base for entry in stream.index_entries if entry.is_keyframe]
    return stamps or [0.0]


def sample_stamps(keys: Sequence[float], duration_s: float, every_s: float) -> list[float]:
    """The times that `coarse_stamps` gives for key frames at times `keys`."""
    chosen = [keys[0]]
    for key in keys[1:]:
        if key - chosen[-1] >= 0.75 * every_s:
            chosen.append(key)
    stamps: list[float] = []
    for start, end in pairwise([*chosen, max(duration_s, chosen[-1] + every_s)]):
        parts = max(1, round((end - start) / every_s))
        stamps += [start, *(start + (end - start) * part / parts for part in range(1, parts))]
    return stamps


class _Shrink:
    """A frame as a small panorama."""

    def __init__(self, width: int, pixel_format: str = "gray") -> None:
        self.width, self.pixel_format = width, pixel_format
        self.reformatter = VideoReformatter()

    def __call__(self, frame: VideoFrame) -> Image:
        small = self.reformatter.reformat(
            frame, self.width, self.width // 2, format=self.pixel_format, interpolation="AREA"
        )
        return np.asarray(small.to_ndarray(), np.uint8)


def _timed(frames: Iterator[VideoFrame], stream: VideoStream) -> Iterator[tuple[float, VideoFrame]]:
    base, zero = float(stream.time_base or 0), stream.start_time or 0
    return ((((frame.pts or 0) - zero) * base, frame) for frame in frames)


def _pair(
    frames: Iterator[tuple[float, VideoFrame]], stamp_s: float, apart_s: float, info: VideoInfo, shrink: _Shrink
) -> Glance | None:
    first: tuple[float, Image] | None = None
    for at, frame in frames:
        if not _good(frame, info) or at < stamp_s - _INSTANT_S:
            continue
        if first is None:
            first = at, shrink(frame)
        elif at - first[0] >= apart_s - _INSTANT_S:
            return Glance(first[0], at - first[0], first[1], shrink(frame))
    return None


def _good(frame: VideoFrame, info: VideoInfo) -> bool:
    return not frame.is_corrupt and (frame.width, frame.height) == (info.width, info.height)


def _seek(container: InputContainer, stream: VideoStream, keys: Floats, index: int) -> None:
    """To a key frame. Containers look for it by the time it is shown or decoded: half way to the next one both find it."""
    following = keys[index + 1] if index + 1 < len(keys) else keys[index] + 1.0
    middle = (keys[index] + following) / 2
    target = round(middle / float(stream.time_base or 1)) + (stream.start_time or 0)
    try:
        container.seek(target, stream=stream, backward=True)
    except (av.error.FFmpegError, OSError) as error:
        raise VideoError(f"{container.name}: cannot be read at {middle:.1f} s; the file is damaged") from error


def _frames(container: InputContainer, stream: VideoStream, report: GlanceReport) -> Iterator[VideoFrame]:
    packets = container.demux(stream)
    while True:
        try:
            packet = next(packets)
        except (StopIteration, av.error.FFmpegError):
            return
        try:
            frames = packet.decode()
        except av.error.FFmpegError:
            continue
        for frame in frames:
            if isinstance(frame, VideoFrame) and frame.pts is not None:
                report.decoded += 1
                yield frame
