"""Matching one to one, by the least cost (the Hungarian method; Kuhn 1955)."""

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment


def matched(costs: NDArray[np.float64], limit: float) -> dict[int, int]:
    """Pairs, row to column, of a matrix of costs (n, m): one to one, each of a cost below `limit`.

    Of costs that are not negative (distances), as many pairs as there can be, then the least sum. With `limit` 0, the
    least sum of negative costs (gains).
    """
    out_of_reach = limit * (1 + min(costs.shape))
    rows, columns = linear_sum_assignment(np.where(costs < limit, costs, out_of_reach))
    return {int(i): int(j) for i, j in zip(rows, columns, strict=True) if costs[i, j] < limit}
