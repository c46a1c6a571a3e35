"""The probability of a class by colour. It finds pieces of an object that the network misses: other objects of the class in the same view
have the same paint in the same light."""

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

Singles = NDArray[np.float32]

BIN, BINS = 8, 32
SURELY, HARDLY = 0.5, 0.2
"""A pixel is of the class above the first probability, and is not below the second."""
LEAST_DENSITY, ACROSS_PX = 1e-7, 3


def colour_probability(image: NDArray[np.uint8], probability: Singles) -> Singles:
    """The probability (height, width) that each pixel of a picture (height, width, 3) RGB is of a class, by its colour.

    Colours are counted in the pixels that a network is sure of and in those that it excludes (`probability`, (height, width)). The result
    is a mean over `ACROSS_PX` pixels each way, and 0 where the network is sure of no pixel.
    """
    colours = cv2.cvtColor(np.ascontiguousarray(image), cv2.COLOR_RGB2LAB) // BIN
    cells = tuple(np.moveaxis(colours.astype(np.intp), -1, 0))
    in_class, others = (_density(cells, pixels) for pixels in (probability > SURELY, probability < HARDLY))
    table = (in_class / (in_class + others + LEAST_DENSITY)).astype(np.float32)
    return np.asarray(cv2.blur(table[cells], (ACROSS_PX, ACROSS_PX)), np.float32)


def _density(cells: tuple[NDArray[np.intp], ...], chosen: NDArray[np.bool_]) -> NDArray[np.float64]:
    """How often each colour is among chosen pixels."""
    counts = np.zeros((BINS,) * 3)
    np.add.at(counts, tuple(axis[chosen] for axis in cells), 1.0)
    return np.asarray(gaussian_filter(counts, 1.0) / max(float(chosen.sum()), 1.0), np.float64)
