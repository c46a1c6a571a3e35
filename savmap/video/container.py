"""Video files: opened, probed and searched with PyAV, and the devices that decode them."""

import os
from collections.abc import Callable, Hashable, Iterator, Sequence
from contextlib import contextmanager, suppress
from fractions import Fraction
from pathlib import Path

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
from savmap.video.clip import END_TOLERANCE_S, MOST_PIXELS, VideoInfo, check_shape

CONTAINERS = "mov,matroska,avi,mpegts,mpeg,asf,flv,mxf,ogg,nut"
"""FFmpeg's demuxers that are used: those with time stamps, none that opens other files or addresses as play lists do."""
OPENING = {"format_whitelist": CONTAINERS, "protocol_whitelist": "file", "max_pixels": str(MOST_PIXELS)}
OPENING_S, READING_S = 60.0, 10.0
"""How long a header, and a packet, may take to come: a file may go on with many gigabytes of nothing."""
SMALL_PIXELS = 1 << 16
LARGE_PIXELS = 16_000_000
LARGE_THREADS = 4
HARDWARE_VARIABLE = "SAVMAP_HARDWARE"
DEVICES = ("videotoolbox", "cuda", "vaapi", "d3d11va", "qsv")
"""Kinds of hardware decoders, best first."""
_WORKING: dict[Hashable, str | None] = {}


@contextmanager
def open_video(path: Path, hardware: HWAccel | None = None) -> Iterator[tuple[InputContainer, VideoStream]]:
    """A video file's container and first video stream. Raises VideoError where the file cannot be read."""
    try:
        source = path.open("rb") if is_url(path) else str(path)
        container = av.open(source, "r", options=OPENING, timeout=(OPENING_S, READING_S), hwaccel=hardware)
    except (av.error.FFmpegError, OSError) as error:
        raise VideoError(_why_unreadable(path)) from error
    with container:
        yield container, _main_stream(path, container)


def _main_stream(path: Path, container: InputContainer) -> VideoStream:
    """The video stream that holds the panoramas: cover pictures and smaller copies of it are left aside.

    Raises VideoError where there is none, and where two of one size may both be meant.
    """
    known = [stream for stream in container.streams.video if stream.codec_context is not None]
    streams = [stream for stream in known if not stream.disposition & Disposition.attached_pic] or known
    if not streams:
        raise VideoError(f"{path}: has no video stream that can be decoded")
    best = max(streams, key=lambda stream: (stream.width == 2 * stream.height, stream.width * stream.height))
    others = [stream for stream in streams if (stream.width, stream.height) == (best.width, best.height)]
    if len(others) > 1:
        raise VideoError(
            f"{path}: has {len(others)} video streams of {best.width}x{best.height} (two lenses?): stitch them in the camera maker's "
            f"program, or write the one that is a panorama by itself (ffmpeg -i OLD -map 0:{best.index} -c copy NEW)"
        )
    return best


def _why_unreadable(path: Path) -> str:
    try:
        with path.open("rb") as file:
            head = file.read(12)
    except OSError as error:
        return f"{path}: cannot be read: {error.strerror}"
    if head[4:8] == b"ftyp":
        return f"{path}: the file is cut off or damaged (its index is missing); copy it from the camera again"
    return f"{path}: not a video file of a kind that is read (MP4, MOV, Matroska, AVI, MPEG)"


def probe_file(path: Path) -> VideoInfo:
    """What a video file's header says. Raises VideoError for a file that is no video, damaged, or not 2:1."""
    with open_video(path) as (container, stream):
        context = stream.codec_context
        check_shape(path, context.width, context.height)
        duration = _duration_s(container, stream)
        rate = float(stream.average_rate or stream.guessed_rate or 0)
        return VideoInfo(path, context.width, context.height, context.name, context.pix_fmt or "", rate, duration)


def _duration_s(container: InputContainer, stream: VideoStream) -> float:
    if stream.duration and stream.time_base:
        return float(stream.duration * stream.time_base)
    said = container.duration / av.time_base if container.duration else 0.0
    begins = container.start_time / av.time_base if container.start_time else 0.0
    if said and begins <= END_TOLERANCE_S:
        return said
    return _last_time(container, stream, said) or said


def _last_time(container: InputContainer, stream: VideoStream, near_s: float) -> float:
    """The end of a stream, s from its first time, of its last packets: a header may count its length from 0, though the stream begins
    hours later, or give none (`near_s` is 0 then, and all packets are read)."""
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
    """Set the decoder's threads and its largest picture.

    Each frame thread holds a picture: there are fewer of them where pictures are large. If pictures turn out to be much larger than
    the header says, the decoder refuses them before it takes memory.
    """
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
    """Times (n,) s at which a file shows key frames; none where frames are shown in another order than they are decoded in (B
    frames), because the index has decoding times."""
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


def candidates(wish: str, known: Sequence[str]) -> list[str]:
    """Devices to try, best first, of those that FFmpeg was built with."""
    wanted = {"auto": DEVICES, "": DEVICES, "off": ()}.get(wish.lower(), (wish.lower(),))
    return [name for name in wanted if name in known]


def accelerator(kind: Hashable, decodes: Callable[[HWAccel], bool]) -> HWAccel | None:
    """The first device on which `decodes` is true for this kind of video, or None. Devices are tried once in a process.

    A device counts as false if it raises an error.
    """
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
    except (VideoError, av.error.FFmpegError, OSError, RuntimeError, ValueError):
        return False
