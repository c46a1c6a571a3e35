"""Factors and values of a row under the keys that it has in the graph of several rows, and back."""

from collections.abc import Sequence

import gtsam
import numpy as np

from savmap.graph.keys import rekey, row_of, value_at, width_of
from savmap.types import Floats


def rekey_factor(factor: gtsam.NonlinearFactor, row: int) -> gtsam.NonlinearFactor:
    """A row's factor over its keys in the graph of several rows."""
    if row == 0:
        return factor
    keys = factor.keys()
    keys = [rekey(key, row) for key in keys]
    return _wrapped(factor, keys) if isinstance(factor, gtsam.CustomFactor) else factor.rekey(keys)


def rekey_values(values: gtsam.Values, row: int) -> gtsam.Values:
    """A row's values at their keys in the graph of several rows."""
    keys = values.keys()
    return _renamed(values, [(key, rekey(key, row)) for key in keys])


def values_of_row(values: gtsam.Values, row: int) -> gtsam.Values:
    """The values of one row, at the keys that it has alone."""
    keys = values.keys()
    return _renamed(values, [(key, rekey(key, -row)) for key in keys if row_of(key) == row])


def _renamed(values: gtsam.Values, names: Sequence[tuple[int, int]]) -> gtsam.Values:
    renamed = gtsam.Values()
    for old, new in names:
        renamed.insert(new, value_at(values, old))
    return renamed


def _wrapped(factor: gtsam.CustomFactor, keys: Sequence[int]) -> gtsam.CustomFactor:
    """A factor written in Python cannot be copied: its whitened linear form under other keys."""
    names = list(zip(keys, factor.keys(), strict=True))

    def error(_: object, values: gtsam.Values, jacobians: list[Floats] | None) -> Floats:
        matrix, right = factor.linearize(_renamed(values, names)).jacobian()
        if jacobians is not None:
            ends = np.cumsum([width_of(key) for key in keys])
            for number, slope in enumerate(np.split(matrix, ends[:-1], axis=1)):
                jacobians[number] = slope
        return -right

    return gtsam.CustomFactor(gtsam.noiseModel.Unit.Create(factor.dim()), list(keys), error)
