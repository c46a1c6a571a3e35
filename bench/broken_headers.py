"""Containers whose fields lie: MP4 boxes and Matroska elements with absurd sizes, times, tables and codecs."""

import struct
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
from broken import Maker, any_base, base, put

NESTS = {b"moov", b"trak", b"mdia", b"minf", b"stbl", b"edts", b"dinf"}
ABSURD = (0, 1, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 0x00FFFFFF, 1000)
FOURCCS = (b"avc1", b"hev1", b"hvc1", b"mp4v", b"vp09", b"av01", b"jpeg", b"mjp2", b"ap4h", b"raw ", b"text", b"xxxx")


def boxes(data: bytes | bytearray, first: int = 0, last: int | None = None) -> Iterator[tuple[bytes, int, int]]:
    """All boxes of an MP4: type, begin and end of the content."""
    last = len(data) if last is None else last
    while first + 8 <= last:
        size, kind = struct.unpack_from(">I4s", data, first)
        if size < 8:
            return
        yield bytes(kind), first + 8, first + size
        if kind in NESTS:
            yield from boxes(data, first + 8, first + size)
        first += size


def find(data: bytes | bytearray, kind: bytes) -> tuple[int, int]:
    """Begin and end of the first box of a kind."""
    return next((first, last) for name, first, last in boxes(data) if name == kind)


def _mp4(rng: np.random.Generator, holding: bytes = b"moov") -> tuple[bytearray, str, str]:
    while True:
        data, codec, container = any_base(rng, ("mp4", "mov"))
        if any(kind == holding for kind, *_ in boxes(data)):
            return data, codec, container


def _poked(kind: bytes) -> Maker:
    """Random 32-bit fields of a box become absurd."""

    def make(folder: Path, rng: np.random.Generator) -> Path:
        data, codec, container = _mp4(rng, kind)
        first, last = find(data, kind)
        for _ in range(int(rng.integers(1, 4))):
            at = first + 4 * int(rng.integers(0, max(1, (last - first) // 4)))
            value = int(rng.choice(ABSURD)) if rng.random() < 0.7 else int(rng.integers(2**32))
            data[at : at + 4] = struct.pack(">I", value)
        return put(folder, f"{codec}-{kind.decode()}.{container}", data)

    return make


def _edit_list(folder: Path, rng: np.random.Generator) -> Path:
    data, codec, container = _mp4(rng, b"elst")
    first, last = find(data, b"elst")
    for at in range(first + 8, last - 11, 12):
        length, begin = int(rng.integers(0, 5000)), int(rng.integers(-1, 20000))
        rate = int(rng.choice([0x10000, 0, 0x20000, 0xFFFF0000]))
        data[at : at + 12] = struct.pack(">IiI", length, begin, rate)
    return put(folder, f"{codec}.{container}", data)


def _box_sizes(folder: Path, rng: np.random.Generator) -> Path:
    data, codec, container = _mp4(rng)
    places = [first - 8 for _, first, _ in boxes(data)]
    at = int(rng.choice(places))
    data[at : at + 4] = struct.pack(">I", int(rng.choice(ABSURD)))
    if rng.random() < 0.3:
        data[at : at + 4], data[at + 8 : at + 16] = struct.pack(">I", 1), struct.pack(">Q", 2**62)
    return put(folder, f"{codec}.{container}", data)


def _no_index(folder: Path, rng: np.random.Generator) -> Path:
    data, codec, container = _mp4(rng)
    first, last = find(data, b"moov")
    if rng.random() < 0.5:
        data[first - 4 : first] = b"free"
    else:
        del data[int(rng.integers(first, last)) : last]
    return put(folder, f"{codec}.{container}", data)


def _size_in_header(folder: Path, rng: np.random.Generator) -> Path:
    """Width and height of the sample entry, 2:1 and absurd."""
    data, codec, container = _mp4(rng)
    first, _ = find(data, b"stsd")
    height = int(rng.choice([0, 1, 31, 65, 4096, 8192, 16384, 32767]))
    width = min(2 * height, 65535)
    data[first + 40 : first + 44] = struct.pack(">HH", width, height)
    return put(folder, f"{codec}-{width}x{height}.{container}", data)


def _other_codec(folder: Path, rng: np.random.Generator) -> Path:
    data, codec, container = _mp4(rng)
    first, _ = find(data, b"stsd")
    data[first + 12 : first + 16] = bytes(FOURCCS[int(rng.integers(len(FOURCCS)))])
    return put(folder, f"{codec}.{container}", data)


def _other_codec_mkv(folder: Path, rng: np.random.Generator) -> Path:
    name = b"V_MPEG4/ISO/AVC", b"V_MPEGH/ISO/HEVC"
    data, codec = (base("libx264", "mkv"), "x264") if rng.random() < 0.5 else (base("libx265", "mkv"), "x265")
    mine, other = name if codec == "x264" else name[::-1]
    choice = [other, b"V_VP9", b"V_AV1", b"V_MJPEG", b"V_FFV1", b"V_UNCOMPRESSED", b"V_MPEG4/ISO/ASP", b"S_TEXT/UTF8"]
    wanted = choice[int(rng.integers(len(choice)))]
    at = data.index(mine)
    content = data[: at - 1] + bytes([0x80 | len(wanted)]) + wanted + data[at + len(mine) :]
    return put(folder, f"{codec}.mkv", content)


def _mkv_times(folder: Path, rng: np.random.Generator) -> Path:
    """Duration NaN, infinite, negative or huge; time scale nought or huge."""
    data = bytearray(base(*(("libx264", "mkv"), ("ffv1", "mkv"), ("libvpx-vp9", "webm"))[int(rng.integers(3))]))
    if rng.random() < 0.7:
        at = data.index(b"\x44\x89\x88") + 3
        value = float(rng.choice([np.nan, np.inf, -np.inf, -5.0, 1e300, 1e18, 1e9, 0.0, 1e-300]))
        data[at : at + 8] = struct.pack(">d", value)
    if rng.random() < 0.5:
        at = data.index(b"\x2a\xd7\xb1\x83") + 4
        data[at : at + 3] = [b"\0\0\0", b"\xff\xff\xff", b"\0\0\1"][int(rng.integers(3))]
    return put(folder, "times.mkv", data)


def _mkv_poked(folder: Path, rng: np.random.Generator) -> Path:
    """Bytes of the header elements (ids, lengths, values) of a Matroska file."""
    data = bytearray(base(*(("libx264", "mkv"), ("libx265", "mkv"), ("libvpx-vp9", "webm"))[int(rng.integers(3))]))
    cluster = data.index(b"\x1f\x43\xb6\x75")
    for at in rng.integers(0, cluster + 20, int(rng.integers(1, 6))):
        data[at] = int(rng.choice([0, 1, 8, 0x7F, 0x80, 0xFF, int(rng.integers(256))]))
    return put(folder, "poked.mkv", data)


def _transport_poked(folder: Path, rng: np.random.Generator) -> Path:
    """Headers of transport stream packets: continuity, identifiers, clocks; packets lost or moved."""
    data = base("libx264", "ts")
    packets = [bytearray(data[at : at + 188]) for at in range(0, len(data), 188)]
    for index in rng.integers(0, len(packets), int(rng.integers(1, 15))):
        packets[index][int(rng.integers(0, 24))] = int(rng.integers(256))
    if rng.random() < 0.5:
        del packets[int(rng.integers(len(packets)))]
    if rng.random() < 0.3:
        rng.shuffle(packets)
    return put(folder, "poked.ts", b"".join(packets))


HEADERS: Mapping[str, Maker] = {
    **{
        f"mp4 {kind.decode()} absurd": _poked(kind)
        for kind in (b"mvhd", b"tkhd", b"mdhd", b"stts", b"ctts", b"stsc", b"stsz", b"stco", b"stss", b"stsd", b"elst")
    },
    "mp4 edit list": _edit_list,
    "mp4 box sizes": _box_sizes,
    "mp4 without index": _no_index,
    "mp4 picture size in header": _size_in_header,
    "mp4 other codec": _other_codec,
    "mkv other codec": _other_codec_mkv,
    "mkv times": _mkv_times,
    "mkv header": _mkv_poked,
    "ts packets": _transport_poked,
}
