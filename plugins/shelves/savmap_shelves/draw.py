"""Features drawn onto the view that they were seen in."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.types import Feature

COLORS = {"left": (255, 80, 80), "right": (255, 200, 0), "lower": (0, 220, 255), "upper": (0, 255, 80)}
CORNER_COLOR = (255, 0, 255)
SUBPIXEL_BITS = 4


def draw_features(image: NDArray[np.uint8], features: Sequence[Feature]) -> NDArray[np.uint8]:
    """A view's picture (h, w, 3) RGB with its features: edges coloured by part and numbered, corners as rings."""
    canvas = image.copy()
    for feature in features:
        points = np.round(np.clip(feature.pixels, -4096, 4096) * (1 << SUBPIXEL_BITS)).astype(int)
        if len(points) == 2:
            color = COLORS.get(feature.part, CORNER_COLOR)
            one, other = (int(points[0, 0]), int(points[0, 1])), (int(points[1, 0]), int(points[1, 1]))
            cv2.line(canvas, one, other, color, 1, cv2.LINE_AA, SUBPIXEL_BITS)
            _number(canvas, feature)
        else:
            centre = (int(points[0, 0]), int(points[0, 1]))
            cv2.circle(canvas, centre, 3 << SUBPIXEL_BITS, CORNER_COLOR, 1, cv2.LINE_AA, SUBPIXEL_BITS)
    return canvas


def _number(canvas: NDArray[np.uint8], feature: Feature) -> None:
    if feature.part in ("left", "lower"):
        x, y = feature.pixels.mean(axis=0)
        text, at = f"{feature.label[0]}{feature.instance}", (int(x) + 3, int(y) + 3)
        cv2.putText(canvas, text, at, cv2.FONT_HERSHEY_PLAIN, 0.8, (255, 255, 255), 1, cv2.LINE_AA)
