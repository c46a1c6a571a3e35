"""Panoramas out of passes of video (paper, section III-A): sampled by time, decoded once, in order, one at a time."""

import math
from collections.abc import Container, Iterator, Sequence
from functools import partial
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np

from savmap.errors import VideoError
from savmap.types import Floats, Panorama, Planes, panorama_of
from savmap.video.camera_kind import kind_of
from savmap.video.clip import (
    Clip,
    DecodeReport,
    Image,
    Picture,
    Source,
    VideoInfo,
    check_shape,
    missing_s,
    time_range,
    usual_gap_s,
)
from savmap.video.container import exact_key_times, probe_file
from savmap.video.decode import decode_at, decode_file
from savmap.video.image_folder import probe_folder, read_at, read_folder
from savmap.video.laid import Laid
from savmap.video.motion import small_grey

__all__ = [
    "Clip",
    "DecodeReport",
    "VideoInfo",
    "check_camera",
    "expected_frames",
    "panoramas",
    "pictures",
    "preview_frames",
    "probe",
    "probe_clip",
    "sampled",
    "sampling_fps",
]

Pairs = tuple[tuple[Panorama, Panorama], ...]
TICK_TOLERANCE = 0.2
WIDER = (2, 4, 8)
STILL_WIDTH, STILL = 256, 0.7
BLACK = np.zeros((64, 128, 3), np.uint8)


def probe(path: Path, images_fps: float = 30.0, panoramic: bool = True) -> VideoInfo:
    """What a video file or a folder of pictures holds. Raises VideoError where it is missing, empty, cut off or, of a
    panoramic camera, not 2:1."""
    if not path.exists():
        raise VideoError(f"{path}: no such file or folder")
    if path.is_dir():
        return _checked(probe_folder(path, images_fps), panoramic)
    if not path.is_file():
        raise VideoError(f"{path}: not a video file but a device or a pipe")
    if path.stat().st_size == 0:
        raise VideoError(f"{path}: the file is empty")
    return _checked(probe_file(path), panoramic)


def _checked(info: VideoInfo, panoramic: bool) -> VideoInfo:
    check_shape(info.path, info.width, info.height, panoramic)
    return info


def probe_clip(clip: Clip) -> VideoInfo:
    """What a clip's file or folder holds. Raises VideoError as `probe` does."""
    return probe(clip.path, clip.images_fps, clip.camera is None)


def check_camera(clip: Clip, info: VideoInfo) -> None:
    """Raise VideoError where a video file says of itself that it holds no upright panoramas, or, of another camera, no
    upright pictures, or where that seems to be one of whole panoramas. Raises SiteError where pictures of this size
    cannot be the camera's."""
    read = read_at if info.codec == "images" else partial(decode_at, panoramic=clip.camera is None)
    _, picture = next(read(info, [0.0]), (0.0, None)) if clip.camera or info.codec != "images" else (0.0, None)
    if _laid(clip, info) is None or picture is None or info.width != 2 * info.height:
        return
    if kind_of([panorama_of(0, 0.0, picture)]) == ("", ()):
        raise VideoError(f"{clip.path}: its pictures seem to be whole panoramas: leave `camera` out")


def _laid(clip: Clip, info: VideoInfo) -> Laid | None:
    """What lays a clip's pictures into panoramas; None where they are some. Raises SiteError as `CameraSource`."""
    return None if clip.camera is None else Laid(clip.camera.camera(info.width, info.height))


def _panorama(number: int, stamp_s: float, picture: Picture, laid: Laid | None) -> Panorama:
    if laid is None:
        return panorama_of(number, stamp_s, picture)
    return panorama_of(number, stamp_s, laid.panorama(picture), laid.seen)


def sampling_fps(clip: Clip, info: VideoInfo) -> float:
    """How many frames a second are used of a clip."""
    return min(clip.fps, info.rate_fps or clip.fps)


def expected_frames(clip: Clip, info: VideoInfo) -> int:
    """Roughly how many panoramas a clip gives, for progress bars."""
    start, end = time_range(clip, info.duration_s)
    return max(1, round((min(end, info.duration_s) - start) * sampling_fps(clip, info)))


def panoramas(
    clip: Clip,
    first_frame: int = 0,
    report: DecodeReport | None = None,
    known_s: Sequence[float] = (),
    wanted: Container[int] | None = None,
) -> Iterator[Panorama]:
    """A clip's panoramas, numbered from `first_frame`; `stamp_s` is the time in the video.

    The first frame of the range is used, then one per 1/fps by timestamp, so that every frame is used where the video
    is slower. Damaged frames are skipped and counted in `report`. `known_s`: times of the clip's first panoramas, which
    are not decoded again; `report` tells of them. `wanted`: the numbers of those that anything is asked of, where these
    are known; of other cameras than panoramic ones the rest comes small and black. Raises VideoError as `probe` does,
    for a range outside the video, and where nothing can be decoded.
    """
    laid = _laid(clip, probe_clip(clip))
    for number, (stamp_s, picture) in enumerate(pictures(clip, report, known_s), first_frame + len(known_s)):
        if laid is not None and wanted is not None and number not in wanted:
            yield panorama_of(number, stamp_s, BLACK)
        else:
            yield _panorama(number, stamp_s, picture, laid)


def pictures(
    clip: Clip, report: DecodeReport | None = None, known_s: Sequence[float] = ()
) -> Iterator[tuple[float, Picture]]:
    """A clip's pictures as its camera took them, with their times; as `panoramas`."""
    report = DecodeReport() if report is None else report
    info = probe_clip(clip)
    start, end = time_range(clip, info.duration_s)
    last, gap = (known_s[-1], max(np.diff(known_s, prepend=start))) if known_s else (start, 0.0)
    report.used += len(known_s)
    report.decoded -= bool(known_s) and info.codec != "images"  # the last one is decoded again
    read = read_folder if info.codec == "images" else decode_file
    for stamp, image in sampled(read(info, last, end, report), clip.fps, report, known_s):
        last, gap = stamp, max(gap, stamp - last)
        report.decoded_by.append(report.decoded)
        yield stamp, image
    if not report.used:
        raise VideoError(f"{clip.path}: no frame from {start:g} s on can be decoded; the file is cut off or damaged")
    rate = sampling_fps(clip, info)
    report.short_s = missing_s(last, min(end, info.duration_s), rate)
    report.gap_s = float(gap) if gap > usual_gap_s(rate) else 0.0


def sampled(
    frames: Source, fps: float, report: DecodeReport, known_s: Sequence[float]
) -> Iterator[tuple[float, Picture]]:
    """The first good frame of each tick of 1/fps counted from the first, after those that are known; stamps may jitter
    by a fifth of a tick."""
    origin = known_s[0] if known_s else None
    last_tick = math.floor((known_s[-1] - known_s[0]) * fps + TICK_TOLERANCE) if known_s else -1
    for stamp, read in frames:
        origin = stamp if origin is None else origin
        tick = math.floor((stamp - origin) * fps + TICK_TOLERANCE)
        if tick <= last_tick or (image := read()) is None:
            continue
        last_tick = tick
        report.used += 1
        yield stamp, image


def preview_frames(
    clip: Clip, keys: int = 5, pairs: int = 3, max_height: int = 2048
) -> tuple[tuple[Panorama, ...], tuple[tuple[Panorama, Panorama], ...]]:
    """Evenly spaced key frames of a clip, and pairs of neighbouring samples, for planning views.

    They are decoded at the video's own key frames where these are near; `frame` is their number by time alone. Where
    the camera stands in all pairs, or frames are repeated, or fewer than the header says, pairs further apart are
    taken. Pictures higher than `max_height` are shrunk by a whole factor. Raises VideoError as `panoramas` does.
    """
    info = probe_clip(clip)
    step = 1 / sampling_fps(clip, info)
    times, second = _preview_times(clip, info, keys, pairs)
    spacing = min(np.diff(times), default=0.0)
    wider = [factor * step for factor in WIDER if 1.8 * factor * step < spacing]
    samples = (_samples(clip, info, times, second, gap, max_height) for gap in (step, *wider))
    first = next(samples)
    frames, close = first if _moves(first[1]) else next((later for later in samples if _moves(later[1])), first)
    if not frames:
        raise VideoError(f"{clip.path}: no frame can be decoded; the file is cut off or damaged")
    followers = {id(b) for _, b in close}
    return tuple(panorama for panorama in frames if id(panorama) not in followers), close


def _preview_times(clip: Clip, info: VideoInfo, keys: int, pairs: int) -> tuple[list[float], list[int]]:
    """Times of a clip's preview, at key frames of the video if near, and the numbers of those that begin a pair."""
    start, end = time_range(clip, info.duration_s)
    last = min(end, info.duration_s)
    times = start + (last - start) * (np.arange(keys) + 0.5) / keys
    if info.codec != "images":
        key_times = exact_key_times(info)
        times = _at_keys(times, key_times[(key_times >= start) & (key_times < last)], (last - start) / keys / 2)
    return times.tolist(), sorted({round(i) for i in np.linspace(0, keys - 1, pairs + 2)[1:-1]})


def _small(clip: Clip, info: VideoInfo, times: list[float], max_height: int) -> list[Panorama]:
    """Panoramas at these times, or at the clip's start where there are none, each shrunk before the next is read."""
    read = read_at if info.codec == "images" else partial(decode_at, panoramic=clip.camera is None)
    start, laid = clip.start_s or 0.0, _laid(clip, info)
    frames = [
        _panorama(round((stamp - start) * clip.fps), stamp, picture if laid else _shrunk(picture, max_height), laid)
        for stamp, picture in read(info, times)
    ]
    return frames if frames or times == [start] else _small(clip, info, [start], max_height)


def _samples(
    clip: Clip, info: VideoInfo, times: list[float], second: list[int], gap_s: float, max_height: int
) -> tuple[list[Panorama], Pairs]:
    """Panoramas at all times, and those `gap_s` after the `second` ones; and which of them are pairs."""
    frames = _small(clip, info, sorted([*times, *(times[i] + gap_s for i in second)]), max_height)
    return frames, tuple((a, b) for a, b in pairwise(frames) if 0 < b.stamp_s - a.stamp_s < 1.8 * gap_s)


def _moves(pairs: Pairs) -> bool:
    """Whether the panoramas of a pair differ by more than noise."""
    small = [[small_grey(panorama, STILL_WIDTH).astype(np.float64) for panorama in pair] for pair in pairs]
    return any(np.abs(first - second).mean() > STILL for first, second in small)


def _at_keys(times: Floats, keys_s: Floats, within_s: float) -> Floats:
    """Times (n,), each moved to the nearest key frame where that is within this distance."""
    if not len(keys_s):
        return times
    nearest = keys_s[np.abs(keys_s - times[:, None]).argmin(axis=1)]
    moved: Floats = np.where(np.abs(nearest - times) <= within_s, nearest, times)
    return moved


def _shrunk(picture: Picture, max_height: int) -> Picture:
    """A picture made low enough by the least whole factor: OpenCV averages by these ten times faster than by others."""
    if isinstance(picture, Planes):
        factor = math.ceil(len(picture.luma) / max_height)
        luma, blue, red = (_lower(plane, factor) for plane in (picture.luma, picture.blue, picture.red))
        return Planes(luma[: 2 * len(blue), : 2 * blue.shape[1]], blue, red, picture.rgb_from_yuv)
    return _lower(picture, math.ceil(len(picture) / max_height))


def _lower(image: Image, factor: int) -> Image:
    if factor == 1:
        return image
    height = len(image) // factor
    return np.asarray(cv2.resize(image, (2 * height, height), interpolation=cv2.INTER_AREA), np.uint8)
