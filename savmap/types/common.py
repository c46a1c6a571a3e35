"""What all records share: the kinds of arrays, and a check."""

from collections.abc import Mapping
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
Axis = Literal["x", "y", "z"]
Place = Mapping[str, int | str]


def require(condition: bool, record: object, what: str) -> None:
    """Raise ValueError naming the record's class unless the condition holds."""
    if not condition:
        raise ValueError(f"{type(record).__name__}: {what}")
