"""Footage that is still being made: a folder that grows, a camera or an address that FFmpeg opens, which is recorded as
it comes, and panoramas that another program hands over."""

import logging
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from fractions import Fraction
from functools import partial
from pathlib import Path

import av
import av.error
import numpy as np
from av.container import InputContainer
from av.video.frame import VideoFrame
from av.video.reformatter import VideoReformatter
from av.video.stream import VideoStream

from savmap.errors import OutputError, VideoError
from savmap.types import Panorama, panorama_of
from savmap.video.clip import Clip, DecodeReport, Image, Source, check_shape
from savmap.video.decode import picture_of
from savmap.video.image_folder import picture_paths, picture_size, read_picture
from savmap.video.reader import sampled

POLL_S = 0.05
OPENING_S, READING_S = 20.0, 10.0
DEVICES = {"/dev/video": "v4l2", "avfoundation:": "avfoundation"}
"""Input formats of FFmpeg by how the names of cameras of this machine begin."""
CLUSTER = {"cluster_time_limit": "1000", "flush_packets": "1"}
"""A second of footage at most is lost where a recording is cut off."""
MILLISECOND = Fraction(1, 1000)
USUAL_RATE = 25
"""Pictures a second of a stream that says none: FFmpeg's own."""
log = logging.getLogger("savmap")
BEST_QUALITY = 2
"""Of MJPEG's quantisers."""


def paced(panoramas: Iterable[Panorama], pace: float) -> Iterator[Panorama]:
    """Panoramas not before their time: a second of footage in 1 / `pace` seconds. 0: as fast as they come."""
    begun: float | None = None
    for panorama in panoramas:
        if pace > 0:
            begun = time.monotonic() - panorama.stamp_s / pace if begun is None else begun
            time.sleep(max(begun + panorama.stamp_s / pace - time.monotonic(), 0.0))
        yield panorama


def growing_folder(clip: Clip, idle_s: float) -> Iterator[Panorama]:
    """The panoramas of a folder into which pictures are still written, in the order of their names, numbered and timed
    as a run over the finished folder does. It ends when no new one came for `idle_s`.

    Raises VideoError where a picture is not 2:1, or none ever came.
    """
    report = DecodeReport()
    for stamp, image in sampled(_new_pictures(clip, idle_s), clip.fps, report, ()):
        yield panorama_of(report.used - 1, stamp, image)
    if not report.used:
        raise VideoError(f"{clip.path}: no picture came within {idle_s:g} s; write panoramas into it, or raise --idle")


def _new_pictures(clip: Clip, idle_s: float) -> Source:
    taken, waited_from, size = 0, time.monotonic(), None
    while time.monotonic() - waited_from < idle_s:
        paths = picture_paths(clip.path)[taken:] if clip.path.is_dir() else []
        for number, path in enumerate(paths):
            size = size or picture_size(path)
            image = read_picture(path, size) if size else None
            if image is None and number == len(paths) - 1:
                break  # it is still being written
            if image is not None:
                check_shape(path, image.shape[1], image.shape[0])
            yield taken / clip.images_fps, partial(_given, image)
            taken, waited_from = taken + 1, time.monotonic()
        time.sleep(POLL_S)


def _given(image: Image | None) -> Image | None:
    return image


def camera_frames(address: str, recording: Path, fps: float) -> Iterator[Panorama]:
    """The panoramas of a camera, `fps` a second, while its packets are written into a Matroska file as they are.

    address: a device of this machine (`/dev/video0`, `avfoundation:0`), or what FFmpeg opens, such as rtsp://host/path.
    Raises VideoError where it cannot be opened, sends nothing for 10 s, or sends no panoramas; OutputError where the
    recording cannot be written.
    """
    report = DecodeReport()
    for stamp, picture in sampled(_camera_pictures(address, recording), fps, report, ()):
        yield panorama_of(report.used - 1, stamp, picture)
    if not report.used:
        raise VideoError(f"{address}: sent no frame that can be decoded")


def _camera_pictures(address: str, recording: Path) -> Source:
    form = next((form for begin, form in DEVICES.items() if address.startswith(begin)), None)
    options = {"rtsp_transport": "tcp"} if address.startswith("rtsp") else {}
    try:
        source = av.open(
            address.removeprefix("avfoundation:"), "r", form, options=options, timeout=(OPENING_S, READING_S)
        )
    except (av.error.FFmpegError, OSError, ValueError) as error:
        raise VideoError(
            f"{address}: cannot be opened ({_why(error, OPENING_S)}); is the camera on, and its address right?"
        ) from error
    with source:
        if not source.streams.video:
            raise VideoError(f"{address}: sends no video")
        stream = source.streams.video[0]
        check_shape(address, stream.codec_context.width, stream.codec_context.height)
        with StreamCopy(recording, stream) as copy:
            yield from _copied(address, source, stream, copy)


def _copied(address: str, source: InputContainer, stream: VideoStream, copy: "StreamCopy") -> Source:
    """Pictures with their times. The last packet of a source may be cut off, and whether a decoder with several threads
    calls its picture damaged changes from run to run: it is not recorded."""
    reformatter, first_s = VideoReformatter(), None
    packets = _going_on(source.demux(stream), stream)
    latest: av.Packet[VideoStream] | None = None
    while True:
        try:
            packet = next(packets, None)
        except av.error.FFmpegError as error:
            raise VideoError(f"{address}: the source is lost ({_why(error, READING_S)})") from error
        if packet is None:
            return
        frames: list[VideoFrame] = []
        with suppress(av.error.InvalidDataError):
            frames = [frame for frame in packet.decode() if isinstance(frame, VideoFrame)]
        if packet.dts is not None:
            if latest is not None:
                copy.write(latest)
            latest = packet
        for frame in frames:
            if frame.time is not None:
                first_s = frame.time if first_s is None else first_s
                yield frame.time - first_s, partial(picture_of, frame, reformatter)


def _going_on(packets: "Iterable[av.Packet[VideoStream]]", stream: VideoStream) -> "Iterator[av.Packet[VideoStream]]":
    """Packets whose times go on: one without a time, or with one that does not, comes as long after the one before as
    it took to come, at least by a frame's time; those that follow go on from there. The first time is said."""
    tick = stream.time_base or MILLISECOND
    frame = max(round(1 / (stream.average_rate or USUAL_RATE) / tick), 1)
    shift, came_s, mended = 0, 0.0, False
    last: int | None = None
    for packet in packets:
        given = packet.pts if packet.dts is None else packet.dts
        before_s, came_s = came_s, time.monotonic()
        if packet.size and (given is None or (last is not None and not 0 < given + shift - last <= READING_S / tick)):
            due = 0 if last is None else last + max(round((came_s - before_s) / tick), frame)
            shift = due - (given or 0)
            if not mended:
                log.warning("the camera's times are missing, stand still or jump: pictures count from when they came")
            mended = True
        if packet.size:
            packet.pts, packet.dts = shift + (packet.pts or given or 0), shift + (given or 0)
            last = packet.dts
        yield packet


def _why(error: Exception, waited_s: float = 0.0) -> str:
    if isinstance(error, av.error.ExitError):  # of the timeout
        return f"nothing came for {waited_s:g} s"
    return getattr(error, "strerror", None) or str(error)


class StreamCopy:
    """A Matroska file that takes packets of a stream as they are. Raises OutputError where it cannot be written."""

    def __init__(self, path: Path, stream: VideoStream) -> None:
        self.path = path
        with _writing(path):
            self._file = av.open(str(path), "w", "matroska", options=CLUSTER)
            self._stream = self._file.add_stream_from_template(stream)

    def write(self, packet: "av.Packet[VideoStream]") -> None:
        """Append a packet."""
        packet.stream = self._stream
        with _writing(self.path):
            self._file.mux(packet)

    def __enter__(self) -> "StreamCopy":
        return self

    def __exit__(self, *_: object) -> None:
        with suppress(av.error.FFmpegError, OSError):
            self._file.close()


class FrameRecorder:
    """A Matroska file of panoramas (H, 2H, 3) uint8 RGB, each a JPEG, with their times. Raises OutputError where it
    cannot be written."""

    def __init__(self, path: Path) -> None:
        self.path = path
        with _writing(path):
            self._file = av.open(str(path), "w", "matroska", options=CLUSTER)
        self._stream: VideoStream | None = None
        self._last_s = -np.inf

    def write(self, stamp_s: float, image: Image) -> None:
        """Append a panorama. Raises VideoError where its time is not after that of the one before."""
        if stamp_s <= self._last_s:
            raise VideoError(f"a panorama of {stamp_s:g} s comes after one of {self._last_s:g} s: times must ascend")
        self._last_s = stamp_s
        with _writing(self.path):
            stream = self._stream or self._begun(image)
            frame = VideoFrame.from_ndarray(np.ascontiguousarray(image), "rgb24")
            frame.pts, frame.time_base = round(stamp_s * MILLISECOND.denominator), MILLISECOND
            self._file.mux(stream.encode(frame))

    def close(self) -> None:
        """End the file."""
        with _writing(self.path):
            if self._stream is not None:
                self._file.mux(self._stream.encode(None))
            self._file.close()

    def _begun(self, image: Image) -> VideoStream:
        stream = self._file.add_stream("mjpeg", rate=30)
        stream.height, stream.width = image.shape[:2]
        stream.pix_fmt = "yuvj420p"
        stream.time_base = stream.codec_context.time_base = MILLISECOND
        stream.codec_context.qmin = stream.codec_context.qmax = BEST_QUALITY
        self._stream = stream
        return stream


@contextmanager
def _writing(path: Path) -> Iterator[None]:
    """Errors of FFmpeg in writing a file as OutputError."""
    try:
        yield
    except (av.error.FFmpegError, OSError) as error:
        raise OutputError(f"{path}: the recording cannot be written ({_why(error)})") from error
