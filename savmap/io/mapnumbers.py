"""Numbers as map.json has them: rounded so that the same map always gives the same bytes."""

from collections.abc import Iterable

import numpy as np

from savmap.types import Floats

SIGMA, FIGURE = 6, 6
UPPER = np.triu_indices(3)


def rounded(values: Floats | Iterable[float], decimals: int) -> list[float]:
    """Numbers to so many decimals, without negative zeros."""
    return [round(float(value), decimals) + 0.0 for value in values]


def significant(value: float) -> float:
    """A number to six digits."""
    return float(f"{value:.6g}") + 0.0


def symmetric(upper: Iterable[float]) -> Floats:
    """The symmetric matrix (3, 3) of an upper triangle, row by row."""
    full = np.zeros((3, 3))
    full[UPPER] = list(upper)
    matrix: Floats = full + np.triu(full, 1).T
    return matrix
