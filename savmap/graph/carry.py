"""Several rows in one graph: each row's variables get keys of their own, and are found again afterwards."""

from collections.abc import Sequence

import gtsam
import numpy as np

from savmap.graph.keys import POSE2, is_frame
from savmap.types import Floats

ROW_BITS = 48
NO_ROW = 255


def carried_key(key: int, row: int) -> int:
    """A row's key in the graph of several rows."""
    return key + (row << ROW_BITS)


def row_of(key: int) -> int:
    """Which row a carried key belongs to."""
    return int(gtsam.symbolIndex(key)) >> ROW_BITS


def carried_factor(factor: gtsam.NonlinearFactor, row: int) -> gtsam.NonlinearFactor:
    """A row's factor over its carried keys."""
    if row == 0:
        return factor
    own = factor.keys()
    keys = [carried_key(key, row) for key in own]
    return _wrapped(factor, keys) if isinstance(factor, gtsam.CustomFactor) else factor.rekey(keys)


def carried_values(values: gtsam.Values, row: int) -> gtsam.Values:
    """A row's values at their carried keys."""
    keys = values.keys()
    return _renamed(values, [(key, carried_key(key, row)) for key in keys])


def values_of_row(values: gtsam.Values, row: int) -> gtsam.Values:
    """The values of one row, at its own keys."""
    keys = values.keys()
    return _renamed(values, [(key, carried_key(key, -row)) for key in keys if row_of(key) == row])


def _renamed(values: gtsam.Values, names: Sequence[tuple[int, int]]) -> gtsam.Values:
    renamed = gtsam.Values()
    for old, new in names:
        renamed.insert(new, value_at(values, old))
    return renamed


def value_at(values: gtsam.Values, key: int) -> gtsam.Pose3 | gtsam.Pose2 | Floats:
    """The value of a variable, of the kind that its key tells."""
    return values.atPose3(key) if is_frame(key) else own_at(values, key)


def own_at(values: gtsam.Values, key: int) -> gtsam.Pose2 | Floats:
    """The same of a variable that is no frame's pose."""
    return values.atPose2(key) if gtsam.symbolChr(key) == ord(POSE2) else values.atPoint3(key)


def _wrapped(factor: gtsam.CustomFactor, keys: Sequence[int]) -> gtsam.CustomFactor:
    """A factor written in Python cannot be copied: its whitened linear form under other keys."""
    names = list(zip(keys, factor.keys(), strict=True))

    def error(_: object, values: gtsam.Values, jacobians: list[Floats] | None) -> Floats:
        matrix, right = factor.linearize(_renamed(values, names)).jacobian()
        if jacobians is not None:
            ends = np.cumsum([6 if is_frame(key) else 3 for key in keys])
            for number, slope in enumerate(np.split(matrix, ends[:-1], axis=1)):
                jacobians[number] = slope
        return -right

    return gtsam.CustomFactor(gtsam.noiseModel.Unit.Create(factor.dim()), list(keys), error)
