"""Pictures as video holds them: luma at full, colour at half the resolution."""

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.types.common import Floats, array_record, read_only, require
from savmap.types.pictures import Panorama

Plane = NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
@array_record
class Planes:
    """A picture in 4:2:0: luma (H, W), blue and red difference (H/2, W/2), all uint8, and the matrix rgb_from_yuv (3,
    4) for (luma, blue, red, 1)."""

    luma: Plane
    blue: Plane
    red: Plane
    rgb_from_yuv: Floats

    def __post_init__(self) -> None:
        half = (self.luma.shape[0] // 2, self.luma.shape[1] // 2)
        even = self.luma.shape == (2 * half[0], 2 * half[1])
        require(even and self.blue.shape == half and self.red.shape == half, self, "the planes differ in size")

    @property
    def rgb(self) -> Plane:
        """The whole picture (H, W, 3), RGB; colour is the same over two by two pixels."""
        size = self.luma.shape[::-1]
        blue, red = (cv2.resize(plane, size, interpolation=cv2.INTER_NEAREST) for plane in (self.blue, self.red))
        return self.coloured(np.asarray(cv2.merge([self.luma, blue, red]), np.uint8))

    def coloured(self, yuv: Plane) -> Plane:
        """RGB (h, w, 3) of a picture (h, w, 3) of luma, blue and red difference."""
        return np.asarray(cv2.transform(yuv, self.rgb_from_yuv), np.uint8)

    @property
    def grey(self) -> Floats:
        """Grey values (256,), 0..255, that the values of luma stand for."""
        white = self.rgb_from_yuv[0] @ np.stack([np.arange(256), *np.full((2, 256), 128), np.ones(256)])
        grey: Floats = np.clip(white, 0, 255)
        return grey


class FilmedPanorama(Panorama):
    """A panorama decoded as planes; its RGB `image` is computed on first use."""

    planes: Planes

    def __init__(self, frame: int, stamp_s: float, planes: Planes, seen: Plane | None = None) -> None:
        height = len(planes.luma)
        require(planes.luma.shape == (height, 2 * height), self, "planes must be (H, 2H)")
        self.__dict__.update(frame=frame, stamp_s=stamp_s, planes=planes, seen=seen)  # the record is frozen

    @property
    def height(self) -> int:
        return len(self.planes.luma)

    @cached_property
    def image(self) -> NDArray[np.uint8]:
        return read_only(self.planes.rgb)


def panorama_of(frame: int, stamp_s: float, picture: Plane | Planes, seen: Plane | None = None) -> Panorama:
    """A panorama made of planes or of RGB; `seen` as in `Panorama`."""
    if isinstance(picture, Planes):
        return FilmedPanorama(frame, stamp_s, picture, seen)
    return Panorama(frame, stamp_s, picture, seen)
