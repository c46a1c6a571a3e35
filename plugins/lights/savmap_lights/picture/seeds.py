"""What a network's masks say of lamps: where to look for what shines, how wide it may be, and how bright."""

from collections.abc import Container, Sequence
from dataclasses import dataclass, replace

import numpy as np

from savmap.plugin import Detection, Floats
from savmap_lights.picture.bars import parts_of
from savmap_lights.picture.profiles import Singles

STRIP_RATIO = 2.5
SURE = 0.7
LEAST_PX = 12
BRIGHT = 0.75
"""Of what is sure of a lamp, so much is darker than its brightness."""


@dataclass(frozen=True, eq=False)
class Seed:
    """What a mask says of a lamp: number of its detection, middle (2,) px, long axis (2,), length and width px,
    brightness, and the seeds of its thick parts where thin ones join them."""

    number: int
    middle: Floats
    axis: Floats
    length: float
    width: float
    level: float
    parts: tuple["Seed", ...] = ()


def seeds_of(grey: Singles, detections: Sequence[Detection], numbers: Container[int] | None = None) -> list[Seed]:
    """The seeds of the detections, or of those with these numbers, the largest first."""
    seeds = [
        _with_parts(grey, detection, _seed(grey, detection, number))
        for number, detection in enumerate(detections)
        if numbers is None or number in numbers
    ]
    return sorted((seed for seed in seeds if seed is not None), key=lambda seed: -seed.length * seed.width)


def _with_parts(grey: Singles, detection: Detection, seed: Seed | None) -> Seed | None:
    if seed is None:
        return None
    parts = [_seed(grey, part, seed.number) for part in parts_of(detection)]
    return replace(seed, parts=tuple(part for part in parts if part is not None))


def _seed(grey: Singles, detection: Detection, number: int) -> Seed | None:
    place = detection.place
    rows, columns = np.nonzero(detection.mask[place])
    if len(rows) < LEAST_PX:
        return None
    pixels = np.stack([columns + place[1].start, rows + place[0].start]).astype(np.float64)
    weights = detection.probability[place][rows, columns].astype(np.float64)
    total = weights.sum()
    middle = pixels @ weights / total
    offset = pixels - middle[:, None]
    spread, axes = np.linalg.eigh(
        (offset * weights) @ offset.T / (total - weights @ weights / total) + 1e-9 * np.eye(2)
    )
    long, wide = np.sqrt(12 * spread[1]), np.sqrt(12 * spread[0])
    return Seed(number, middle, axes[:, 1], float(long), float(wide), brightness_of(grey, detection))


def brightness_of(grey: Singles, detection: Detection) -> float:
    """How bright a picture is where the network is sure of a lamp."""
    place = detection.place
    inside = detection.mask[place]
    weights = detection.probability[place][inside]
    sure = np.sort(grey[place][inside][weights >= min(SURE, float(weights.max()))])
    return float(np.interp(BRIGHT * (len(sure) - 1), np.arange(len(sure)), sure))
