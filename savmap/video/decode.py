"""Decoding of video files, damaged ones too: all frames of a range, or frames at chosen times."""

from collections.abc import Callable, Iterator, Sequence

import av.error
import numpy as np
from av.codec.hwaccel import HWAccel
from av.container import InputContainer
from av.video.frame import PictureType, VideoFrame
from av.video.reformatter import VideoReformatter
from av.video.stream import VideoStream
from numpy.typing import NDArray

from savmap.types import Floats, Planes
from savmap.video.camera_metadata import check_frame
from savmap.video.clip import DecodeReport, Picture, Source, VideoInfo
from savmap.video.container import accelerator, configure, is_large, key_times, open_video, seconds, seek
from savmap.video.order import in_order

TimedFrames = Iterator[tuple[float, VideoFrame]]

INSTANT_S = 1e-6
SEEK_MARGIN_S = 0.5
PLANAR = {"yuv420p", "yuvj420p", "nv12"}
UNSPECIFIED, JPEG_RANGE = 2, 2
WEIGHTS = {1: (0.2126, 0.0722), 5: (0.299, 0.114), 6: (0.299, 0.114), 9: (0.2627, 0.0593), UNSPECIFIED: (0.299, 0.114)}
"""Weights of red and blue in luma, by the number of the colour space (ITU-T H.273, "MatrixCoefficients")."""


def decode_file(info: VideoInfo, start_s: float, end_s: float, report: DecodeReport) -> Source:
    """The good frames of a file from start_s up to end_s. Damaged and lost frames are counted."""
    with open_video(info.path, _hardware(info)) as (container, stream):
        configure(stream, info)
        if start_s > 0:
            seek(container, stream, start_s - SEEK_MARGIN_S)
        reformatter = VideoReformatter()
        expected: set[float] = set()
        good: set[float] = set()
        already, repeated = report.skipped, 0
        for stamp, frame, follows in in_order(_frames(container, stream, expected), start_s, info):
            if follows and stamp >= end_s - INSTANT_S:
                break
            repeated += stamp in good
            if follows and stamp >= start_s - INSTANT_S and _fits(frame, info):
                report.decoded += 1
                good.add(stamp)
                yield stamp, _reader(frame, reformatter)
        lost = {s for s in expected if start_s - INSTANT_S <= s < end_s - INSTANT_S} - good
        report.skipped = already + repeated + len(lost)


def decode_at(info: VideoInfo, stamps_s: Sequence[float]) -> Iterator[tuple[float, Picture]]:
    """The first good picture at or after each time (ascending); none for times without one."""
    reformatter = VideoReformatter()
    for frames in frames_from(info, stamps_s):
        for stamp, frame in frames:
            yield stamp, picture_of(frame, reformatter)
            break


def frames_from(
    info: VideoInfo, stamps_s: Sequence[float], margin_s: float = SEEK_MARGIN_S, report: DecodeReport | None = None
) -> Iterator[TimedFrames]:
    """For each time (ascending), the good frames from that time on, with their times; take a few before asking for the
    next.

    Seeks only where a key frame lies between one time and the next, so that no frame is decoded twice. Where frames are
    shown in another order than they are decoded in (B frames), the first frames after a key frame may be missed unless
    the search begins `margin_s` earlier. Times at key frames need no margin otherwise, and cost one frame each. All
    decoded frames are counted in `report`. Raises VideoError where the file says of itself that it holds no upright
    panoramas, and where it holds two recordings.
    """
    report = DecodeReport() if report is None else report
    with open_video(info.path) as (container, stream):
        configure(stream, info)
        keys = key_times(stream)
        exact = np.isin(stamps_s, keys)
        if margin_s and stream.codec_context.has_b_frames:
            exact[:] = False
        if 2 * np.count_nonzero(exact) > len(exact):
            stream.thread_type = "SLICE"  # gives each picture at once; frame threads decode some that are not needed
        frames, last_key = _counted(_frames(container, stream, set()), info, report), 0
        for stamp, is_exact in zip(stamps_s, exact.tolist(), strict=True):
            reach = stamp + INSTANT_S - (0.0 if is_exact else margin_s)
            key = max(int(np.searchsorted(keys, reach, side="right")) - 1, 0)
            if key > last_key:
                seek(container, stream, _within(keys, key))
                frames, last_key = _counted(_frames(container, stream, set()), info, report, stamp), key
            yield _from(frames, stamp, info)


def _within(keys: Floats, key: int) -> float:
    """A time that leads to a key frame, whether the container searches by the time of decoding or of showing: half way
    to the next."""
    following = keys[key + 1] if key + 1 < len(keys) else keys[key] + 1.0
    return float(keys[key] + following) / 2


def _from(frames: TimedFrames, start_s: float, info: VideoInfo) -> TimedFrames:
    for stamp, frame in frames:
        if stamp >= start_s - INSTANT_S and _fits(frame, info):
            check_frame(info.path, frame)
            yield stamp, frame


def _counted(frames: TimedFrames, info: VideoInfo, report: DecodeReport, start_s: float = 0.0) -> TimedFrames:
    for stamp, frame, _ in in_order(frames, start_s, info):
        report.decoded += 1
        yield stamp, frame


def _frames(container: InputContainer, stream: VideoStream, expected: set[float]) -> TimedFrames:
    """Sound frames with their times; the times of the packets read go into `expected`.

    Frames after a damaged or lost one are predicted from it: the next sound frame is the next that stands by itself.
    """
    packets = container.demux(stream)
    sound = True
    while True:
        try:
            packet = next(packets)
        except (StopIteration, av.error.FFmpegError):
            return
        if packet.pts is not None and packet.size and not packet.is_discard:
            expected.add(seconds(packet.pts, stream))
        try:
            frames = packet.decode()
        except av.error.FFmpegError:
            sound = False
            continue
        for frame in (frame for frame in frames if isinstance(frame, VideoFrame)):
            sound = not frame.is_corrupt and (sound or frame.key_frame or frame.pict_type == PictureType.I)
            if sound and frame.pts is not None:
                yield seconds(frame.pts, stream), frame


def _fits(frame: VideoFrame, info: VideoInfo) -> bool:
    return (frame.width, frame.height) == (info.width, info.height)


def _hardware(info: VideoInfo) -> HWAccel | None:
    """A device that decodes a video of large pictures faster than the processor, if there is one."""

    def decodes(device: HWAccel) -> bool:
        with open_video(info.path, device) as (container, stream):
            configure(stream, info)
            _, frame = next(_frames(container, stream, set()), (0.0, None))
            return frame is not None and _fits(frame, info) and frame.format.name in PLANAR

    return accelerator((info.codec, info.pixel_format, info.width), decodes) if is_large(info) else None


def _reader(frame: VideoFrame, reformatter: VideoReformatter) -> Callable[[], Picture]:
    return lambda: picture_of(frame, reformatter)


def picture_of(frame: VideoFrame, reformatter: VideoReformatter) -> Picture:
    """A frame's planes, without a copy where they lie in the frame's own memory; RGB (H, W, 3) of frames in other
    formats."""
    name, weights = frame.format.name, WEIGHTS.get(int(frame.colorspace))
    if name not in PLANAR or weights is None or frame.width % 2 or frame.height % 2:
        return np.asarray(reformatter.reformat(frame, format="rgb24").to_ndarray(), np.uint8)
    full = name == "yuvj420p" or int(frame.color_range) == JPEG_RANGE
    luma, *colour = (np.frombuffer(memoryview(plane), np.uint8).reshape(-1, plane.line_size) for plane in frame.planes)
    half = frame.height // 2, frame.width // 2
    blue, red = (
        _deinterleaved(colour[0][: half[0], : frame.width])
        if name == "nv12"
        else (plane[: half[0], : half[1]] for plane in colour)
    )
    return Planes(luma[: frame.height, : frame.width], blue, red, rgb_from_yuv(*weights, full))


def _deinterleaved(pairs: NDArray[np.uint8]) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Blue and red differences that alternate along rows, as devices give them."""
    return np.ascontiguousarray(pairs[:, 0::2]), np.ascontiguousarray(pairs[:, 1::2])


def rgb_from_yuv(of_red: float, of_blue: float, full: bool) -> Floats:
    """Matrix (3, 4) from (luma, blue difference, red difference, 1), each 0..255, to RGB, 0..255 (ITU-R BT.709, section
    3)."""
    of_green = 1 - of_red - of_blue
    blue, red = 2 * (1 - of_blue), 2 * (1 - of_red)
    from_differences = np.array([[0, red], [-blue * of_blue / of_green, -red * of_red / of_green], [blue, 0]])
    low, luma, chroma = (0, 1.0, 1.0) if full else (16, 255 / 219, 255 / 224)
    matrix = np.hstack([np.full((3, 1), luma), chroma * from_differences])
    return np.hstack([matrix, -matrix @ [[low], [128], [128]]])
