"""Broken media for `bench/fuzz.py` and the tests: small panoramic videos, and many ways to break their bytes.

A maker takes a folder and a random generator, writes one file (or a folder of pictures) there and returns its path.
`KINDS` names them all; the same seed gives the same file.
"""

import tempfile
from collections.abc import Callable, Mapping
from fractions import Fraction
from functools import cache
from pathlib import Path

import av
import numpy as np
from av.container import OutputContainer
from av.video.stream import VideoStream
from numpy.typing import NDArray

Maker = Callable[[Path, np.random.Generator], Path]
Picture = NDArray[np.uint8]

FRAMES, RATE, WIDTH, HEIGHT = 36, 30, 128, 64
BASES: tuple[tuple[str, str], ...] = (
    ("libx264", "mp4"),
    ("libx264", "mov"),
    ("libx264", "mkv"),
    ("libx264", "ts"),
    ("libx265", "mp4"),
    ("libx265", "mkv"),
    ("libvpx-vp9", "webm"),
    ("libvpx-vp9", "mp4"),
    ("mpeg4", "mp4"),
    ("mpeg4", "avi"),
    ("mjpeg", "mov"),
    ("mjpeg", "avi"),
    ("ffv1", "mkv"),
)
OPTIONS: Mapping[str, dict[str, str]] = {
    "libx264": {"preset": "ultrafast", "bf": "2", "threads": "1"},
    "libx265": {"preset": "ultrafast", "x265-params": "log-level=none:pools=none:frame-threads=1"},
    "libvpx-vp9": {"deadline": "realtime", "cpu-used": "8", "threads": "1"},
}
PIXELS: Mapping[str, str] = {"mjpeg": "yuvj420p"}


def picture(index: int, width: int = WIDTH, height: int = HEIGHT) -> Picture:
    """A smooth picture (height, width, 3) whose top third holds the index as eight dark or bright blocks."""
    x, y = np.meshgrid(np.linspace(0, 2 * np.pi, width), np.linspace(0, 1, height))
    waves = [128 + 60 * np.sin(x + index / 5), 60 + 120 * y, 128 + 60 * np.cos(2 * x - index / 7)]
    image: Picture = np.stack(waves, axis=-1).astype(np.uint8)
    for bit in range(8):
        image[: height // 3, bit * width // 8 : (bit + 1) * width // 8] = 220 if index >> bit & 1 else 30
    return image


def index_in(image: Picture) -> int:
    """The index that `picture` wrote into an image."""
    height, width = image.shape[:2]
    top = image[: height // 3].mean(axis=(0, 2))
    return sum(1 << bit for bit in range(8) if top[bit * width // 8 : (bit + 1) * width // 8].mean() > 125)


def video_in(
    container: OutputContainer, codec: str, size: tuple[int, int] = (WIDTH, HEIGHT), pixels: str | None = None
) -> VideoStream:
    """A new stream of pictures in a container."""
    stream = container.add_stream(codec, rate=RATE, options=dict(OPTIONS.get(codec, {})))
    assert isinstance(stream, VideoStream)
    stream.width, stream.height = size
    stream.pix_fmt = pixels or PIXELS.get(codec, "yuv420p")
    return stream


def encode(
    path: Path,
    codec: str = "libx264",
    count: int = FRAMES,
    size: tuple[int, int] = (WIDTH, HEIGHT),
    pixels: str | None = None,
    stamps: Callable[[int], float] | None = None,
) -> Path:
    """A video of `count` pictures at RATE a second, or at `stamps` (s)."""
    with av.open(str(path), "w") as container:
        stream = video_in(container, codec, size, pixels)
        stream.gop_size, stream.bit_rate = 12, 4_000_000
        stream.codec_context.time_base = Fraction(1, 9000) if stamps else Fraction(1, RATE)
        for index in range(count):
            frame = av.VideoFrame.from_ndarray(picture(index, *size), format="rgb24")
            if stamps:
                frame.pts, frame.time_base = round(stamps(index) * 9000), Fraction(1, 9000)
            else:
                frame.pts, frame.time_base = index, Fraction(1, RATE)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


@cache
def base(codec: str, container: str) -> bytes:
    """A sound video's bytes."""
    with tempfile.TemporaryDirectory() as folder:
        return encode(Path(folder) / f"base.{container}", codec).read_bytes()


def any_base(rng: np.random.Generator, containers: tuple[str, ...] = ()) -> tuple[bytearray, str, str]:
    """One of the bases: bytes, codec, container."""
    choice = [pair for pair in BASES if not containers or pair[1] in containers]
    codec, container = choice[int(rng.integers(len(choice)))]
    return bytearray(base(codec, container)), codec, container


def put(folder: Path, name: str, content: bytes | bytearray) -> Path:
    """Write a file and return its path."""
    path = folder / name
    path.write_bytes(content)
    return path


def _bytewise(change: Callable[[bytearray, np.random.Generator], bytearray]) -> Maker:
    def make(folder: Path, rng: np.random.Generator) -> Path:
        data, codec, container = any_base(rng)
        return put(folder, f"{codec}.{container}", change(data, rng))

    return make


def _truncated(data: bytearray, rng: np.random.Generator) -> bytearray:
    return data[: int(rng.integers(1, len(data)))]


def _bits_flipped(data: bytearray, rng: np.random.Generator) -> bytearray:
    for at in rng.integers(0, len(data), int(rng.integers(1, 60))):
        data[at] ^= 1 << int(rng.integers(8))
    return data


def _payload_flipped(data: bytearray, rng: np.random.Generator) -> bytearray:
    first, last = len(data) // 10, len(data) * 8 // 10
    for at in rng.integers(first, last, int(rng.integers(1, 12))):
        data[at] ^= 1 << int(rng.integers(8))
    return data


def _head_damaged(data: bytearray, rng: np.random.Generator) -> bytearray:
    for at in rng.integers(0, min(600, len(data)), int(rng.integers(1, 12))):
        data[at] = int(rng.integers(256))
    return data


def _tail_damaged(data: bytearray, rng: np.random.Generator) -> bytearray:
    for at in rng.integers(max(0, len(data) - 1500), len(data), int(rng.integers(1, 12))):
        data[at] = int(rng.integers(256))
    return data


def _span(data: bytearray, rng: np.random.Generator) -> tuple[int, int]:
    length = int(rng.integers(16, max(17, len(data) // 4)))
    at = int(rng.integers(0, len(data) - length))
    return at, at + length


def _zeroed(data: bytearray, rng: np.random.Generator) -> bytearray:
    first, last = _span(data, rng)
    data[first:last] = bytes(last - first)
    return data


def _overwritten(data: bytearray, rng: np.random.Generator) -> bytearray:
    first, last = _span(data, rng)
    data[first:last] = rng.bytes(last - first)
    return data


def _removed(data: bytearray, rng: np.random.Generator) -> bytearray:
    first, last = _span(data, rng)
    del data[first:last]
    return data


def _doubled(data: bytearray, rng: np.random.Generator) -> bytearray:
    first, last = _span(data, rng)
    return data[:last] + data[first:]


def _shuffled(data: bytearray, rng: np.random.Generator) -> bytearray:
    size = int(rng.choice([188, 512, 4096 // 2]))
    blocks = [data[at : at + size] for at in range(0, len(data), size)]
    first = 1 if len(blocks) > 2 else 0
    a, b = rng.integers(first, len(blocks), 2)
    blocks[a], blocks[b] = blocks[b], blocks[a]
    return bytearray(b"".join(blocks))


def intact(folder: Path, rng: np.random.Generator) -> Path:
    """A sound file: the control."""
    data, codec, container = any_base(rng)
    return put(folder, f"{codec}.{container}", data)


BYTEWISE: Mapping[str, Maker] = {
    "cut off": _bytewise(_truncated),
    "bits flipped": _bytewise(_bits_flipped),
    "bits of the payload flipped": _bytewise(_payload_flipped),
    "head damaged": _bytewise(_head_damaged),
    "tail damaged": _bytewise(_tail_damaged),
    "block zeroed": _bytewise(_zeroed),
    "block overwritten": _bytewise(_overwritten),
    "block missing": _bytewise(_removed),
    "block twice": _bytewise(_doubled),
    "blocks swapped": _bytewise(_shuffled),
}
