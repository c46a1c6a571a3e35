"""Bright bars along a line of compact lamps, such as a purlin that they light: a mask joins them with the lamps that
they touch."""

from dataclasses import replace

import cv2
import numpy as np

from savmap.plugin import Detection, Floats
from savmap_lights.picture.profiles import STEP_PX, Singles, sampled

CORE = 0.6
LEAST_CORE_PX = 8
JOINED = 1.15
BESIDE_PX = np.array([3.0, 4.5, 6.0])
INSIDE_PX = 1.0
DARKER = 15.0
MOST = 0.4


def parts_of(detection: Detection) -> list[Detection]:
    """The thick parts of a detection's mask that thin ones join or stick out of; none where all is as thick."""
    inner = np.pad(detection.mask[detection.place].astype(np.uint8), 1)
    thick = 2 * float(cv2.distanceTransform(inner, cv2.DIST_L2, 3).max())
    size = round(CORE * thick)
    if size < LEAST_CORE_PX:
        return []
    opened = cv2.morphologyEx(inner, cv2.MORPH_OPEN, np.ones((size, size), np.uint8))
    count, numbers = cv2.connectedComponents(opened)
    if np.count_nonzero(inner) < JOINED * np.count_nonzero(opened):
        return []
    parts = []
    for number in range(1, count):
        part = np.zeros_like(detection.mask)
        part[detection.place] = (numbers == number)[1:-1, 1:-1]
        parts.append(replace(detection, mask=part))
    return parts


def without_bar(
    grey: Singles, middle: Floats, axis: Floats, size: float, width: float, level: float
) -> tuple[float, float]:
    """From where to where along an axis, px from its middle, a lamp of this size and width reaches without a bright bar
    that it touches there: one that goes on beside the lamp, on both sides."""
    low, high = -size / 2, size / 2
    along = np.arange(low, high + STEP_PX / 2, STEP_PX)
    sideways = width / 2 + BESIDE_PX
    flanks = sampled(grey, middle, axis, along, np.concatenate([-sideways, sideways])).reshape(len(along), 2, -1)
    flanks = flanks.mean(axis=2).min(axis=1)
    dark = float(flanks.min())
    if level - dark < DARKER:
        return low, high
    unlit = along[flanks < (level + dark) / 2]
    first, last = float(unlit[0]) - STEP_PX / 2, float(unlit[-1]) + STEP_PX / 2
    begins = first if INSIDE_PX < first - low <= MOST * size else low
    ends = last if INSIDE_PX < high - last <= MOST * size else high
    return begins, ends
