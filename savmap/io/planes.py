"""Decoded frames as pictures: their planes where these are of the usual kind, without a copy; else RGB."""

import numpy as np
from av.video.frame import VideoFrame
from av.video.reformatter import VideoReformatter
from numpy.typing import NDArray

from savmap.io.clip import Picture
from savmap.types import Floats, Planes

PLANAR = {"yuv420p", "yuvj420p", "nv12"}
UNTOLD, JPEG_RANGE = 2, 2
WEIGHTS = {1: (0.2126, 0.0722), 5: (0.299, 0.114), 6: (0.299, 0.114), 9: (0.2627, 0.0593), UNTOLD: (0.299, 0.114)}
"""How much red and blue weigh in luma, by the number of the colour space (ITU-T H.273, "MatrixCoefficients")."""


def picture_of(frame: VideoFrame, reformatter: VideoReformatter) -> Picture:
    """A frame's planes, which lie in the frame's own memory where they can; RGB (H, W, 3) of frames that come in another form."""
    name, weights = frame.format.name, WEIGHTS.get(int(frame.colorspace))
    if name not in PLANAR or weights is None or frame.width % 2 or frame.height % 2:
        return np.asarray(reformatter.reformat(frame, format="rgb24").to_ndarray(), np.uint8)
    full = name == "yuvj420p" or int(frame.color_range) == JPEG_RANGE
    luma, *colour = (np.frombuffer(memoryview(plane), np.uint8).reshape(-1, plane.line_size) for plane in frame.planes)
    half = frame.height // 2, frame.width // 2
    blue, red = (
        _apart(colour[0][: half[0], : frame.width]) if name == "nv12" else (one[: half[0], : half[1]] for one in colour)
    )
    return Planes(luma[: frame.height, : frame.width], blue, red, rgb_from_yuv(*weights, full))


def _apart(pairs: NDArray[np.uint8]) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Blue and red differences that take turns, as devices give them."""
    return np.ascontiguousarray(pairs[:, 0::2]), np.ascontiguousarray(pairs[:, 1::2])


def rgb_from_yuv(of_red: float, of_blue: float, full: bool) -> Floats:
    """Matrix (3, 4) from (luma, blue difference, red difference, 1), each 0..255, to RGB, 0..255 (ITU-R BT.709, section 3)."""
    of_green = 1 - of_red - of_blue
    blue, red = 2 * (1 - of_blue), 2 * (1 - of_red)
    from_differences = np.array([[0, red], [-blue * of_blue / of_green, -red * of_red / of_green], [blue, 0]])
    low, luma, chroma = (0, 1.0, 1.0) if full else (16, 255 / 219, 255 / 224)
    matrix = np.hstack([np.full((3, 1), luma), chroma * from_differences])
    return np.hstack([matrix, -matrix @ [[low], [128], [128]]])
