"""Rectilinear views sampled straight from panoramas (paper, section III-B)."""

from collections import OrderedDict
from collections.abc import Sequence
from threading import Lock

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.stages.sampling import Coarser, Level, table
from savmap.types import FilmedPanorama, Panorama, Planes, View, ViewSpec

Key = tuple[int, float, float, float, float, int, int]
KEPT_TABLES = 32
PIXEL = np.dtype((np.void, 3))


class Renderer:
    """Cuts views out of panoramas and keeps the tables of the last views it was asked for.

    Bilinear, at pixel centres, over the seam and the poles. With `antialias`, the panorama is first averaged down where
    it is two or more times finer than the view. What came as planes of luma and colour is sampled as such, and only the view
    is turned into RGB. Threads may share one.
    """

    def __init__(self, antialias: bool = True) -> None:
        self._antialias = antialias
        self._tables: OrderedDict[Key, tuple[Level, ...]] = OrderedDict()
        self._lock = Lock()

    def render(self, panorama: Panorama, spec: ViewSpec) -> View:
        """The view of `panorama` that `spec` describes."""
        image = np.empty((spec.height, spec.width, 3), np.uint8)
        levels = self._table(spec, panorama.height)
        if isinstance(panorama, FilmedPanorama):
            _sample_planes(panorama.planes, levels, image)
            image = panorama.planes.coloured(image)
        else:
            _sample(panorama.image, levels, image)
        return View(spec, panorama.frame, panorama.stamp_s, image)

    def _table(self, spec: ViewSpec, height: int) -> tuple[Level, ...]:
        key = (height, spec.yaw_deg, spec.pitch_deg, spec.roll_deg, spec.hfov_deg, spec.width, spec.height)
        with self._lock:
            if key not in self._tables:
                self._tables[key] = table(spec, height, self._antialias)
                if len(self._tables) > KEPT_TABLES:
                    self._tables.popitem(last=False)
            self._tables.move_to_end(key)
            return self._tables[key]


def _sample(panorama: NDArray[np.uint8], levels: Sequence[Level], view: NDArray[np.uint8]) -> None:
    """Write the pixels of levels, finest first, into the view."""
    coarser = Coarser(panorama)
    for level in levels:
        source = panorama if level.region is None else coarser.part(level.region, level.halvings)
        _put(_found(source, level.cells, level.fractions), level, view)


def _found(source: NDArray[np.uint8], cells: NDArray[np.int16], fractions: NDArray[np.uint16]) -> NDArray[np.uint8]:
    return np.asarray(cv2.remap(source, cells, fractions, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP), np.uint8)


def _put(found: NDArray[np.uint8], level: Level, view: NDArray[np.uint8]) -> None:
    """Write what was found for a level's own pixels into the view."""
    view.view(PIXEL)[..., 0][level.own] = found.view(PIXEL).ravel()[: np.count_nonzero(level.own)]


def _sample_planes(planes: Planes, levels: Sequence[Level], view: NDArray[np.uint8]) -> None:
    """Write the luma, blue and red difference of levels, finest first. One halving makes luma as coarse as colour is."""
    luma, blue, red = Coarser(planes.luma), Coarser(planes.blue), Coarser(planes.red)
    for level in levels:
        if level.region is None:
            found = [_found(planes.luma, level.cells, level.fractions)]
            found += [_found(plane, *level.half_as_fine) for plane in (planes.blue, planes.red)]
        else:
            half, fewer = level.region.halved, level.halvings - 1
            sources = luma.part(level.region, level.halvings), blue.part(half, fewer), red.part(half, fewer)
            found = [_found(source, level.cells, level.fractions) for source in sources]
        _put(np.asarray(cv2.merge(found), np.uint8), level, view)
