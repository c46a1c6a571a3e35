"""Broken media: small panoramic videos and folders of pictures, ways to break them, and a walk through one as `savmap map` reads it.

A maker takes a folder and a random generator, writes one file (or a folder of pictures) there and returns its path.
`KINDS` names them all; the same seed gives the same file.
"""

import contextlib
import math
import os
import struct
import tempfile
import zlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from itertools import chain
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
from av.audio.stream import AudioStream
from av.container import OutputContainer
from av.video.stream import VideoStream
from numpy.typing import NDArray

from savmap.errors import VideoError
from savmap.types import Panorama
from savmap.video.clip import Clip, DecodeReport, VideoInfo
from savmap.video.reader import expected_frames, panoramas, preview_frames, probe

BASES: tuple[tuple[str, str], ...] = (
    ("libx264", "mp4"),
    ("libx264", "mkv"),
    ("libx264", "ts"),
    ("libx265", "mp4"),
    ("libvpx-vp9", "webm"),
    ("mpeg4", "avi"),
    ("mjpeg", "mov"),
    ("ffv1", "mkv"),
)
Maker = Callable[[Path, np.random.Generator], Path]
Picture = NDArray[np.uint8]

FRAMES, RATE, WIDTH, HEIGHT = 36, 30, 128, 64
OPTIONS: Mapping[str, dict[str, str]] = {
    "libx264": {"preset": "ultrafast", "bf": "2", "threads": "1"},
    "libx265": {"preset": "ultrafast", "x265-params": "log-level=none:pools=none:frame-threads=1"},
    "libvpx-vp9": {"deadline": "realtime", "cpu-used": "8", "threads": "1"},
}


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


def video_in(container: OutputContainer, codec: str, size: tuple[int, int] = (WIDTH, HEIGHT)) -> VideoStream:
    """A new stream of pictures in a container."""
    stream = container.add_stream(codec, rate=RATE, options=dict(OPTIONS.get(codec, {})))
    assert isinstance(stream, VideoStream)
    stream.width, stream.height = size
    stream.pix_fmt = "yuvj420p" if codec == "mjpeg" else "yuv420p"
    return stream


def encode(
    path: Path,
    codec: str = "libx264",
    count: int = FRAMES,
    size: tuple[int, int] = (WIDTH, HEIGHT),
    stamps: Callable[[int], float] | None = None,
) -> Path:
    """A video of `count` pictures at RATE a second, or at `stamps` (s)."""
    with av.open(str(path), "w") as container:
        stream = video_in(container, codec, size)
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


AHEAD = 200
Packets = list["av.Packet[Any]"]


def _remuxed(change: Callable[[Packets, np.random.Generator], Packets]) -> Maker:
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


PLAYLISTS = (
    "#EXTM3U\n#EXT-X-TARGETDURATION:10\n#EXTINF:10,\n{}\n#EXT-X-ENDLIST\n",
    "ffconcat version 1.0\nfile {}\nfile {}\n",
    '<?xml version="1.0"?><MPD xmlns="urn:mpeg:dash:schema:mpd:2011" type="static"><Period/></MPD>\n',
    "v=0\no=- 0 0 IN IP4 127.0.0.1\nm=video 5004 RTP/AVP 96\na=rtpmap:96 H264/90000\n",
)


def png(width: int, height: int, rows: int) -> bytes:
    """A grey PNG that says width x height and holds `rows` rows of nothing, deflated twice as small as it says."""

    def chunk(kind: bytes, content: bytes) -> bytes:
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    squeeze = zlib.compressobj(9)
    content = b"".join(squeeze.compress(bytes(width + 1)) for _ in range(rows)) + squeeze.flush()
    head = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", content) + chunk(b"IEND", b"")


def any_base(rng: np.random.Generator, containers: tuple[str, ...] = ()) -> tuple[bytearray, str, str]:
    """A sound file: bytes, codec, container."""
    choice = [pair for pair in BASES if not containers or pair[1] in containers]
    codec, container = choice[int(rng.integers(len(choice)))]
    return bytearray(base(codec, container)), codec, container


def _cut_off(data: bytearray, rng: np.random.Generator) -> bytearray:
    return data[: int(rng.integers(1, len(data)))]


def _bits_flipped(data: bytearray, rng: np.random.Generator) -> bytearray:
    for at in rng.integers(0, len(data), int(rng.integers(1, 60))):
        data[at] ^= 1 << int(rng.integers(8))
    return data


def _block(data: bytearray, rng: np.random.Generator, kept: bool) -> bytearray:
    """A block of zeros instead of the file's, or nothing."""
    length = int(rng.integers(16, max(17, len(data) // 4)))
    at = int(rng.integers(0, len(data) - length))
    data[at : at + length] = bytes(length if kept else 0)
    return data


def _head_damaged(data: bytearray, rng: np.random.Generator) -> bytearray:
    for at in rng.integers(0, min(600, len(data)), int(rng.integers(1, 12))):
        data[at] = int(rng.integers(256))
    return data


def _blocks_swapped(data: bytearray, rng: np.random.Generator) -> bytearray:
    blocks = [data[at : at + 512] for at in range(0, len(data), 512)]
    a, b = rng.integers(1, len(blocks), 2)
    blocks[a], blocks[b] = blocks[b], blocks[a]
    return bytearray(b"".join(blocks))


def _transport_packets(folder: Path, rng: np.random.Generator) -> Path:
    """Headers of transport stream packets are changed, and a packet is lost."""
    data = base("libx264", "ts")
    packets = [bytearray(data[at : at + 188]) for at in range(0, len(data), 188)]
    for index in rng.integers(0, len(packets), int(rng.integers(1, 15))):
        packets[index][int(rng.integers(0, 24))] = int(rng.integers(256))
    del packets[int(rng.integers(len(packets)))]
    return put(folder, "poked.ts", b"".join(packets))


def _without_index(folder: Path, rng: np.random.Generator) -> Path:
    """As of a camera whose battery fell out."""
    return put(folder, "a.mp4", base("libx264", "mp4").replace(b"moov", b"free"))


def _mkv_times(folder: Path, rng: np.random.Generator) -> Path:
    """Duration NaN, infinite, negative or huge."""
    data = bytearray(base("libx264", "mkv"))
    at = data.index(b"\x44\x89\x88") + 3
    data[at : at + 8] = struct.pack(">d", float(rng.choice([np.nan, np.inf, -5.0, 1e300, 0.0])))
    return put(folder, "times.mkv", data)


def _sound(folder: Path, rng: np.random.Generator) -> Path:
    path = folder / "sound.mov"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("pcm_s16le", rate=44100)
        assert isinstance(stream, AudioStream)
        frame = av.AudioFrame.from_ndarray(np.zeros((1, 44100), np.int16), format="s16", layout="mono")
        frame.sample_rate = 44100
        container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


def _playlist(folder: Path, rng: np.random.Generator) -> Path:
    """Lists that make FFmpeg open other files, in a video's name."""
    other = put(folder, "other.mp4", base("libx264", "mp4"))
    text = PLAYLISTS[int(rng.integers(len(PLAYLISTS)))]
    return put(folder, "list.mp4", text.replace("{}", other.name).encode())


def _pipe(folder: Path, rng: np.random.Generator) -> Path:
    os.mkfifo(folder / "pipe.mp4")
    return folder / "pipe.mp4"


def _pictures(folder: Path, rng: np.random.Generator) -> Path:
    """A folder in which some pictures are cut off, damaged, of another size or depth, or none."""
    inner = folder / "pictures"
    inner.mkdir()
    for index in range(20):
        data = bytearray(cv2.imencode(".png", picture(index)[..., ::-1])[1].tobytes())
        match int(rng.integers(8)):
            case 0:
                data = data[: int(rng.integers(0, len(data)))]
            case 1:
                for at in rng.integers(0, len(data), 20):
                    data[at] ^= 1 << int(rng.integers(8))
            case 2:
                data = bytearray(rng.bytes(500))
            case 3:
                data = bytearray(cv2.imencode(".png", picture(index, 64, 32))[1].tobytes())
            case 4:
                data = bytearray(cv2.imencode(".png", picture(index).astype(np.uint16) * 200)[1].tobytes())
        put(inner, f"{index:03}.png", data)
    return inner


KINDS: Mapping[str, Maker] = {
    "cut off": _bytewise(_cut_off),
    "bits flipped": _bytewise(_bits_flipped),
    "block zeroed": _bytewise(lambda data, rng: _block(data, rng, True)),
    "block missing": _bytewise(lambda data, rng: _block(data, rng, False)),
    "head damaged": _bytewise(_head_damaged),
    "blocks swapped": _bytewise(_blocks_swapped),
    "ts packets": _transport_packets,
    "mp4 without index": _without_index,
    "mkv times": _mkv_times,
    "packets lost": _remuxed(_lost),
    "packets mixed up": _remuxed(_mixed_up),
    "one time leaps": _times(lambda index, at, rng: index + (2**31 if index == at else 0)),
    "times go back": _times(lambda index, at, rng: index - (at if index > at else 0)),
    "times stand still": _times(lambda index, at, rng: min(index, at)),
    "times random": _times(lambda index, at, rng: float(rng.integers(-100, 100))),
    "two frames": lambda folder, rng: encode(folder / "few.avi", "mjpeg", count=2),
    "odd rates": _odd_rate,
    "size changes": _size_changes,
    "sound only": _sound,
    "picture renamed": lambda folder, rng: put(folder, "a.mp4", cv2.imencode(".jpg", picture(1))[1].tobytes()),
    "text renamed": lambda folder, rng: put(folder, "a.mkv", b"some words " * 99),
    "playlist renamed": _playlist,
    "nothing": lambda folder, rng: put(folder, "empty.mp4", b""),
    "named pipe": _pipe,
    "not 2:1": lambda folder, rng: encode(folder / "shape.mkv", "ffv1", count=3, size=(128, 128)),
    "folder of broken pictures": _pictures,
}


@dataclass(frozen=True)
class Reading:
    """How a file ended: `refused` (a clear error), `reported` (frames, and a report of those skipped or missing) or `whole`. `smeared`:
    frames used that differ from the picture that was encoded."""

    outcome: str
    frames: int = 0
    smeared: int = 0


def walk(path: Path) -> Reading:
    """Probe, previews, all frames to the end, and a part of the clip. Raises whatever savmap lets through, and AssertionError."""
    try:
        info, report, clip = probe(path), DecodeReport(), Clip(path, fps=60.0)
        assert expected_frames(clip, info) >= 1
        keys, pairs = preview_frames(Clip(path))
        for preview in (*keys, *chain.from_iterable(pairs)):
            assert preview.image.shape[1] == 2 * preview.image.shape[0]
            assert 0 <= preview.stamp_s < math.inf
        count, smeared = count_frames(panoramas(clip, 7, report), info, 7, 0.0, math.inf)
        start, end = 0.3 * info.duration_s, 0.8 * info.duration_s
        with contextlib.suppress(VideoError):
            count_frames(panoramas(Clip(path, start, end, 60.0)), info, 0, start, end)
    except VideoError as error:
        line = str(error)
        assert "\n" not in line
        assert str(path) in line
        return Reading("refused")
    assert report.used == count
    return Reading("whole" if report.complete else "reported", count, smeared)


def count_frames(frames: Iterable[Panorama], info: VideoInfo, first: int, start: float, end: float) -> tuple[int, int]:
    """How many panoramas there are, and how many of them are smeared."""
    last, count, smeared = -math.inf, 0, 0
    for count, panorama in enumerate(frames, start=1):
        assert panorama.frame == first + count - 1
        assert last < panorama.stamp_s < math.inf
        assert start - 1e-5 <= panorama.stamp_s < end
        assert panorama.image.shape == (info.height, info.width, 3)
        assert panorama.image.dtype == np.uint8
        last = panorama.stamp_s
        smeared += is_smeared(panorama)
    return count, smeared


def is_smeared(panorama: Panorama) -> bool:
    """Whether an image is none of those that `picture` gives (mean difference above 6 grey levels)."""
    height, width = panorama.image.shape[:2]
    wanted = picture(index_in(panorama.image), width, height)
    return bool(np.abs(panorama.image.astype(int) - wanted).mean() > 6)
