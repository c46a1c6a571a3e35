"""Strips of panoramas: what a panorama shows in some views, at its own resolution, kept so that edges can be measured
in it once it is known where they are."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.types import FilmedPanorama, Floats, Panorama, Planes, ViewSpec, array_record
from savmap.vision.views import Region, panorama_pixels, region_around

QUALITY = 95
"""Of JPEG: edges of beams and uprights then move by less than 0.02 px (docs/method.md)."""
GRID = 64
"""Columns of a view that tell the part of the panorama that it shows, and rows of cells of a panorama: two of these
are kept around it."""
GREY = np.array([[1.0, 0, 0, 0]] * 3)


@dataclass(frozen=True, eq=False)
@array_record
class PanoramaStrip:
    """Part of the luma of a panorama of this height: rows from `top` on, columns from `left` on, which may cross the
    seam (`luma`, JPEG); and what its values stand for (`rgb_from_yuv`, as in `Planes`)."""

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
        content = bytes(cv2.imencode(".jpg", luma, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1])
        return cls(panorama.frame, panorama.stamp_s, panorama.height, region.top, region.left, content, rgb_from_yuv)

    def panorama(self) -> FilmedPanorama:
        """The panorama, grey, and black where nothing is kept of it."""
        luma: NDArray[np.uint8] = np.zeros((self.height, 2 * self.height), np.uint8)
        part = np.asarray(cv2.imdecode(np.frombuffer(self.luma, np.uint8), cv2.IMREAD_GRAYSCALE), np.uint8)
        first = min(part.shape[1], 2 * self.height - self.left)
        rows = slice(self.top, self.top + len(part))
        luma[rows, self.left : self.left + first] = part[:, :first]
        luma[rows, : part.shape[1] - first] = part[:, first:]
        colour = np.full((self.height // 2, self.height), 128, np.uint8)
        return FilmedPanorama(self.frame, self.stamp_s, Planes(luma, colour, colour, self.rgb_from_yuv))


def region_of(specs: Sequence[ViewSpec], height: int) -> Region:
    """The part of panoramas of this height that views show together, with a little around it."""
    coarse = [replace(spec, width=GRID, height=max(2, GRID * spec.height // spec.width)) for spec in specs]
    pixels = np.concatenate([panorama_pixels(spec, height).reshape(-1, 2) for spec in coarse])
    region = region_around(pixels, height, max(1, height // GRID))
    return replace(region, width=min(region.width, 2 * height))
