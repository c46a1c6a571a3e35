"""What a network's masks say of lamps: where to look for what shines, how wide it may be, and how bright."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from savmap.plugin import Detection, Floats
from savmap_lights.picture.bars import parts_of
from savmap_lights.picture.profiles import Singles

STRIP_RATIO = 2.5
SURE = 0.7
LEAST_PX = 12


@dataclass(frozen=True, eq=False)
class Seed:
    """What a mask says of a lamp: number of its detection, middle (2,) px, long axis (2,), length and width px, brightness, and the seeds of its
    thick parts where thin ones join them."""

    number: int
    middle: Floats
    axis: Floats
    length: float
    width: float
    level: float
    parts: tuple["Seed", ...] = ()


def seeds_of(grey: Singles, detections: Sequence[Detection]) -> list[Seed]:
    """The detections' seeds, the largest first."""
    found = [
        _with_parts(grey, detection, _seed(grey, detection, number)) for number, detection in enumerate(detections)
    ]
    return sorted((seed for seed in found if seed is not None), key=lambda seed: -seed.length * seed.width)


def _with_parts(grey: Singles, detection: Detection, seed: Seed | None) -> Seed | None:
    if seed is None:
        return None
    parts = [_seed(grey, replace(detection, mask=part), seed.number) for part in parts_of(detection.mask)]
    return replace(seed, parts=tuple(part for part in parts if part is not None))


def _seed(grey: Singles, detection: Detection, number: int) -> Seed | None:
    rows, columns = np.nonzero(detection.mask)
    if len(rows) < LEAST_PX:
        return None
    weights = detection.probability[rows, columns].astype(np.float64)
    pixels = np.stack([columns, rows], axis=1).astype(np.float64)
    middle = np.average(pixels, axis=0, weights=weights)
    spread, axes = np.linalg.eigh(np.cov((pixels - middle).T, aweights=weights) + 1e-9 * np.eye(2))
    long, wide = np.sqrt(12 * spread[1]), np.sqrt(12 * spread[0])
    return Seed(number, middle, axes[:, 1], float(long), float(wide), brightness_of(grey, detection))


def brightness_of(grey: Singles, detection: Detection) -> float:
    """How bright a picture is where the network is sure of a lamp."""
    weights = detection.probability[detection.mask]
    sure = weights >= min(SURE, float(weights.max()))
    return float(np.percentile(grey[detection.mask][sure], 75))
