"""Decoding of video files, damaged ones too: all frames of a range, or frames at chosen times; and what a file says of
the camera: its projection, stereo, how it was held, and whether its pictures are to be turned.

FFmpeg reads the camera's metadata from MP4's boxes `sv3d`, `st3d`, `SA3D` and `uuid` (Spherical Video V1 and V2), from
Matroska's `Projection`, and from the display matrix, and gives it with every decoded frame, as the C structures of
libavutil's `spherical.h` and `stereo3d.h`.
"""

import struct
from collections.abc import Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path

import av.error
import numpy as np
from av.codec.hwaccel import HWAccel
from av.container import InputContainer
from av.sidedata.sidedata import SideData, Type
from av.video.frame import PictureType, VideoFrame
from av.video.reformatter import VideoReformatter
from av.video.stream import VideoStream

from savmap.errors import VideoError
from savmap.types import Floats, Planes
from savmap.video.clip import DecodeReport, Picture, Source, VideoInfo, require_memory
from savmap.video.container import accelerator, configure, in_order, is_large, key_times, open_video, seconds, seek

TimedFrames = Iterator[tuple[float, VideoFrame]]

INSTANT_S = 1e-6
SEEK_MARGIN_S, SETTLED_S = 0.5, 1.0
"""How much earlier a search begins, and how much later than its neighbours a good frame may come."""
PLANAR = {"yuv420p", "yuvj420p", "nv12"}
UNSPECIFIED, JPEG_RANGE = 2, 2
WEIGHTS = {1: (0.2126, 0.0722), 5: (0.299, 0.114), 6: (0.299, 0.114), 9: (0.2627, 0.0593), UNSPECIFIED: (0.299, 0.114)}
"""Weights of red and blue in luma, by the number of the colour space (ITU-T H.273, "MatrixCoefficients")."""
TILE = 2
PROJECTIONS = {
    1: "a cube map",
    TILE: "a part of a panorama",
    3: "half a panorama (180 degrees)",
    4: "an ordinary, flat picture",
    5: "fisheye pictures",
    6: "fisheye pictures of a camera with parameters of its own",
}
STEREO = {
    1: "left and right eye side by side",
    2: "left and right eye above one another",
    3: "left and right eye in turn",
    4: "left and right eye on a checkerboard",
    5: "left and right eye side by side",
    6: "left and right eye line by line",
    7: "left and right eye column by column",
}
MOST_TILT_DEG = 60.0
FIXED = 1 << 16
ADVICE = "write one panorama a frame, 2:1, in the camera maker's program"


def decode_file(info: VideoInfo, start_s: float, end_s: float, report: DecodeReport) -> Source:
    """The good frames of a file from start_s up to end_s. Damaged and lost frames are counted."""
    with open_video(info.path, _hardware(info)) as (container, stream):
        configure(stream, info)
        if start_s > 0:
            seek(container, stream, start_s - SEEK_MARGIN_S)
        reformatter = VideoReformatter()
        expected = _Expected()
        good: set[float] = set()
        already, repeated = report.skipped, 0
        for stamp, frame, follows in in_order(_frames(container, stream, expected), start_s, info):
            if follows and stamp >= end_s - INSTANT_S:
                break
            repeated += stamp in good
            if follows and stamp >= start_s - INSTANT_S and _fits(frame, info):
                report.decoded += 1
                good.add(stamp)
                expected.missing.discard(stamp)
                if not repeated and not expected.lacks(start_s, stamp - SETTLED_S):
                    report.whole_until_s = stamp - SETTLED_S
                yield stamp, partial(picture_of, frame, reformatter)
        lost = {s for s in expected if start_s - INSTANT_S <= s < end_s - INSTANT_S} - good
        report.skipped = already + repeated + len(lost)


class _Expected(set[float]):
    """Times of packets that were read; `missing`: those that gave no good frame yet."""

    def __init__(self) -> None:
        super().__init__()
        self.missing: set[float] = set()

    def add(self, stamp: float) -> None:
        super().add(stamp)
        self.missing.add(stamp)

    def lacks(self, start_s: float, end_s: float) -> bool:
        """Whether a frame of a range is missing."""
        return any(start_s - INSTANT_S <= stamp < end_s for stamp in self.missing)


def decode_at(info: VideoInfo, stamps_s: Sequence[float], panoramic: bool = True) -> Iterator[tuple[float, Picture]]:
    """The first good picture at or after each time (ascending); none for times without one. `panoramic` as in
    `frames_from`."""
    reformatter = VideoReformatter()
    for frames in frames_from(info, stamps_s, panoramic=panoramic):
        for stamp, frame in frames:
            yield stamp, picture_of(frame, reformatter)
            break


def frames_from(
    info: VideoInfo,
    stamps_s: Sequence[float],
    margin_s: float = SEEK_MARGIN_S,
    report: DecodeReport | None = None,
    panoramic: bool = True,
) -> Iterator[TimedFrames]:
    """For each time (ascending), the good frames from that time on, with their times; take a few before asking for the
    next.

    Seeks only where a key frame lies between one time and the next, so that no frame is decoded twice. The search
    begins `margin_s` earlier, for the first frames after a key frame may be missed where frames are not shown in the
    order in which they are decoded (B frames); times at key frames of other files need no margin, and cost one frame
    each. All decoded frames are counted in `report`. Raises VideoError for a file of two recordings, and for one that
    says of itself that it holds no upright panoramas where it should (`panoramic`).
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
            yield _from(frames, stamp, info, panoramic)


def _within(keys: Floats, key: int) -> float:
    """A time that leads to a key frame, whether times of decoding or of showing are searched: half way to the next."""
    following = keys[key + 1] if key + 1 < len(keys) else keys[key] + 1.0
    return float(keys[key] + following) / 2


def _from(frames: TimedFrames, start_s: float, info: VideoInfo, panoramic: bool) -> TimedFrames:
    for stamp, frame in frames:
        if stamp >= start_s - INSTANT_S and _fits(frame, info):
            check_frame(info.path, frame, panoramic)
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
        except StopIteration:
            return
        except av.error.FFmpegError:
            require_memory(stream.codec_context.width, stream.codec_context.height)
            return
        if packet.pts is not None and packet.size and not packet.is_discard:
            expected.add(seconds(packet.pts, stream))
        try:
            frames = packet.decode()
        except av.error.BlockingIOError as error:  # of a decoder that cannot begin: its threads take memory
            raise MemoryError("FFmpeg can start no thread") from error
        except av.error.FFmpegError:
            require_memory(stream.codec_context.width, stream.codec_context.height)
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


def picture_of(frame: VideoFrame, reformatter: VideoReformatter) -> Picture:
    """A frame's planes, without a copy where they lie in the frame's own memory; RGB (H, W, 3) of frames in other
    formats."""
    name, weights = frame.format.name, WEIGHTS.get(int(frame.colorspace))
    if name not in PLANAR or weights is None or frame.width % 2 or frame.height % 2:
        return np.asarray(reformatter.reformat(frame, format="rgb24").to_ndarray(), np.uint8)
    full = name == "yuvj420p" or int(frame.color_range) == JPEG_RANGE
    luma, *colour = (np.frombuffer(memoryview(plane), np.uint8).reshape(-1, plane.line_size) for plane in frame.planes)
    half = frame.height // 2, frame.width // 2
    if name == "nv12":  # blue and red differences alternate along rows, as devices give them
        colour = [np.ascontiguousarray(colour[0][:, first : frame.width : 2]) for first in (0, 1)]
    blue, red = (plane[: half[0], : half[1]] for plane in colour)
    return Planes(luma[: frame.height, : frame.width], blue, red, rgb_from_yuv(*weights, full))


def rgb_from_yuv(of_red: float, of_blue: float, full: bool) -> Floats:
    """Matrix (3, 4) from (luma, blue difference, red difference, 1), each 0..255, to RGB, 0..255 (ITU-R BT.709, section
    3)."""
    of_green = 1 - of_red - of_blue
    blue, red = 2 * (1 - of_blue), 2 * (1 - of_red)
    from_differences = np.array([[0, red], [-blue * of_blue / of_green, -red * of_red / of_green], [blue, 0]])
    low, luma, chroma = (0, 1.0, 1.0) if full else (16, 255 / 219, 255 / 224)
    matrix = np.hstack([np.full((3, 1), luma), chroma * from_differences])
    return np.hstack([matrix, -matrix @ [[low], [128], [128]]])


def check_frame(path: Path, frame: VideoFrame, panoramic: bool = True) -> None:
    """Raise VideoError where a file's first frame comes with the word that it is to be turned, or, where it should be
    one, no upright panorama of one eye."""
    for objection in _objections(frame, panoramic):
        raise VideoError(f"{path}: {objection}")


def _objections(frame: VideoFrame, panoramic: bool) -> Iterator[str]:
    entries: Iterable[SideData] = frame.side_data  # type: ignore[assignment]  # PyAV's stub: names, not entries
    data = {entry.type: bytes(entry) for entry in entries}
    yield from _of_matrix(data.get(Type.DISPLAYMATRIX, b""))
    if panoramic:
        yield from _of_stereo(data.get(Type.STEREO3D, b""))
        yield from _of_sphere(data.get(Type.SPHERICAL, b""))


def _of_matrix(data: bytes) -> Iterator[str]:
    """Of a display matrix (ISO/IEC 14496-12): the first two of three numbers in the first two rows turn and mirror."""
    if len(data) < 36:
        return
    a, b, _, c, d = struct.unpack_from("<5i", data)
    turned = round(float(np.degrees(np.arctan2(b, a)))) % 360
    rewrite = "by the player: write them as they are to be shown (ffmpeg -i OLD NEW)"
    if a * d - b * c < 0:
        yield f"its pictures are mirrored, and to be mirrored back {rewrite}"
    elif turned:
        yield f"its pictures are to be turned by {turned} degrees {rewrite}"


def _of_stereo(data: bytes) -> Iterator[str]:
    kind = struct.unpack_from("<i", data)[0] if len(data) >= 4 else 0
    if kind in STEREO:
        yield f"is stereo by its metadata ({STEREO[kind]}), no single panorama: {ADVICE}, of one eye"


def _of_sphere(data: bytes) -> Iterator[str]:
    """Of projection, yaw, pitch and roll (16.16 degrees), and the tile's bounds (shares of the whole, 0.32)."""
    if len(data) < 32:
        return
    projection, _, pitch, roll, *bounds = struct.unpack_from("<4i4I", data)
    if projection in PROJECTIONS and not (projection == TILE and not any(bounds)):
        yield f"holds {PROJECTIONS[projection]} by its metadata, no whole equirectangular panorama: {ADVICE}"
    upright = float(np.cos(np.radians(pitch / FIXED)) * np.cos(np.radians(roll / FIXED)))
    if upright < np.cos(np.radians(MOST_TILT_DEG)):
        tilt = float(np.degrees(np.arccos(np.clip(upright, -1, 1))))
        levelled = "write it levelled in the camera maker's program"
        yield f"its camera was tilted by {tilt:.0f} degrees, by its metadata: {levelled}"
