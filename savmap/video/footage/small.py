"""Small grey copies of panoramas."""

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.types import Panorama
from savmap.types.planes import FilmedPanorama

FINE = 8
"""A picture so many times wider than its copy is thinned out before it is averaged: that is as good, and does not read
all of it."""


def small_grey(panorama: Panorama, width: int) -> NDArray[np.uint8]:
    """A panorama in grey (width / 2, width)."""
    whole = panorama.planes.luma if isinstance(panorama, FilmedPanorama) else panorama.image
    step = max(1, whole.shape[1] // (FINE * width))
    thin = cv2.resize(whole[::step, ::step], (width, width // 2), interpolation=cv2.INTER_AREA)
    return np.asarray(thin if thin.ndim == 2 else cv2.cvtColor(thin, cv2.COLOR_RGB2GRAY), np.uint8)
