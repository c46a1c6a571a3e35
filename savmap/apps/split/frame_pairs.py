"""Pairs of small grey panoramas a moment apart, about one pair a second of a long recording, with few frames decoded.

Pairs are sampled at key frames, which are found by seeking, with the few frames until the second picture. Where key
frames are further apart than samples, the frames between are decoded.
"""

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from av.video.frame import VideoFrame
from av.video.reformatter import VideoReformatter

from savmap.apps.split.records import SplitSettings
from savmap.video.clip import DecodeReport, Image, VideoInfo
from savmap.video.container import key_times, open_video
from savmap.video.decode import INSTANT_S, TimedFrames, frames_from
from savmap.video.motion import FramePair


def frame_pairs(
    info: VideoInfo, stamps_s: Sequence[float], settings: SplitSettings, report: DecodeReport
) -> Iterator[FramePair]:
    """The pairs of a recording at times in ascending order, or just after them; `report` counts frames decoded and
    pairs used.

    Damaged frames are skipped. Raises VideoError for a file that cannot be read.
    """
    shrink = _Shrink(settings.width)
    for frames in frames_from(info, stamps_s, margin_s=0, report=report):
        pair = _pair(frames, settings.apart_s, shrink)
        if pair is not None:
            report.used += 1
            yield pair


def coarse_stamps(info: VideoInfo, every_s: float) -> list[float]:
    """Times to sample first: key frames at least three quarters of `every_s` apart, and evenly between those further
    apart."""
    with open_video(info.path) as (_, stream):
        return sample_stamps(key_times(stream).tolist(), info.duration_s, every_s)


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


def pictures_at(info: VideoInfo, stamps_s: Sequence[float], width: int) -> list[Image]:
    """RGB pictures (width / 2, width, 3) at these times (ascending), or the next ones; black where there is none."""
    shrink, black = _Shrink(width, "rgb24"), np.zeros((width // 2, width, 3), np.uint8)
    first = (next(frames, None) for frames in frames_from(info, stamps_s, margin_s=0))
    return [black if timed is None else shrink(timed[1]) for timed in first]


class _Shrink:
    """Shrinks frames to small panoramas."""

    def __init__(self, width: int, pixel_format: str = "gray") -> None:
        self.width, self.pixel_format = width, pixel_format
        self.reformatter = VideoReformatter()

    def __call__(self, frame: VideoFrame) -> Image:
        small = self.reformatter.reformat(
            frame, self.width, self.width // 2, format=self.pixel_format, interpolation="AREA"
        )
        return np.asarray(small.to_ndarray(), np.uint8)


def _pair(frames: TimedFrames, apart_s: float, shrink: _Shrink) -> FramePair | None:
    stamp, frame = next(frames, (0.0, None))
    if frame is None:
        return None
    first = shrink(frame)
    later = next(((at, frame) for at, frame in frames if at - stamp >= apart_s - INSTANT_S), None)
    return None if later is None else FramePair(stamp, later[0] - stamp, first, shrink(later[1]))
