"""What all records share: the kinds of arrays, read-only arrays with a short `repr`, and a check."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite
from typing import Literal

from savmap.geometry.arrays import Bools, Floats, Ints, array_record, read_only
from savmap.types.written import Number, Spread

__all__ = ["Attribute", "Axis", "Bools", "Floats", "Ints", "Measured", "Place", "array_record", "read_only", "require"]

Axis = Literal["x", "y", "z"]
Place = Mapping[str, int | float | str]


@dataclass(frozen=True)
class Measured:
    """A number with its standard deviation, in the unit that its name ends with ("height_m"). Raises ValueError for a
    sigma that is negative or a number that is not finite."""

    value: Number
    sigma: Spread

    def __post_init__(self) -> None:
        require(isfinite(self.value) and isfinite(self.sigma), self, "value and sigma must be finite")
        require(self.sigma >= 0, self, "sigma must not be negative")

    def __float__(self) -> float:
        return float(self.value)


Attribute = float | int | str | Measured


def require(condition: bool, record: object, what: str) -> None:
    """Raise ValueError naming the record's class unless the condition holds."""
    if not condition:
        raise ValueError(f"{type(record).__name__}: {what}")
