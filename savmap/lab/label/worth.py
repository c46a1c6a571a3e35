"""Which of many views to label: those that promise most, unlike one another and spread over the recording.

A view promises much where the network is unsure, and where it changes its mind from one frame to the next.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Maps = NDArray[np.float32]
Image = NDArray[np.uint8]
Classes = NDArray[np.uint8]
Floats = NDArray[np.float64]

SMALL = (320, 240)
NEAR_PX = 9
UNSURE_MARGIN = 0.5
LEAST_WORTH = 0.25
GRID, THUMBNAIL = (4, 3), (8, 6)


@dataclass(frozen=True, eq=False)
class SeenView:
    """What the network made of a view: its classes and brightness, at (240, 320)."""

    classes: Classes
    grey: Image


def seen_view(image: Image, maps: Maps) -> SeenView:
    """Of a view (h, w, 3) RGB and its probabilities (1 + classes, h, w)."""
    classes = maps.argmax(axis=0).astype(np.uint8)
    grey = cv2.resize(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), SMALL, interpolation=cv2.INTER_AREA)
    small = cv2.resize(classes, SMALL, interpolation=cv2.INTER_NEAREST)
    return SeenView(np.asarray(small, np.uint8), np.asarray(grey, np.uint8))


def borders(classes: Classes, width: int) -> NDArray[np.bool_]:
    """(h, w): within about half of `width` px of where one class ends and another begins."""
    around = np.ones((width, width), np.uint8)
    edges: NDArray[np.bool_] = cv2.dilate(classes, around) != cv2.erode(classes, around)
    return edges


def uncertainty(maps: Maps) -> float:
    """Mean entropy, 0..1, of the pixels (1 + classes, h, w) near borders of classes and of those between two; 0 where
    there are none.

    Far from them a network is always sure, and a view with much background would seem well known.
    """
    first, second = np.sort(maps, axis=0)[:-3:-1]
    near = borders(maps.argmax(axis=0).astype(np.uint8), NEAR_PX) | (first - second < UNSURE_MARGIN)
    if not near.any():
        return 0.0
    chosen = np.clip(maps[:, near], 1e-6, 1)
    return float(-(chosen * np.log(chosen)).sum(axis=0).mean() / np.log(len(maps)))


def disagreement(before: SeenView, after: SeenView) -> float:
    """The share, 0..1, of pixels of any class that are of another in the next frame, once the frames are laid over one
    another by their optical flow (Kroeger et al., Fast Optical Flow using Dense Inverse Search, 2016); borders are left
    out."""
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
    compared = (moved != 255) & ((before.classes > 0) | (moved > 0))
    changed = (
        compared & (moved != before.classes) & ~(borders(before.classes, 3) & borders(np.asarray(moved, np.uint8), 3))
    )
    return float(changed.sum() / max(compared.sum(), 1))


def descriptor(image: Image, maps: Maps) -> NDArray[np.float64]:
    """What a view shows, roughly: its colours in 8x6 cells, and how much of each class is in 4x3 cells, on one
    scale."""
    colours = cv2.resize(cv2.cvtColor(image, cv2.COLOR_RGB2LAB), THUMBNAIL, interpolation=cv2.INTER_AREA) / 255.0
    shares = [cv2.resize(plane, GRID, interpolation=cv2.INTER_AREA) for plane in maps[1:]]
    parts = (colours.ravel(), np.sqrt(np.clip(np.array(shares).ravel(), 0, 1)))
    return np.concatenate([part / np.sqrt(max(len(part), 1)) for part in parts]).astype(np.float64)


def ranks(values: Floats) -> Floats:
    """Each value's rank (n,) as a share, 0 for the least and 1 for the greatest; equal ones share theirs."""
    distinct, place = np.unique(values, return_inverse=True)
    shares: Floats = place / max(len(distinct) - 1, 1)
    return shares


def chosen(worth: Floats, features: Floats, count: int) -> list[int]:
    """Up to `count` indices, in order, of views with what each promises (n,), 0..1, and what it looks like (n, d).

    Farthest-point sampling, weighted: first the one that promises most, then again and again the one that is farthest
    from all taken, times what it promises (but not less than a quarter, so that what the network is wrongly sure of has
    a chance). Equal to one that was taken: not taken.
    """
    if not len(worth):
        return []
    taken = [int(np.argmax(worth))]
    distances = np.linalg.norm(features - features[taken[0]], axis=1)
    while len(taken) < count:
        gain = distances * np.maximum(worth, LEAST_WORTH)
        best = int(np.argmax(gain))
        if gain[best] <= 0:
            break
        taken.append(best)
        distances = np.minimum(distances, np.linalg.norm(features - features[best], axis=1))
    return sorted(taken)
