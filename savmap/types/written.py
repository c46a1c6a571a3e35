"""How the numbers and arrays of records stand in a map file: in which form, within which bounds, to how many decimals.

Coordinates are rounded to 0.01 mm, standard deviations to 0.001 mm, covariances to six digits, quaternions to nine
decimals.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, Field, GetCoreSchemaHandler, PlainSerializer
from pydantic_core import CoreSchema, core_schema

from savmap.geometry.arrays import Floats

FARTHEST_M = 1e6
"""No number of metres is larger: what is drawn, squared and summed stays within a float's bounds."""
FARTHEST_WORLD_M = 1e8
"""Of the site's origin in the user's world: eastings with the number of their zone before them have eight digits
(EPSG:4647)."""
LARGEST = 1e12
COORDINATE, FIGURE, QUATERNION = 5, 6, 9
"""Decimals; standard deviations have those of figures."""
UPPER = np.triu_indices(3)


@dataclass(frozen=True)
class Written:
    """Annotates a type whose values stand in a file as those of another `kind`, and how they are read and written."""

    kind: Any
    read: Callable[[Any], Any]
    write: Callable[[Any], Any]

    def __get_pydantic_core_schema__(self, source: object, handler: GetCoreSchemaHandler) -> CoreSchema:
        written = core_schema.plain_serializer_function_ser_schema(self.write)
        kind = handler.generate_schema(self.kind)
        return core_schema.no_info_after_validator_function(self.read, kind, serialization=written)


def rounded(value: Any, decimals: int = FIGURE) -> Any:
    """A number, or an array's numbers in lists, to so many decimals, without negative zeros."""
    if isinstance(value, Iterable):
        return [rounded(part, decimals) for part in value]
    return round(float(value), decimals) + 0.0


def figure(value: float | int | str) -> float | int | str:
    """A text or a whole number as it is, another number rounded."""
    if isinstance(value, str | int):
        return value if isinstance(value, str) else int(value)
    number: float = int(value) if isinstance(value, np.integer) else rounded(value)
    return number


def coordinates(values: Any) -> Any:
    """Metres, rounded."""
    return rounded(values, COORDINATE)


def upper_triangle(covariance: Floats) -> list[float]:
    """The upper triangle of a matrix (3, 3), row by row, to six digits."""
    return [float(f"{value:.6g}") + 0.0 for value in covariance[UPPER]]


def symmetric(upper: Any, size: int = 3) -> Floats:
    """The symmetric matrix (size, size) of an upper triangle, row by row."""
    full = np.zeros((size, size))
    full[np.triu_indices(size)] = upper
    matrix: Floats = full + np.triu(full, 1).T
    return matrix


def array(value: object) -> Floats:
    """Numbers; NaN for null."""
    return np.array(value, np.float64)


def _or_null(values: Iterable[float]) -> list[float | None]:
    return [None if math.isnan(value) else rounded(value) for value in values]


def _variances(upper: tuple[float, ...]) -> tuple[float, ...]:
    if min(upper[0], upper[3], upper[5]) < 0:
        raise ValueError("a variance is negative")
    return upper


Metres = Annotated[float, Field(ge=-FARTHEST_M, le=FARTHEST_M), PlainSerializer(rounded)]
WorldMetres = Annotated[float, Field(ge=-FARTHEST_WORLD_M, le=FARTHEST_WORLD_M), PlainSerializer(rounded)]
Deviation = Annotated[float, Field(ge=0, le=FARTHEST_M), PlainSerializer(rounded)]
Degrees = Annotated[float, Field(ge=-3600, le=3600), PlainSerializer(rounded)]
Number = Annotated[float, Field(ge=-LARGEST, le=LARGEST), PlainSerializer(figure)]
Figure = Annotated[Number | Annotated[int, Field(ge=-LARGEST, le=LARGEST)] | str, PlainSerializer(figure)]
Spread = Annotated[float, Field(ge=0, le=LARGEST), PlainSerializer(figure)]
Vector = Annotated[
    tuple[Metres, Metres, Metres], Field(description="x, y, z in the row's frame, m"), PlainSerializer(coordinates)
]
UpperTriangle = Annotated[
    tuple[Number, Number, Number, Number, Number, Number],
    Field(description="covariance xx, xy, xz, yy, yz, zz, m^2"),
    AfterValidator(_variances),
    PlainSerializer(upper_triangle),
]
Point = Annotated[Floats, Written(Vector, array, coordinates)]
Outline = Annotated[Floats, Written(Annotated[list[Vector], Field(min_length=3, max_length=1000)], array, coordinates)]
Covariance = Annotated[Floats, Written(UpperTriangle, symmetric, upper_triangle)]
SomeMetres = Annotated[Floats, Written(tuple[Metres | None, Metres | None, Metres | None], array, _or_null)]
SomeNumbers = Annotated[Floats, Written(tuple[Number | None, Number | None, Number | None], array, _or_null)]
SomeDeviations = Annotated[
    Floats, Written(tuple[Deviation | None, Deviation | None, Deviation | None], array, _or_null)
]
"""NaN, which is null in files, stands along axes that are not known."""
