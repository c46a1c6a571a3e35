"""Decoding of video files with PyAV, damaged ones too."""

import os
from collections.abc import Callable, Hashable, Iterator, Sequence
from contextlib import contextmanager, suppress
from fractions import Fraction
from pathlib import Path
from typing import TypeVar

import av
import av.error
import numpy as np
from av.codec.hwaccel import HWAccel, hwdevices_available
from av.container import InputContainer
from av.video.frame import PictureType, VideoFrame
from av.video.reformatter import VideoReformatter
from av.video.stream import VideoStream
from numpy.typing import NDArray

from savmap.errors import VideoError
from savmap.files.urls import is_url
from savmap.types import Floats, Planes
from savmap.video.clip import MOST_PIXELS, DecodeReport, Picture, Source, VideoInfo, check_shape

Frame = TypeVar("Frame")

LEAP_S = 10.0
LEAP_FRAMES = 20
BELIEVED_AFTER = 5


def in_order(
    frames: Iterator[tuple[float, Frame]], start_s: float, rate_fps: float
) -> Iterator[tuple[float, Frame, bool]]:
    """Frames with their times (s), and whether each follows the one before it that did.

    A time that is not after the last one does not follow. Nor does one that leaps ahead by more than LEAP_S or LEAP_FRAMES
    frames' time, until BELIEVED_AFTER in a row have leapt: then the recording has a gap. The first is measured from `start_s`.
    """
    leap_s = max(LEAP_S, LEAP_FRAMES / rate_fps if rate_fps > 0 else 0.0)
    last, ahead, begun = start_s, 0, False
    for stamp, frame in frames:
        leapt = stamp > last + leap_s
        ahead = ahead + 1 if leapt else 0
        follows = (stamp > last or not begun) and (not leapt or ahead > BELIEVED_AFTER)
        if follows:
            last, begun, ahead = stamp, True, 0
        yield stamp, frame, follows


VARIABLE = "SAVMAP_HARDWARE"
ORDER = ("videotoolbox", "cuda", "vaapi", "d3d11va", "qsv")
_FOUND: dict[Hashable, str | None] = {}


def candidates(wish: str, known: Sequence[str]) -> list[str]:
    """Kinds of device to try, best first, of those that FFmpeg was built with."""
    wanted = {"auto": ORDER, "": ORDER, "off": ()}.get(wish.lower(), (wish.lower(),))
    return [name for name in wanted if name in known]


def accelerator(kind: Hashable, decodes: Callable[[HWAccel], bool]) -> HWAccel | None:
    """A device for this kind of video, or None. The first on which `decodes` is true; that is found out once in a process.

    What a device that is not there, or not fit, raises counts as false.
    """
    wish = os.environ.get(VARIABLE, "auto")
    key = (wish, kind)
    if key not in _FOUND:
        names = candidates(wish, hwdevices_available())
        _FOUND[key] = next((name for name in names if _tried(name, decodes)), None)
    found = _FOUND[key]
    return None if found is None else HWAccel(found)


def _tried(name: str, decodes: Callable[[HWAccel], bool]) -> bool:
    try:
        return decodes(HWAccel(name, allow_software_fallback=False))
    except (VideoError, av.error.FFmpegError, OSError, RuntimeError, ValueError):
        return False


PLANAR = {"yuv420p", "yuvj420p", "nv12"}
UNTOLD, JPEG_RANGE = 2, 2
WEIGHTS = {1: (0.2126, 0.0722), 5: (0.299, 0.114), 6: (0.299, 0.114), 9: (0.2627, 0.0593), UNTOLD: (0.299, 0.114)}
"""How much red and blue weigh in luma, by the number of the colour space (ITU-T H.273, "MatrixCoefficients")."""


def picture_of(frame: VideoFrame, reformatter: VideoReformatter) -> Picture:
    """A frame's planes, which lie in the frame's own memory where they can; RGB (H, W, 3) of frames that come in another form."""
    name, weights = frame.format.name, WEIGHTS.get(int(frame.colorspace))
    if name not in PLANAR or weights is None or frame.width % 2 or frame.height % 2:
        return np.asarray(reformatter.reformat(frame, format="rgb24").to_ndarray(), np.uint8)
    full = name == "yuvj420p" or int(frame.color_range) == JPEG_RANGE
    luma, *colour = (np.frombuffer(memoryview(plane), np.uint8).reshape(-1, plane.line_size) for plane in frame.planes)
    half = frame.height // 2, frame.width // 2
    blue, red = (
        _apart(colour[0][: half[0], : frame.width]) if name == "nv12" else (one[: half[0], : half[1]] for one in colour)
    )
    return Planes(luma[: frame.height, : frame.width], blue, red, rgb_from_yuv(*weights, full))


def _apart(pairs: NDArray[np.uint8]) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Blue and red differences that take turns, as devices give them."""
    return np.ascontiguousarray(pairs[:, 0::2]), np.ascontiguousarray(pairs[:, 1::2])


def rgb_from_yuv(of_red: float, of_blue: float, full: bool) -> Floats:
    """Matrix (3, 4) from (luma, blue difference, red difference, 1), each 0..255, to RGB, 0..255 (ITU-R BT.709, section 3)."""
    of_green = 1 - of_red - of_blue
    blue, red = 2 * (1 - of_blue), 2 * (1 - of_red)
    from_differences = np.array([[0, red], [-blue * of_blue / of_green, -red * of_red / of_green], [blue, 0]])
    low, luma, chroma = (0, 1.0, 1.0) if full else (16, 255 / 219, 255 / 224)
    matrix = np.hstack([np.full((3, 1), luma), chroma * from_differences])
    return np.hstack([matrix, -matrix @ [[low], [128], [128]]])


CONTAINERS = "mov,matroska,avi,mpegts,mpeg,asf,flv,mxf,ogg,nut"
"""FFmpeg's demuxers that are used: those with time stamps, none that opens other files or addresses as play lists do."""
OPENING = {"format_whitelist": CONTAINERS, "protocol_whitelist": "file", "max_pixels": str(MOST_PIXELS)}
OPENING_S, READING_S = 60.0, 10.0
"""How long a header, and a packet, may take to come: a file may go on with many gigabytes of nothing."""
INSTANT_S = 1e-6
SEEK_MARGIN_S = 0.5
SMALL_PIXELS = 1 << 16
LARGE_PIXELS = 16_000_000
LARGE_THREADS = 4


def probe_file(path: Path) -> VideoInfo:
    """What a video file's header says. VideoError: not a video, damaged, not 2:1."""
    with opened(path) as (container, stream):
        context = stream.codec_context
        check_shape(path, context.width, context.height)
        duration = _duration_s(container, stream)
        rate = float(stream.average_rate or stream.guessed_rate or 0)
        return VideoInfo(path, context.width, context.height, context.name, context.pix_fmt or "", rate, duration)


@contextmanager
def opened(path: Path, hardware: HWAccel | None = None) -> Iterator[tuple[InputContainer, VideoStream]]:
    """A video file's container and first video stream."""
    try:
        source = path.open("rb") if is_url(path) else str(path)
        container = av.open(source, "r", options=OPENING, timeout=(OPENING_S, READING_S), hwaccel=hardware)
    except (av.error.FFmpegError, OSError) as error:
        raise VideoError(_why_unreadable(path)) from error
    with container:
        streams = [stream for stream in container.streams.video if stream.codec_context is not None]
        if not streams:
            raise VideoError(f"{path}: has no video stream that can be decoded")
        yield container, streams[0]


def _why_unreadable(path: Path) -> str:
    try:
        with path.open("rb") as file:
            head = file.read(12)
    except OSError as error:
        return f"{path}: cannot be read: {error.strerror}"
    if head[4:8] == b"ftyp":
        return f"{path}: the file is cut off or damaged (its index is missing); copy it from the camera again"
    return f"{path}: not a video file of a kind that is read (MP4, MOV, Matroska, AVI, MPEG)"


def _duration_s(container: InputContainer, stream: VideoStream) -> float:
    if stream.duration and stream.time_base:
        return float(stream.duration * stream.time_base)
    if container.duration:
        return container.duration / av.time_base
    last = 0.0
    with suppress(av.error.FFmpegError):
        for packet in container.demux(stream):
            if packet.pts is not None:
                last = max(last, _seconds(packet.pts + (packet.duration or 0), stream))
    return last


def _seconds(pts: int, stream: VideoStream) -> float:
    return float((pts - (stream.start_time or 0)) * (stream.time_base or Fraction(1)))


def decode_file(info: VideoInfo, start_s: float, end_s: float, report: DecodeReport) -> Source:
    """Good frames of a file from start_s up to end_s. Frames that the decoder flags as damaged or loses are counted."""
    with opened(info.path, _hardware(info)) as (container, stream):
        _configure(stream, info)
        if start_s > 0:
            _seek(container, stream, _pts(start_s - SEEK_MARGIN_S, stream))
        reformatter = VideoReformatter()
        expected: set[float] = set()
        good: set[float] = set()
        already, repeated = report.skipped, 0
        stamped = ((_seconds(frame.pts or 0, stream), frame) for frame in _frames(container, stream, expected))
        for stamp, frame, follows in in_order(stamped, start_s, info.rate_fps):
            if follows and stamp >= end_s - INSTANT_S:
                break
            repeated += stamp in good
            if follows and stamp >= start_s - INSTANT_S and _fits(frame, info):
                report.decoded += 1
                good.add(stamp)
                yield stamp, _reader(frame, reformatter)
        lost = {s for s in expected if start_s - INSTANT_S <= s < end_s - INSTANT_S} - good
        report.skipped = already + repeated + len(lost)


def decode_at(info: VideoInfo, stamps_s: list[float]) -> Iterator[tuple[float, Picture]]:
    """The first good frame at or after each time (ascending); nothing for those that cannot be decoded.

    Seeks only where a key frame lies between one time and the next, so that no frame is decoded twice; times that `key_times`
    gave cost nothing but the key frame.
    """
    with opened(info.path) as (container, stream):
        _configure(stream, info)
        keys = _keys(stream)
        targets = [_pts(wanted, stream) for wanted in stamps_s]
        if 2 * sum(target in keys for target in targets) > len(targets):
            stream.thread_type = "SLICE"  # gives each picture at once; frame threads decode some that nobody asked for
        reformatter = VideoReformatter()
        frames = _frames(container, stream, set())
        entry = 0
        for wanted, target in zip(stamps_s, targets, strict=True):
            target = target if target in keys else _pts(wanted - SEEK_MARGIN_S, stream)
            ahead = stream.index_entries.search_timestamp(target)
            if ahead > entry:
                _seek(container, stream, target)
                frames, entry = _frames(container, stream, set()), ahead
            for frame in frames:
                stamp = _seconds(frame.pts or 0, stream)
                if stamp >= wanted - INSTANT_S and _fits(frame, info):
                    yield stamp, picture_of(frame, reformatter)
                    break


def key_times(info: VideoInfo) -> list[float]:
    """Times of a file's key frames, s, where its index tells them: of frames that are shown in another order than they are decoded
    in (B frames) it does not."""
    with opened(info.path) as (_, stream):
        return [_seconds(key, stream) for key in sorted(_keys(stream))]


def _keys(stream: VideoStream) -> set[int]:
    if stream.codec_context.has_b_frames:
        return set()
    return {entry.timestamp for entry in stream.index_entries if entry.is_keyframe and not entry.is_discard}


def _fits(frame: VideoFrame, info: VideoInfo) -> bool:
    return (frame.width, frame.height) == (info.width, info.height)


def _pts(stamp_s: float, stream: VideoStream) -> int:
    return round(stamp_s / (stream.time_base or Fraction(1))) + (stream.start_time or 0)


def _seek(container: InputContainer, stream: VideoStream, target: int) -> None:
    """To the key frame before a time. Key frames are found by decoding time, which runs ahead of the time shown.

    A file whose index is damaged stays where it is: it is read on from there.
    """
    with suppress(av.error.FFmpegError):
        container.seek(max(target, stream.start_time or 0), stream=stream, backward=True)


def _hardware(info: VideoInfo) -> HWAccel | None:
    """A device that decodes a video of large pictures faster than the processor, if there is one."""

    def decodes(device: HWAccel) -> bool:
        with opened(info.path, device) as (container, stream):
            _configure(stream, info)
            frame = next(_frames(container, stream, set()), None)
            return frame is not None and _fits(frame, info) and frame.format.name in PLANAR

    large = info.width * info.height > LARGE_PIXELS
    return accelerator((info.codec, info.pixel_format, info.width), decodes) if large else None


def _configure(stream: VideoStream, info: VideoInfo) -> None:
    """Frame threads hold a picture each: fewer of them where pictures are large. Pictures that turn out to be much larger than
    the header says are refused by the decoder, before memory is taken for them."""
    stream.thread_type = "AUTO"
    stream.codec_context.options = {"max_pixels": str(2 * info.width * info.height + SMALL_PIXELS)}
    large = info.width * info.height > LARGE_PIXELS
    stream.codec_context.thread_count = min(LARGE_THREADS, os.cpu_count() or 1) if large else 0


def _frames(container: InputContainer, stream: VideoStream, expected: set[float]) -> Iterator[VideoFrame]:
    """Sound frames; the times of the packets read go into `expected`.

    What follows a frame that is damaged or lost is predicted from it: the next sound one is the next that stands by itself.
    """
    packets = container.demux(stream)
    sound = True
    while True:
        try:
            packet = next(packets)
        except StopIteration:
            return
        except av.error.FFmpegError:
            return
        if packet.pts is not None and packet.size and not packet.is_discard:
            expected.add(_seconds(packet.pts, stream))
        try:
            frames = packet.decode()
        except av.error.FFmpegError:
            sound = False
            continue
        for frame in (frame for frame in frames if isinstance(frame, VideoFrame)):
            sound = not frame.is_corrupt and (sound or frame.key_frame or frame.pict_type == PictureType.I)
            if sound and frame.pts is not None:
                yield frame


def _reader(frame: VideoFrame, reformatter: VideoReformatter) -> Callable[[], Picture]:
    return lambda: picture_of(frame, reformatter)
