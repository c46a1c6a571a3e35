"""Sound containers with broken streams: packets lost, doubled, mixed up or of another codec, times that jump, sizes that change."""

import struct
from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
from broken import FRAMES, RATE, Maker, any_base, encode, picture, put, video_in

AHEAD = 200
Packets = list["av.Packet[Any]"]
PIXEL_FORMATS: Sequence[tuple[str, str, str]] = (
    ("libx264", "yuv420p10le", "mp4"),
    ("libx264", "yuv422p", "mp4"),
    ("libx264", "yuv422p10le", "mkv"),
    ("libx264", "yuv444p", "mov"),
    ("libx264", "gray", "mp4"),
    ("libx265", "yuv420p10le", "mp4"),
    ("libx265", "gray", "mkv"),
    ("libx265", "yuv422p12le", "mkv"),
    ("ffv1", "gray16le", "mkv"),
    ("ffv1", "bgr0", "mkv"),
    ("ffv1", "yuva420p", "mkv"),
    ("mjpeg", "yuvj444p", "mov"),
    ("libvpx-vp9", "yuv444p", "webm"),
    ("prores_ks", "yuv422p10le", "mov"),
)


def _remuxed(change: Callable[[Packets, np.random.Generator], Packets], keep_times: bool = False) -> Maker:
    """The packets of a sound file, changed, in a new container; those that it does not take are left out."""

    def make(folder: Path, rng: np.random.Generator) -> Path:
        data, codec, container = any_base(rng, ("mp4", "mkv", "avi", "webm", "mov"))
        source = put(folder, f"source.{container}", data)
        target = folder / f"{codec}.{container}"
        with av.open(str(source)) as given, av.open(str(target), "w", options={"strict": "-2"}) as made:
            stream = made.add_stream_from_template(given.streams.video[0])
            packets = [packet for packet in given.demux(video=0) if packet.size]
            for packet in change(packets, rng):
                packet.stream = stream
                try:
                    made.mux(packet)
                except (av.error.FFmpegError, ValueError):
                    continue
        source.unlink()
        return target

    return make


def _same_times(packets: Packets, order: Sequence[int]) -> Packets:
    """Payloads in another order, at the times that the places had."""
    mixed = []
    for place, index in zip(packets, order, strict=False):
        packet = av.Packet(bytes(packets[index]))
        packet.pts, packet.dts, packet.time_base = place.pts, place.dts, place.time_base
        packet.is_keyframe = place.is_keyframe
        mixed.append(packet)
    return mixed


def _lost(packets: Packets, rng: np.random.Generator) -> Packets:
    kept = rng.random(len(packets)) > rng.uniform(0.05, 0.7)
    return [packet for packet, keep in zip(packets, kept, strict=True) if keep]


def _mixed_up(packets: Packets, rng: np.random.Generator) -> Packets:
    order = np.arange(len(packets))
    for a, b in rng.integers(0, len(packets), (int(rng.integers(1, 12)), 2)):
        order[[a, b]] = order[[b, a]]
    return _same_times(packets, order.tolist())


def _twice(packets: Packets, rng: np.random.Generator) -> Packets:
    return _same_times(packets, np.sort(rng.integers(0, len(packets), len(packets))).tolist())


def _reversed(packets: Packets, rng: np.random.Generator) -> Packets:
    return _same_times(packets, list(range(len(packets)))[::-1])


def _rubbish(packets: Packets, rng: np.random.Generator) -> Packets:
    made = _same_times(packets, range(len(packets)))
    for index in rng.integers(0, len(packets), int(rng.integers(1, 12))):
        old = made[index]
        content = bytes(old) if rng.random() < 0.5 else b""
        new = av.Packet(content[: len(content) // 2] + rng.bytes(int(rng.integers(1, 400))))
        new.pts, new.dts, new.time_base, new.is_keyframe = old.pts, old.dts, old.time_base, old.is_keyframe
        made[index] = new
    return made


def _times(change: Callable[[float, int, np.random.Generator], float]) -> Maker:
    """Packets whose times (in frames) are changed. Decoding times, which containers check, run on evenly, far ahead of them."""

    def make(folder: Path, rng: np.random.Generator) -> Path:
        suffix = str(rng.choice(["mkv", "mov", "ts"]))
        target = folder / f"times.{suffix}"
        at = int(rng.integers(3, FRAMES - 3))
        codec = "mjpeg" if suffix != "ts" else "mpeg2video"
        with av.open(str(target), "w") as container:
            stream = video_in(container, codec)
            stream.gop_size = 0
            for index in range(FRAMES):
                frame = av.VideoFrame.from_ndarray(picture(index), format="rgb24")
                frame.pts, frame.time_base = index, Fraction(1, RATE)
                for packet in stream.encode(frame):
                    packet.dts = index
                    packet.pts = int(max(index, min(2**40, AHEAD + change(index, at, rng))))
                    try:
                        container.mux(packet)
                    except (av.error.FFmpegError, ValueError):
                        continue
        return target

    return make


def _pixel_format(folder: Path, rng: np.random.Generator) -> Path:
    codec, pixels, container = PIXEL_FORMATS[int(rng.integers(len(PIXEL_FORMATS)))]
    return encode(folder / f"{codec}-{pixels}.{container}", codec, pixels=pixels)


def _few_frames(folder: Path, rng: np.random.Generator) -> Path:
    codec, container = [("libx264", "mp4"), ("mjpeg", "avi"), ("libvpx-vp9", "webm")][int(rng.integers(3))]
    return encode(folder / f"few.{container}", codec, count=int(rng.integers(1, 3)))


def _odd_rate(folder: Path, rng: np.random.Generator) -> Path:
    step = float(rng.choice([0.0002, 0.001, 7.0, 1000.0, 20000.0]))
    return encode(folder / "rate.mkv", "mjpeg", stamps=lambda index: index * step)


def _size_changes(folder: Path, rng: np.random.Generator) -> Path:
    """Transport streams of two sizes, one after the other, as a recorder joins them."""
    height = int(rng.choice([32, 66, 128, 1024]))
    parts = [encode(folder / f"{h}.ts", "libx264", count=20, size=(2 * h, h)) for h in (64, height, 64)]
    joined = put(folder, "joined.ts", b"".join(part.read_bytes() for part in parts))
    for part in set(parts):
        part.unlink()
    return joined


def _jpeg(index: int, size: tuple[int, int]) -> bytes:
    return cv2.imencode(".jpg", picture(index, *size)[..., ::-1])[1].tobytes()


def _jpeg_sizes(folder: Path, rng: np.random.Generator) -> Path:
    """Motion JPEG in which some pictures say that they are of another size, enormous ones too."""
    target = folder / "sizes.avi"
    with av.open(str(target), "w") as container:
        stream = video_in(container, "mjpeg")
        for index in range(FRAMES):
            data = bytearray(_jpeg(index, (128, 64)))
            if rng.random() < 0.3 or (index == 0 and rng.random() < 0.5):
                at = data.index(b"\xff\xc0") + 5
                height = int(rng.choice([32, 80, 8192, 16384, 32000]))
                data[at : at + 4] = struct.pack(">HH", height, 2 * height)
            packet = av.Packet(bytes(data))
            packet.stream, packet.time_base = stream, Fraction(1, RATE)
            packet.pts = packet.dts = index
            packet.is_keyframe = True
            container.mux(packet)
    return target


def _wave(jump: float) -> Callable[[float, int, np.random.Generator], float]:
    return lambda index, at, rng: index + (jump if index == at else 0)


STREAMS: Mapping[str, Maker] = {
    "packets lost": _remuxed(_lost),
    "packets mixed up": _remuxed(_mixed_up),
    "packets repeated": _remuxed(_twice),
    "packets reversed": _remuxed(_reversed),
    "packets of rubbish": _remuxed(_rubbish),
    "one time leaps": _times(_wave(2**31)),
    "one time leaps a minute": _times(_wave(1800)),
    "one time goes back": _times(_wave(-12)),
    "times leap": _times(lambda index, at, rng: index + (10**6 if index > at else 0)),
    "times go back": _times(lambda index, at, rng: index - (at if index > at else 0)),
    "times stand still": _times(lambda index, at, rng: min(index, at)),
    "times random": _times(lambda index, at, rng: float(rng.integers(-100, 100))),
    "times huge": _times(lambda index, at, rng: index + 2**39),
    "pixel formats": _pixel_format,
    "few frames": _few_frames,
    "odd rates": _odd_rate,
    "size changes": _size_changes,
    "sizes of motion jpeg": _jpeg_sizes,
}
