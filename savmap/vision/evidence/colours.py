"""How like what a network sees of a class a view's pixels are, by their colours: pieces of an object that it sees nothing of, in the very light of the
others."""

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
    """How likely each pixel (height, width) of a picture (height, width, 3) RGB is a class's rather than anything's, by the colours of those that a
    network is sure of and of all others (`probability`), over three pixels each way; 0 everywhere where it is sure of none."""
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
