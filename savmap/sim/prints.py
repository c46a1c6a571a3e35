"""Pictures that cover faces of boxes, such as a text on a plate: looked up at the degree of blur that a pixel sees."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.sim.primitives import FACES, Box, Face

Singles = NDArray[np.float32]
Indices = NDArray[np.int64]

_ACROSS: dict[Face, int] = {"-x": 2, "+x": 2, "-z": 0, "+z": 0}
LEVELS = 7


@dataclass(frozen=True)
class Print:
    """A picture on a face: `levels`, each half as fine as the one before, linear RGB (h, w, 3); `size` (2,) m, across and up.

    `swapped`: its places are given as up and across, not as across and up."""

    levels: tuple[Singles, ...]
    size: tuple[float, float]
    swapped: bool

    def colors(self, place: Singles, footprint: Singles) -> Singles:
        """Linear RGB (n, 3) at `place` (n, 2) m from the face's lower left corner, blurred to pixels `footprint` (n,) m wide."""
        right, up = (place[:, ::-1] if self.swapped else place).T
        level = np.round(np.log2(np.maximum(footprint * (self.levels[0].shape[1] / self.size[0]), 1.0)))
        level = np.minimum(level.astype(np.int64), len(self.levels) - 1)
        found = np.empty((len(place), 3), np.float32)
        for index in np.unique(level):
            own, picture = level == index, self.levels[index]
            u = (right[own] / self.size[0] * picture.shape[1] - 0.5).astype(np.float32)
            v = ((1 - up[own] / self.size[1]) * picture.shape[0] - 0.5).astype(np.float32)
            for part in range(0, len(u), 30000):
                at = slice(part, part + 30000)
                seen = cv2.remap(picture, u[at, None], v[at, None], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
                found[np.flatnonzero(own)[at]] = seen[:, 0]
        return found


@dataclass(frozen=True)
class Prints:
    """The printed faces of a scene, by face number (6 box + face), and the numbers in order (k,)."""

    by_face: dict[int, Print]
    numbers: Indices

    def paint(self, color: Singles, face: Indices, place: Singles, footprint: Singles) -> None:
        """Put the prints' colours into `color` (n, 3) where faces (n,) carry one."""
        if not len(self.numbers):
            return
        printed = np.flatnonzero(np.isin(face, self.numbers))
        for number in np.unique(face[printed]).tolist():
            own = printed[face[printed] == number]
            color[own] = self.by_face[number].colors(place[own], footprint[own])


def prints_of(boxes: Sequence[Box], swapped: NDArray[np.bool_]) -> Prints:
    """The printed faces; `swapped` (f,): faces whose place is given along their second side, upwards, first."""
    found: dict[int, Print] = {}
    for index, box in enumerate(boxes):
        for face, picture in box.prints.items():
            number = 6 * index + FACES.index(face)
            size = float(box.size[_ACROSS[face]]), float(box.size[1])
            found[number] = Print(_levels(picture), size, bool(swapped[number]))
    return Prints(found, np.array(sorted(found), np.int64))


def _levels(picture: NDArray[np.uint8]) -> tuple[Singles, ...]:
    encoded = picture.astype(np.float32) / 255
    linear = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4).astype(np.float32)
    levels = [linear]
    while len(levels) < LEVELS and min(levels[-1].shape[:2]) > 3:
        half = levels[-1].shape[1] // 2, levels[-1].shape[0] // 2
        levels.append(np.asarray(cv2.resize(levels[-1], half, interpolation=cv2.INTER_AREA), np.float32))
    return tuple(levels)
