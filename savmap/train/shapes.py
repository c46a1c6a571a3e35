"""Labels given as polygons and runs, drawn when they are needed."""

import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from savmap.errors import OutputError
from savmap.label.polygons import Mask, Polygon, filled

Bytes = NDArray[np.uint8]
Region = Sequence[Polygon] | Mask
"""One thing: polygons (each joined to the others), or its pixels (h, w)."""


@dataclass(frozen=True)
class Shapes:
    """What is in a picture of `width` x `height` px: regions with the network's class (0: another thing), later ones on top."""

    width: int
    height: int
    regions: Sequence[tuple[int, Region]]

    def mask(self) -> Bytes:
        """(H, W): 0 background, k the k-th class of the network."""
        return np.frombuffer(zlib.decompress(self._packed), np.uint8).reshape(self.height, self.width)

    @cached_property
    def _packed(self) -> bytes:
        drawn = np.zeros((self.height, self.width), np.uint8)
        for value, region in self.regions:
            if isinstance(region, np.ndarray):
                drawn[region] = value
                continue
            for polygon in region:
                drawn[filled(polygon, self.height, self.width)] = value
        return zlib.compress(drawn.tobytes(), 1)


def polygon_of(numbers: Sequence[float], where: str) -> Polygon:
    """(n, 2) from x, y, x, y... Raises OutputError, which begins with `where`, for what is no polygon."""
    if len(numbers) % 2 or len(numbers) < 6:
        raise OutputError(f"{where}: a polygon is three corners or more, x and y of each, not {len(numbers)} numbers")
    polygon = np.asarray(numbers, np.float64).reshape(-1, 2)
    if not np.isfinite(polygon).all():
        raise OutputError(f"{where}: a corner is not a finite number")
    return polygon


def values_of(theirs: Sequence[str], classes: Sequence[str]) -> list[int]:
    """The network's value of each class of a data set: 0 for those that it does not have."""
    return [classes.index(name) + 1 if name in classes else 0 for name in theirs]


def require_pictures(source: Path, count: int) -> None:
    """Raise OutputError for a set without pictures."""
    if count == 0:
        raise OutputError(f"{source}: names no pictures; export the set again, with its pictures")
