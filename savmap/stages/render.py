"""Rectilinear views sampled straight from panoramas (paper, section III-B)."""

from collections import OrderedDict

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.stages.sampling import Level, shrunk, table
from savmap.types import Panorama, View, ViewSpec

Key = tuple[int, float, float, float, float, int, int]
KEPT_TABLES = 32


class Renderer:
    """Cuts views out of panoramas and keeps the tables of the last views it was asked for.

    Bilinear, at pixel centres, over the seam and the poles. With `antialias`, the panorama is first averaged down where
    it is two or more times finer than the view.
    """

    def __init__(self, antialias: bool = True) -> None:
        self._antialias = antialias
        self._tables: OrderedDict[Key, tuple[Level, ...]] = OrderedDict()

    def render(self, panorama: Panorama, spec: ViewSpec) -> View:
        """The view of `panorama` that `spec` describes."""
        image = np.empty((spec.height, spec.width, 3), np.uint8)
        for level in self._table(spec, panorama.image.shape[0]):
            _sample(panorama.image, level, image)
        return View(spec, panorama.frame, panorama.stamp_s, image)

    def _table(self, spec: ViewSpec, height: int) -> tuple[Level, ...]:
        key = (height, spec.yaw_deg, spec.pitch_deg, spec.roll_deg, spec.hfov_deg, spec.width, spec.height)
        if key not in self._tables:
            self._tables[key] = table(spec, height, self._antialias)
            if len(self._tables) > KEPT_TABLES:
                self._tables.popitem(last=False)
        self._tables.move_to_end(key)
        return self._tables[key]


def _sample(panorama: NDArray[np.uint8], level: Level, view: NDArray[np.uint8]) -> None:
    """Write a level's pixels into the view; those of finer levels stay."""
    if level.region is None:
        source, border = panorama, cv2.BORDER_WRAP
    else:
        source, border = shrunk(panorama, level.region, level.halvings), cv2.BORDER_TRANSPARENT
    cv2.remap(source, level.cells, level.fractions, cv2.INTER_LINEAR, dst=view, borderMode=border)
