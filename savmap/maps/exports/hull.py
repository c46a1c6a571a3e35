"""The convex hull of points in a plane."""

from collections.abc import Sequence

import numpy as np

from savmap.types import Floats


def hull(points: Floats) -> Floats:
    """The convex hull (m, 2) of points (n, 2), counter-clockwise from the leftmost, without corners on straight
    sides."""
    ordered = sorted(set(map(tuple, np.asarray(points).tolist())))
    lower, upper = _chain(ordered), _chain(ordered[::-1])
    corners: Floats = np.array([*lower[:-1], *upper[:-1]] or ordered, dtype=np.float64)
    return corners


def _chain(points: Sequence[tuple[float, ...]]) -> list[tuple[float, ...]]:
    chain: list[tuple[float, ...]] = []
    for point in points:
        while len(chain) > 1 and _area(chain[-2], chain[-1], point) <= 0:
            chain.pop()
        chain.append(point)
    return chain


def _area(a: tuple[float, ...], b: tuple[float, ...], c: tuple[float, ...]) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
