"""The kinds of arrays that savmap uses, and records that hold arrays."""

from collections.abc import Callable, Collection
from reprlib import Repr
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

Record = TypeVar("Record")
SHORT = Repr()
SHORTEST_COLLECTION = 4


def array_record(kind: type[Record]) -> type[Record]:
    """Decorator below `@dataclass(frozen=True, eq=False)`: the record's arrays are read-only, and its `repr` is short.

    A record holds read-only views: the caller's own arrays keep their flags, and nothing is copied. `==` compares
    identity, because arrays have no single truth value.
    """
    check: Callable[[Any], None] | None = getattr(kind, "__post_init__", None)

    def post_init(self: Any) -> None:
        _protect(self.__dict__)
        if check is not None:
            check(self)

    def set_state(self: Any, state: dict[str, Any]) -> None:
        _protect(state)  # arrays come writeable out of a pickle
        self.__dict__.update(state)

    for name, method in (("__post_init__", post_init), ("__setstate__", set_state), ("__repr__", short_repr)):
        setattr(kind, name, method)
    return kind


def read_only(array: NDArray[Any]) -> NDArray[Any]:
    """The array itself where it is read-only, else a read-only view of it."""
    if not array.flags.writeable:
        return array
    view = array.view()
    view.setflags(write=False)
    return view


def short_repr(record: object) -> str:
    """A record's class and fields; of arrays the dtype and shape, of longer collections the size."""
    fields = ", ".join(f"{name}={_short(value)}" for name, value in vars(record).items())
    return f"{type(record).__name__}({fields})"


def _protect(fields: dict[str, Any]) -> None:
    for name, value in fields.items():
        if isinstance(value, np.ndarray) and value.flags.writeable:
            fields[name] = read_only(value)


def _short(value: object) -> str:
    if isinstance(value, np.ndarray):
        return f"{value.dtype}{value.shape}"
    if isinstance(value, Collection) and not isinstance(value, str | bytes) and len(value) >= SHORTEST_COLLECTION:
        return f"<{type(value).__name__} of {len(value)}>"
    return SHORT.repr(value)
