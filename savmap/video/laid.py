"""Pictures of any camera laid into panoramas: what follows asks only for these, and for which part of them is seen.

A panorama is as fine as the picture in its middle. Where that is much finer than a panorama may be, it is averaged down
by a whole factor first.
"""

import math
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.geometry.cameras import Camera, Equirectangular
from savmap.types import Floats, Planes
from savmap.video.clip import Image, Picture

FINER, MOST_HEIGHT, STEP = 1.2, 4096, 64
"""Than the middle of the picture, for its borders may be finer; of panoramas, whose heights are whole steps."""
COARSE = 8
ROOM = 2
UNSEEN_COLOUR = 128
ALL = 0.98
"""Of a panorama: a camera that sees so much of it sees all around."""


class Laid:
    """Lays the pictures of a camera into panoramas (height, 2 height)."""

    def __init__(self, camera: Camera) -> None:
        wanted = FINER * math.pi * camera.resolution
        self.height = STEP * math.ceil(min(wanted, MOST_HEIGHT) / STEP)
        self._camera, self._factor = camera, max(1, int(wanted / (FINER * MOST_HEIGHT)))

    def panorama(self, picture: Picture) -> Picture:
        """The panorama of a picture, black where the camera does not see."""
        if not isinstance(picture, Planes):
            return self._of(picture, self._fine, 0)
        black = round(float(np.interp(0.0, picture.grey, np.arange(256))))
        luma = self._of(picture.luma, self._fine, black)
        blue, red = (self._of(plane, self._half, UNSEEN_COLOUR) for plane in (picture.blue, picture.red))
        return Planes(luma, blue, red, picture.rgb_from_yuv)

    @cached_property
    def seen(self) -> NDArray[np.uint8] | None:
        """The part (height, 2 height) of the panorama that the camera sees: 255, else 0; None where it sees nearly
        all."""
        shown = self._of(np.full((self._camera.height, self._camera.width), 255, np.uint8), self._fine, 0)
        shown[shown < 255] = 0
        return shown if np.mean(shown == 255) < ALL else None

    @cached_property
    def _region(self) -> tuple[slice, slice]:
        """Rows and columns, even ones, that hold all that the camera sees."""
        rows, columns = np.arange(0, self.height, COARSE), np.arange(0, 2 * self.height, COARSE)
        x, y = np.meshgrid(columns, rows)
        pixels = self._camera.pixels(Equirectangular(self.height).rays(np.stack([x, y], -1).astype(np.float64)))
        shown = np.isfinite(pixels[..., 0])
        down, across = np.flatnonzero(shown.any(axis=1)), np.flatnonzero(shown.any(axis=0))
        room = ROOM * COARSE
        top, left = max(0, COARSE * int(down[0]) - room), max(0, COARSE * int(across[0]) - room)
        bottom, right = COARSE * int(down[-1]) + room, COARSE * int(across[-1]) + room
        return slice(top, min(bottom, self.height)), slice(left, min(right, 2 * self.height))

    @cached_property
    def _fine(self) -> tuple[slice, slice, NDArray[np.int16], NDArray[np.uint16]]:
        return self._map(1)

    @cached_property
    def _half(self) -> tuple[slice, slice, NDArray[np.int16], NDArray[np.uint16]]:
        return self._map(2)

    def _map(self, cell: int) -> tuple[slice, slice, NDArray[np.int16], NDArray[np.uint16]]:
        """Rows, columns, and where their pixels lie in a picture that is `cell` times coarser, as the panorama is."""
        rows, columns = (slice(part.start // cell, part.stop // cell) for part in self._region)
        x, y = np.meshgrid(np.arange(columns.start, columns.stop), np.arange(rows.start, rows.stop))
        at = (np.stack([x, y], axis=-1) + 0.5) * cell - 0.5
        pixels = self._camera.pixels(Equirectangular(self.height).rays(at))
        scaled: Floats = (pixels + 0.5) / (cell * self._factor) - 0.5
        scaled[~np.isfinite(scaled)] = -8.0
        cells, fractions = cv2.convertMaps(
            scaled[..., 0].astype(np.float32), scaled[..., 1].astype(np.float32), cv2.CV_16SC2
        )
        return rows, columns, np.asarray(cells, np.int16), np.asarray(fractions, np.uint16)

    def _of(
        self, image: Image, where: tuple[slice, slice, NDArray[np.int16], NDArray[np.uint16]], unseen: int
    ) -> Image:
        rows, columns, cells, fractions = where
        cell = 1 if where is self._fine else 2
        if self._factor > 1:
            size = image.shape[1] // self._factor, image.shape[0] // self._factor
            image = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)
        whole = np.full((self.height // cell, 2 * self.height // cell, *image.shape[2:]), unseen, np.uint8)
        border = (float(unseen),) * 4
        whole[rows, columns] = cv2.remap(
            image, cells, fractions, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=border
        )
        return whole
