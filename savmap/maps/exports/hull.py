"""The convex hull of points in a plane."""

import numpy as np

from savmap.types import Floats


def hull(points: Floats, margin_m: float = 0.0) -> Floats:
    """The convex hull (m, 2) of points (n, 2), or of squares that reach `margin_m` around them, counter-clockwise from
    the leftmost, without corners on straight sides (Andrew's monotone chain)."""
    if margin_m:
        square = margin_m * np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]])
        points = (points[:, None] + square).reshape(-1, 2)
    ordered = sorted(set(map(tuple, points.tolist())))
    corners: list[tuple[float, ...]] = []
    for way in (ordered, ordered[::-1]):
        chain: list[tuple[float, ...]] = []
        for c in way:
            while len(chain) > 1:
                a, b = chain[-2:]
                if (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) > 0:
                    break
                chain.pop()
            chain.append(c)
        corners += chain[:-1]
    return np.array(corners or ordered, dtype=np.float64)
