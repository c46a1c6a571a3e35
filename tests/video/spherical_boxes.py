"""MP4 files with boxes that say what camera they come from (Google's Spherical Video V1 and V2; ISO/IEC 14496-12)."""

import struct
from pathlib import Path

V1_UUID = bytes.fromhex("ffcc8263f8554a938814587a02521fdd")
TO_TRACK = (b"moov", b"trak")
TO_SAMPLE = (*TO_TRACK, b"mdia", b"minf", b"stbl", b"stsd", b"avc1")
SKIPPED = {b"stsd": 8, b"avc1": 78}


def box(kind: bytes, content: bytes) -> bytes:
    return struct.pack(">I4s", 8 + len(content), kind) + content


def stereo(mode: int) -> bytes:
    """0: one eye, 1: one above the other, 2: side by side."""
    return box(b"st3d", bytes(4) + bytes([mode]))


def sphere(projection: bytes, yaw: float = 0.0, pitch: float = 0.0, roll: float = 0.0) -> bytes:
    """`projection`: the box that names it."""
    pose = box(b"prhd", bytes(4) + struct.pack(">3i", *(round(angle * 65536) for angle in (yaw, pitch, roll))))
    return box(b"sv3d", box(b"svhd", bytes(4) + b"made up\0") + box(b"proj", pose + projection))


EQUIRECTANGULAR = box(b"equi", bytes(20))
CUBE_MAP = box(b"cbmp", bytes(12))
HALF = box(b"equi", bytes(4) + struct.pack(">4I", 0, 0, 1 << 30, 1 << 30))


def v1(**entries: str) -> bytes:
    """Spherical Video V1: XML in a box of its own, in the track."""
    lines = "".join(f"<GSpherical:{key}>{value}</GSpherical:{key}>" for key, value in entries.items())
    return box(b"uuid", V1_UUID + f'<rdf:SphericalVideo xmlns:GSpherical="x">{lines}</rdf:SphericalVideo>'.encode())


def insert(path: Path, added: bytes, way: tuple[bytes, ...] = TO_SAMPLE) -> Path:
    """Append a box to the one that `way` leads to. The media data lie before `moov`: no offset changes."""
    data = bytearray(path.read_bytes())
    first, last, sizes = 0, len(data), list[int]()
    for kind in way:
        at = first
        while data[at + 4 : at + 8] != kind:
            at += int.from_bytes(data[at : at + 4], "big")
            assert at < last, kind
        sizes.append(at)
        last = at + int.from_bytes(data[at : at + 4], "big")
        first = at + 8 + SKIPPED.get(kind, 0)
    data[last:last] = added
    for at in sizes:
        size = int.from_bytes(data[at : at + 4], "big")
        data[at : at + 4] = (size + len(added)).to_bytes(4, "big")
    path.write_bytes(data)
    return path
