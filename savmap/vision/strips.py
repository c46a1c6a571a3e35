"""Strips of panoramas: what a panorama shows in some views, at its own resolution, kept so that edges can be measured
once it is known where they are.

They are kept without loss: JPEG of quality 95 moves one edge of ten by more than 0.17 px, and takes as long and two
thirds of the bytes.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from struct import Struct
from typing import Any, Literal

import av
import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.types import FilmedPanorama, Floats, Panorama, Planes, ViewSpec, array_record
from savmap.vision.views import Region, panorama_pixels, region_around

HEAD = Struct("<III")
Bytes = NDArray[np.uint8]
GRID = 64
"""Columns of a view that tell the part of the panorama that it shows, and rows of cells of a panorama: two of these
are kept around it."""
GREY = np.array([[1.0, 0, 0, 0]] * 3)


@dataclass(frozen=True, eq=False)
@array_record
class PanoramaStrip:
    """Part of the luma of a panorama of this height: rows from `top` on, columns from `left` on, which may cross the
    seam (`luma`, packed); and what its values stand for (`rgb_from_yuv`, as in `Planes`)."""

    frame: int
    stamp_s: float
    height: int
    top: int
    left: int
    luma: bytes
    rgb_from_yuv: Floats

    @classmethod
    def of(cls, panorama: Panorama, region: Region) -> "PanoramaStrip":
        """A region of a panorama."""
        rows = slice(region.top, region.bottom)
        columns = np.arange(region.left, region.left + region.width) % (2 * panorama.height)
        if isinstance(panorama, FilmedPanorama):
            luma, rgb_from_yuv = panorama.planes.luma[rows].take(columns, axis=1), panorama.planes.rgb_from_yuv
        else:
            part = np.ascontiguousarray(panorama.image[rows].take(columns, axis=1))
            luma, rgb_from_yuv = np.asarray(cv2.cvtColor(part, cv2.COLOR_RGB2GRAY), np.uint8), GREY
        top, left = region.top, region.left
        return cls(panorama.frame, panorama.stamp_s, panorama.height, top, left, packed_grey(luma), rgb_from_yuv)

    def panorama(self) -> FilmedPanorama:
        """The panorama, grey, and black where nothing is kept of it."""
        luma: Bytes = np.zeros((self.height, 2 * self.height), np.uint8)
        part = unpacked_grey(self.luma)
        first = min(part.shape[1], 2 * self.height - self.left)
        rows = slice(self.top, self.top + len(part))
        luma[rows, self.left : self.left + first] = part[:, :first]
        luma[rows, : part.shape[1] - first] = part[:, first:]
        colour = np.full((self.height // 2, self.height), 128, np.uint8)
        return FilmedPanorama(self.frame, self.stamp_s, Planes(luma, colour, colour, self.rgb_from_yuv))


def packed_grey(image: Bytes) -> bytes:
    """A grey picture (h, w) as bytes, without loss: FFmpeg's variant of HuffYUV, which is five times as fast as PNG."""
    encoder = _coder("w", *image.shape[::-1])
    packets = [*encoder.encode(av.VideoFrame.from_ndarray(np.ascontiguousarray(image), "gray")), *encoder.encode(None)]
    extra = encoder.extradata or b""
    return HEAD.pack(*image.shape[::-1], len(extra)) + extra + b"".join(map(bytes, packets))


def unpacked_grey(content: bytes) -> Bytes:
    """The picture (h, w) that such bytes hold."""
    width, height, extra = HEAD.unpack_from(content)
    decoder = _coder("r", width, height)
    decoder.extradata = content[HEAD.size : HEAD.size + extra]
    frames = [*decoder.decode(av.Packet(content[HEAD.size + extra :])), *decoder.decode(None)]
    return np.asarray(frames[0].to_ndarray(), np.uint8)


def _coder(mode: Literal["r", "w"], width: int, height: int) -> Any:
    coder: Any = av.CodecContext.create("ffvhuff", mode)
    coder.width, coder.height, coder.pix_fmt, coder.thread_count = width, height, "gray", 1
    if mode == "w":
        coder.time_base, coder.options = Fraction(1, 30), {"pred": "median"}
    return coder


def region_of(specs: Sequence[ViewSpec], height: int) -> Region:
    """The part of panoramas of this height that views show together, with a little around it."""
    coarse = [replace(spec, width=GRID, height=max(2, GRID * spec.height // spec.width)) for spec in specs]
    pixels = np.concatenate([panorama_pixels(spec, height).reshape(-1, 2) for spec in coarse])
    region = region_around(pixels, height, max(1, height // GRID))
    return replace(region, width=min(region.width, 2 * height))
