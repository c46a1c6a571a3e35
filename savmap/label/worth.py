"""How much there is to learn from labelling a view: where the network is unsure, where it changes its mind, what it looks like."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Maps = NDArray[np.float32]
Image = NDArray[np.uint8]
Classes = NDArray[np.uint8]

SMALL = (320, 240)
NEAR_PX = 9
UNSURE_MARGIN = 0.5
GRID, THUMBNAIL = (4, 3), (8, 6)


@dataclass(frozen=True)
class Look:
    """What the network made of a view: its classes and brightness, at (240, 320)."""

    classes: Classes
    grey: Image


def look_of(image: Image, maps: Maps) -> Look:
    """Of a view (h, w, 3) RGB and its probabilities (1 + classes, h, w)."""
    classes = maps.argmax(axis=0).astype(np.uint8)
    grey = cv2.resize(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), SMALL, interpolation=cv2.INTER_AREA)
    small = cv2.resize(classes, SMALL, interpolation=cv2.INTER_NEAREST)
    return Look(np.asarray(small, np.uint8), np.asarray(grey, np.uint8))


def borders(classes: Classes, width: int) -> NDArray[np.bool_]:
    """(h, w): within about half of `width` px of where one class ends and another begins."""
    around = np.ones((width, width), np.uint8)
    apart: NDArray[np.bool_] = cv2.dilate(classes, around) != cv2.erode(classes, around)
    return apart


def doubt(maps: Maps) -> float:
    """Mean entropy, 0..1, of the pixels (1 + classes, h, w) near borders of classes and of those between two; 0 where there are none.

    Far from them a network is always sure, and a view with much background would seem well known.
    """
    first, second = np.sort(maps, axis=0)[:-3:-1]
    near = borders(maps.argmax(axis=0).astype(np.uint8), NEAR_PX) | (first - second < UNSURE_MARGIN)
    if not near.any():
        return 0.0
    chosen = np.clip(maps[:, near], 1e-6, 1)
    return float(-(chosen * np.log(chosen)).sum(axis=0).mean() / np.log(len(maps)))


def disagreement(before: Look, after: Look) -> float:
    """The share, 0..1, of pixels of any class that are of another in the next frame, once the frames are laid over one another by
    their optical flow (Kroeger et al., Fast Optical Flow using Dense Inverse Search, 2016); borders are left out."""
    flow = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_ULTRAFAST).calc(
        before.grey, after.grey, np.zeros((*before.grey.shape, 2), np.float32)
    )
    columns, rows = np.meshgrid(np.arange(SMALL[0], dtype=np.float32), np.arange(SMALL[1], dtype=np.float32))
    moved = cv2.remap(
        after.classes,
        columns + flow[..., 0],
        rows + flow[..., 1],
        cv2.INTER_NEAREST,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=(255,),
    )
    judged = (moved != 255) & ((before.classes > 0) | (moved > 0))
    changed = (
        judged & (moved != before.classes) & ~(borders(before.classes, 3) & borders(np.asarray(moved, np.uint8), 3))
    )
    return float(changed.sum() / max(judged.sum(), 1))


def descriptor(image: Image, maps: Maps) -> NDArray[np.float64]:
    """What a view shows, roughly: its colours in 8x6 cells, and how much of each class is in 4x3 cells, on one scale."""
    colours = cv2.resize(cv2.cvtColor(image, cv2.COLOR_RGB2LAB), THUMBNAIL, interpolation=cv2.INTER_AREA) / 255.0
    shares = [cv2.resize(plane, GRID, interpolation=cv2.INTER_AREA) for plane in maps[1:]]
    parts = (colours.ravel(), np.sqrt(np.clip(np.array(shares).ravel(), 0, 1)))
    return np.concatenate([part / np.sqrt(max(len(part), 1)) for part in parts]).astype(np.float64)
