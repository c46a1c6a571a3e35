"""What a file says of the camera: its projection, stereo, how it was held, and whether its pictures are to be turned.

FFmpeg reads it from MP4's boxes `sv3d`, `st3d`, `SA3D` and `uuid` (Spherical Video V1 and V2), from Matroska's
`Projection`, and from the display matrix, and gives it with every decoded frame, as the C structures of libavutil's
`spherical.h` and `stereo3d.h`.
"""

import struct
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
from av.sidedata.sidedata import SideData, Type
from av.video.frame import VideoFrame

from savmap.errors import VideoError

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


def check_frame(path: Path, frame: VideoFrame) -> None:
    """Raise VideoError where a file's first frame comes with the word that it is no upright panorama of one eye."""
    found = next(_objections(frame), None)
    if found is not None:
        raise VideoError(f"{path}: {found}")


def _objections(frame: VideoFrame) -> Iterator[str]:
    entries: Iterable[SideData] = frame.side_data  # type: ignore[assignment]  # PyAV's stub has the names for the entries
    known = {entry.type: bytes(entry) for entry in entries}
    yield from _of_matrix(known.get(Type.DISPLAYMATRIX, b""))
    yield from _of_stereo(known.get(Type.STEREO3D, b""))
    yield from _of_sphere(known.get(Type.SPHERICAL, b""))


def _of_matrix(data: bytes) -> Iterator[str]:
    """Of a display matrix: nine numbers, row by row, of which the first two of the first two rows turn and mirror
    (ISO/IEC 14496-12)."""
    if len(data) < 36:
        return
    a, b, _, c, d = struct.unpack_from("<5i", data)
    turned = round(float(np.degrees(np.arctan2(b, a)))) % 360
    if a * d - b * c < 0:
        yield "its pictures are mirrored, and to be mirrored back by the player: write them as they are to be shown (ffmpeg -i OLD NEW)"
    elif turned:
        yield f"its pictures are to be turned by {turned} degrees by the player: write them as they are to be shown (ffmpeg -i OLD NEW)"


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
        yield f"its camera was tilted by {tilt:.0f} degrees, by its metadata: write it levelled in the camera maker's program"
