"""Pictures of any size at the network's own."""

import cv2
import numpy as np
from numpy.typing import NDArray

WIDTH, HEIGHT = 640, 480
"""Size of the views that networks are trained on and shown, px."""

Bytes = NDArray[np.uint8]


def fitted(image: Bytes, mask: Bytes, ignore: int) -> tuple[Bytes, Bytes]:
    """Picture (H, W, 3) and mask (H, W) scaled to fit into 640x480, shapes kept; the rest is grey, and `ignore` in the mask."""
    height, width = mask.shape
    if (width, height) == (WIDTH, HEIGHT):
        return image, mask
    scale = min(WIDTH / width, HEIGHT / height)
    size = max(1, round(width * scale)), max(1, round(height * scale))
    how = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    values = np.unique(mask)
    shares = [cv2.resize((mask == value).astype(np.float32), size, interpolation=how) for value in values]
    picture = np.full((HEIGHT, WIDTH, 3), 127, np.uint8)
    labels = np.full((HEIGHT, WIDTH), ignore, np.uint8)
    left, top = (WIDTH - size[0]) // 2, (HEIGHT - size[1]) // 2
    place = slice(top, top + size[1]), slice(left, left + size[0])
    picture[place] = cv2.resize(image, size, interpolation=how)
    labels[place] = values[np.argmax(shares, axis=0)]
    return picture, labels
