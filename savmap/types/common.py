"""What all records share: the kinds of arrays, read-only arrays with a short `repr`, and a check."""

from collections.abc import Mapping
from typing import Literal

from savmap.geometry.arrays import Bools, Floats, Ints, array_record, read_only

__all__ = ["Axis", "Bools", "Floats", "Ints", "Place", "array_record", "read_only", "require"]

Axis = Literal["x", "y", "z"]
Place = Mapping[str, int | str]


def require(condition: bool, record: object, what: str) -> None:
    """Raise ValueError naming the record's class unless the condition holds."""
    if not condition:
        raise ValueError(f"{type(record).__name__}: {what}")
