"""Video files: opened, probed and searched with PyAV; the order of their times, and the devices that decode them."""

import os
from collections.abc import Callable, Hashable, Iterator, Sequence
from contextlib import contextmanager, suppress
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import BinaryIO, TypeVar

import av
import av.error
import numpy as np
from av.codec.hwaccel import HWAccel, hwdevices_available
from av.container import InputContainer
from av.stream import Disposition
from av.video.stream import VideoStream

from savmap.errors import VideoError
from savmap.files.urls import is_url
from savmap.types import Floats
from savmap.video.clip import END_TOLERANCE_S, MOST_PIXELS, VideoInfo
from savmap.video.image_folder import picture_size

CONTAINERS = "mov,matroska,avi,mpegts,mpeg,asf,flv,mxf,ogg,nut"
"""FFmpeg's demuxers that are used: those with time stamps, none that opens other files or addresses as play lists
do."""
OPENING = {"format_whitelist": CONTAINERS, "protocol_whitelist": "file", "max_pixels": str(MOST_PIXELS)}
OPENING_S, READING_S = 60.0, 10.0
"""How long a header, and a packet, may take to come: a file may go on with many gigabytes of nothing."""
BOXES = frozenset({b"ftyp", b"moov", b"mdat", b"wide", b"free", b"skip"})
"""Outermost boxes of MP4 and MOV."""
MATROSKA = (b"\x1a\x45\xdf\xa3", b"\x18\x53\x80\x67")
"""Outermost elements of Matroska: the header, and the segment that follows it."""
SEARCHED_BY_TIME, PROBED_PLACES = ("mpegts", "mpeg"), 32
"""Formats without an index, in which FFmpeg searches by the times it meets; in how many places times are read first."""
SMALL_PIXELS = 1 << 16
LARGE_PIXELS = 16_000_000
LARGE_THREADS = 4
HARDWARE_VARIABLE = "SAVMAP_HARDWARE"
DEVICES = ("videotoolbox", "cuda", "vaapi", "d3d11va", "qsv")
"""Kinds of hardware decoders, best first."""
_WORKING: dict[Hashable, str | None] = {}
LEAP_S, LEAP_FRAMES = 10.0, 20
BELIEVED_AFTER = 5

Frame = TypeVar("Frame")


def local_name(path: Path) -> str:
    """A local file as FFmpeg names it: without its protocol, FFmpeg takes what stands before a colon for one."""
    return f"file:{path}"


@contextmanager
def open_video(path: Path, hardware: HWAccel | None = None) -> Iterator[tuple[InputContainer, VideoStream]]:
    """A video file's container and first video stream. Raises VideoError where the file cannot be read."""
    with _opened(path, hardware) as container:
        yield container, _main_stream(path, container)


def is_video(path: Path) -> bool:
    """Whether a file can be opened and has pictures, whatever they show."""
    try:
        with _opened(path) as container:
            return bool(container.streams.video)
    except VideoError:
        return False


def _opened(path: Path, hardware: HWAccel | None = None) -> InputContainer:
    try:
        source = path.open("rb") if is_url(path) else local_name(path)
        return av.open(source, "r", options=OPENING, timeout=(OPENING_S, READING_S), hwaccel=hardware)
    except MemoryError:
        raise
    except (av.error.FFmpegError, OSError) as error:
        raise VideoError(f"{path}: {_why_unreadable(path, error)}") from error


def _main_stream(path: Path, container: InputContainer) -> VideoStream:
    """The stream that holds the panoramas, not cover pictures or smaller copies. Raises VideoError for none, or two of
    one size."""
    decodable = [stream for stream in container.streams.video if stream.codec_context is not None]
    streams = [stream for stream in decodable if not stream.disposition & Disposition.attached_pic] or decodable
    if not streams:
        raise VideoError(f"{path}: has no video stream that can be decoded")
    best = max(streams, key=lambda stream: (stream.width == 2 * stream.height, stream.width * stream.height))
    others = [stream for stream in streams if (stream.width, stream.height) == (best.width, best.height)]
    if len(others) > 1:
        raise VideoError(
            f"{path}: has {len(others)} video streams of {best.width}x{best.height} (two lenses?): stitch them in the "
            "camera maker's program, or write the one that is a panorama by itself "
            f"(ffmpeg -i OLD -map 0:{best.index} -c copy NEW)"
        )
    return best


def _why_unreadable(path: Path, error: Exception) -> str:
    try:
        with path.open("rb") as file:
            kinds = list(part_kinds(file))
    except OSError as unread:
        return f"cannot be read: {unread.strerror}"
    if picture_size(path) is not None or (kinds[:1] == [b"ftyp"] and b"meta" in kinds):
        return "is one picture, not a video; give a video, or a folder of pictures"
    if not BOXES.intersection(kinds):
        return "not a video file of a kind that is read (see docs/video.md)"
    if b"moov" not in kinds:
        return "the file is cut off or damaged (its index is missing); copy it from the camera again"
    return f"cannot be opened; FFmpeg says: {getattr(error, 'strerror', None) or error}"


def part_kinds(file: BinaryIO) -> Iterator[bytes]:
    """The kinds of a file's outermost parts, as far as their sizes lead: boxes of MP4 (ISO/IEC 14496-12, 4.2), elements
    of Matroska (RFC 8794, 4 to 6); four bytes at the boxes' place of any other file."""
    at, end = 0, file.seek(0, os.SEEK_END)
    while at + 8 <= end:
        file.seek(at)
        head = file.read(16)
        if head[:4] in MATROSKA:
            digits = 9 - head[4].bit_length()
            kind, size = head[:4], 4 + digits + (int.from_bytes(head[4 : 4 + digits], "big") & (1 << 7 * digits) - 1)
        else:
            kind, size = head[4:8], int.from_bytes(head[:4], "big")
            size = int.from_bytes(head[8:], "big") if size == 1 else size
        yield kind
        if size < 8:
            return
        at += size


def probe_file(path: Path) -> VideoInfo:
    """What a video file's header says. Raises VideoError for a file that is no video, damaged, or two
    recordings."""
    with open_video(path) as (container, stream):
        context = stream.codec_context
        duration = _duration_s(container, stream)
        rate = float(stream.average_rate or stream.guessed_rate or 0)
        info = VideoInfo(path, context.width, context.height, context.name, context.pix_fmt or "", rate, duration)
        _require_one_recording(info, container, stream)
        return info


def _require_one_recording(info: VideoInfo, container: InputContainer, stream: VideoStream) -> None:
    """Raise VideoError for a recording behind another: in transport and program streams the times go back from place to
    place, MP4 has two indices, of which FFmpeg reads the first only, Matroska two headers. All packets are read only
    where these signs are seen."""
    kinds: list[bytes] = []
    if container.format.name in SEARCHED_BY_TIME:
        suspect = any(after < before for before, after in pairwise(_times_at_places(container, stream)))
    else:
        with info.path.open("rb") as file:
            kinds = list(part_kinds(file))
        suspect = max(kinds.count(b"moov"), kinds.count(MATROSKA[0])) > 1
    if suspect:
        with suppress(av.error.FFmpegError):
            container.seek(0, unsupported_byte_offset=container.format.name in SEARCHED_BY_TIME)
        for _ in in_order(_packet_times(container, stream), 0.0, info):
            pass
        if b"moov" in kinds and b"moof" not in kinds:
            raise VideoError(several_recordings(info, f"what follows after {info.duration_s:.1f} s is never read"))


def _times_at_places(container: InputContainer, stream: VideoStream) -> Iterator[float]:
    """Decoding times (s) at evenly spaced places of a file, up to the first where none can be read."""
    for place in range(PROBED_PLACES):
        with suppress(av.error.FFmpegError):
            container.seek(place * container.size // PROBED_PLACES, unsupported_byte_offset=True)
        time = next((time for time, _ in _packet_times(container, stream)), None)
        if time is None:
            return
        yield time


def _packet_times(container: InputContainer, stream: VideoStream) -> Iterator[tuple[float, None]]:
    """The decoding times (s) of the packets from here on, as far as they can be read."""
    with suppress(av.error.FFmpegError):
        for packet in container.demux(stream):
            if packet.dts is not None:
                yield seconds(packet.dts, stream), None


def _duration_s(container: InputContainer, stream: VideoStream) -> float:
    if stream.duration and stream.time_base:
        return float(stream.duration * stream.time_base)
    said = container.duration / av.time_base if container.duration else 0.0
    begins = container.start_time / av.time_base if container.start_time else 0.0
    if said and begins <= END_TOLERANCE_S:
        return said
    return _last_time(container, stream, said) or said


def _last_time(container: InputContainer, stream: VideoStream, near_s: float) -> float:
    """The end of a stream by its last packets, s from its first time: a header may count from 0, or give none (`near_s`
    0: all packets are read)."""
    if near_s:
        seek(container, stream, near_s)
    last = 0.0
    with suppress(av.error.FFmpegError):
        for packet in container.demux(stream):
            if packet.pts is not None:
                last = max(last, seconds(packet.pts + (packet.duration or 0), stream))
    return last


def seconds(pts: int, stream: VideoStream) -> float:
    """The time of a time stamp, s from the stream's first."""
    return float((pts - (stream.start_time or 0)) * (stream.time_base or Fraction(1)))


def configure(stream: VideoStream, info: VideoInfo) -> None:
    """Set the decoder's threads, fewer where pictures are large, for each holds one; and its largest picture: one much
    larger than the header says is refused before it takes memory."""
    stream.thread_type = "AUTO"
    stream.codec_context.options = {"max_pixels": str(2 * info.width * info.height + SMALL_PIXELS)}
    stream.codec_context.thread_count = min(LARGE_THREADS, os.cpu_count() or 1) if is_large(info) else 0


def is_large(info: VideoInfo) -> bool:
    """Whether pictures are so large that a device decodes them faster than the processor."""
    return info.width * info.height > LARGE_PIXELS


def key_times(stream: VideoStream) -> Floats:
    """Times (n,) s of the key frames in the container's index, in decoding order; 0 alone without an index."""
    keys = [entry.timestamp for entry in stream.index_entries if entry.is_keyframe]
    return np.array([seconds(key, stream) for key in keys] or [0.0])


def exact_key_times(info: VideoInfo) -> Floats:
    """Times (n,) s at which a file shows key frames; none where frames are shown in another order than they are decoded
    in (B frames), because the index has decoding times."""
    with open_video(info.path) as (_, stream):
        if stream.codec_context.has_b_frames:
            return np.zeros(0)
        keys = [entry for entry in stream.index_entries if entry.is_keyframe and not entry.is_discard]
        return np.array(sorted(seconds(entry.timestamp, stream) for entry in keys))


def seek(container: InputContainer, stream: VideoStream, target_s: float) -> None:
    """Go to the key frame before a time. A file whose index is damaged stays where it is, and is read on from there."""
    target = round(target_s / (stream.time_base or Fraction(1))) + (stream.start_time or 0)
    with suppress(av.error.FFmpegError):
        container.seek(max(target, stream.start_time or 0), stream=stream, backward=True)


def candidates(wish: str, available: Sequence[str]) -> list[str]:
    """Devices to try, best first, of those that FFmpeg was built with."""
    wanted = {"auto": DEVICES, "": DEVICES, "off": ()}.get(wish.lower(), (wish.lower(),))
    return [name for name in wanted if name in available]


def accelerator(kind: Hashable, decodes: Callable[[HWAccel], bool]) -> HWAccel | None:
    """The first device on which `decodes` is true, and raises no error, for this kind of video, or None. Devices are
    tried once in a process."""
    wish = os.environ.get(HARDWARE_VARIABLE, "auto")
    key = (wish, kind)
    if key not in _WORKING:
        names = candidates(wish, hwdevices_available())
        _WORKING[key] = next((name for name in names if _works(name, decodes)), None)
    name = _WORKING[key]
    return None if name is None else HWAccel(name)


def _works(name: str, decodes: Callable[[HWAccel], bool]) -> bool:
    try:
        return decodes(HWAccel(name, allow_software_fallback=False))
    except (VideoError, av.error.FFmpegError, OSError, RuntimeError, ValueError, MemoryError):
        return False


def in_order(
    frames: Iterator[tuple[float, Frame]], start_s: float, info: VideoInfo
) -> Iterator[tuple[float, Frame, bool]]:
    """Frames with their times (s), and whether each follows the last one that did.

    A time that is not after the last one does not follow. Nor does one that leaps ahead by more than LEAP_S or
    LEAP_FRAMES frames' time, until BELIEVED_AFTER in a row have leapt: then the recording has a gap. The first is
    measured from `start_s`. Raises VideoError where more than BELIEVED_AFTER in a row lie before the last one that
    followed, and go on from there: they are of another recording.
    """
    leap_s = max(LEAP_S, LEAP_FRAMES / info.rate_fps if info.rate_fps > 0 else 0.0)
    last, before, leaps, backs, begun = start_s, start_s, 0, 0, False
    for stamp, frame in frames:
        leapt = stamp > last + leap_s
        leaps = leaps + 1 if leapt else 0
        is_back = begun and stamp < last
        backs = backs + 1 if is_back and stamp > before else int(is_back)
        if backs > BELIEVED_AFTER:
            raise VideoError(several_recordings(info, f"the times begin again after {last:.1f} s"))
        follows = (stamp > last or not begun) and (not leapt or leaps > BELIEVED_AFTER)
        if follows:
            last, begun, leaps = stamp, True, 0
        before = stamp
        yield stamp, frame, follows


def several_recordings(info: VideoInfo, seen: str) -> str:
    """What to say of a file in which one recording follows another, by what is seen of it."""
    return (
        f"{info.path}: holds two recordings, one behind the other: {seen}; give each as a file of its own "
        "(of a transport stream, `ffmpeg -i OLD -c copy NEW.mkv` makes the times go on: "
        "give each as a pass of its own, up to that time and from there)"
    )
