"""Records as bytes and back, exactly: dataclasses of savmap with mappings and arrays. Reading never runs code from the
bytes.

The bytes are compressed: a JSON tree, in which arrays stand by type, shape and place, then the arrays' item bytes.
Sequences of records of one kind, of which there may be many thousands, stand field by field.
"""

import dataclasses
import json
import sys
import zlib
from collections.abc import Iterator, Mapping, Sequence
from itertools import accumulate
from typing import Any, TypeVar

import numpy as np

Record = TypeVar("Record")
LEVEL = 1
HEAD = 8
PACKAGE = "savmap."
NUMBERS = "biuf"
PLAIN = {type(None), bool, int, float, str}


def packed(record: object, level: int = LEVEL) -> bytes:
    """A record as bytes. TypeError for what is neither a dataclass of savmap, a mapping, a sequence, an array, bytes,
    nor plain. `level`: of zlib's compression, from 0, none, to 9."""
    arrays = bytearray()
    tree = json.dumps(_tree(record, arrays), separators=(",", ":")).encode()
    return zlib.compress(len(tree).to_bytes(HEAD, "little") + tree + arrays, level)


def unpacked(content: bytes, kind: type[Record]) -> Record:
    """The record of this kind that the bytes hold. ValueError where they hold something else, or are damaged."""
    try:
        inflated = memoryview(zlib.decompress(content))
        size = int.from_bytes(inflated[:HEAD], "little")
        tree = json.loads(bytes(inflated[HEAD : HEAD + size]))
        record = _record(tree, inflated[HEAD + size :])
    except (zlib.error, LookupError, TypeError, AttributeError, ValueError, ArithmeticError, RecursionError) as error:
        raise ValueError(f"not a stored {kind.__name__}: {error}") from error
    if not isinstance(record, kind):
        raise ValueError(f"not a stored {kind.__name__} but a {type(record).__name__}")
    return record


def _tree(value: Any, arrays: bytearray) -> Any:
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray) and value.dtype.kind in NUMBERS:
        place = len(arrays)
        arrays.extend(np.ascontiguousarray(value).tobytes())
        return {"array": [value.dtype.str, list(value.shape), place]}
    if isinstance(value, bytes):
        arrays.extend(value)
        return {"bytes": [len(arrays) - len(value), len(value)]}
    kind = type(value)
    if dataclasses.is_dataclass(kind) and kind.__module__.startswith(PACKAGE):
        fields = [_tree(getattr(value, field.name), arrays) for field in dataclasses.fields(kind)]
        return {"record": [kind.__module__, kind.__qualname__, fields]}
    if isinstance(value, Mapping):
        return {"mapping": [[_tree(key, arrays), _tree(item, arrays)] for key, item in value.items()]}
    if isinstance(value, frozenset):
        return {"set": [_tree(item, arrays) for item in sorted(value)]}
    if isinstance(value, Sequence):
        return {"tuple" if isinstance(value, tuple) else "list": _items(value, arrays)}
    raise TypeError(f"a {type(value).__name__} cannot be stored")


def _items(values: Sequence[Any], arrays: bytearray) -> Any:
    """A sequence's items: one by one, or field by field where all are records of one kind."""
    kinds = {type(value) for value in values}
    kind = next(iter(kinds), None)
    if len(kinds) != 1 or kind is None or not dataclasses.is_dataclass(kind) or not dataclasses.fields(kind):
        return [_tree(item, arrays) for item in values]
    if not kind.__module__.startswith(PACKAGE):
        raise TypeError(f"a {kind.__name__} cannot be stored")
    columns = [_column([getattr(value, field.name) for value in values], arrays) for field in dataclasses.fields(kind)]
    return {"records": [kind.__module__, kind.__qualname__, columns]}


def _column(values: list[Any], arrays: bytearray) -> Any:
    """One field of many records. Arrays that differ only in length are joined."""
    kinds = {type(value) for value in values}
    items = [item for value in values for item in value.items()] if kinds == {dict} else []
    if kinds <= PLAIN or (kinds == {dict} and all(type(key) is str and type(item) in PLAIN for key, item in items)):
        return {"plain": values}  # JSON preserves them exactly
    alike = kinds == {np.ndarray} and len({(value.dtype, value.shape[1:]) for value in values}) == 1
    if alike and all(value.ndim for value in values):
        return {"arrays": [[len(value) for value in values], _tree(np.concatenate(values), arrays)]}
    return {"each": [_tree(value, arrays) for value in values]}


def _record(tree: Any, arrays: memoryview) -> Any:
    if not isinstance(tree, dict):
        return tree
    ((kind, content),) = tree.items()
    if kind == "array":
        dtype, shape, place = content
        count = int(np.prod(shape))
        return np.frombuffer(arrays, np.dtype(dtype), count, place).reshape(shape).copy()
    if kind == "bytes":
        place, count = content
        return bytes(arrays[place : place + count])
    if kind == "record":
        module, name, fields = content
        return _class(module, name)(*(_record(item, arrays) for item in fields))
    if kind == "mapping":
        return {_record(key, arrays): _record(item, arrays) for key, item in content}
    items = _made(content, arrays) if isinstance(content, dict) else (_record(item, arrays) for item in content)
    return {"set": frozenset, "tuple": tuple, "list": list}[kind](items)


def _made(tree: Any, arrays: memoryview) -> Iterator[Any]:
    """Records of one kind, of which the fields are stored."""
    module, name, columns = tree["records"]
    kind = _class(module, name)
    return (kind(*fields) for fields in zip(*(_values(column, arrays) for column in columns), strict=True))


def _values(column: Any, arrays: memoryview) -> list[Any]:
    """One field of many records."""
    ((kind, content),) = column.items()
    if kind == "plain":
        return list(content)
    if kind == "each":
        return [_record(item, arrays) for item in content]
    lengths, joined = content[0], _record(content[1], arrays)
    ends = list(accumulate(lengths))
    return [joined[end - length : end] for length, end in zip(lengths, ends, strict=True)]


def _class(module: str, name: str) -> Any:
    """A dataclass of savmap that is already imported: no other object can be made from the bytes."""
    kind = getattr(sys.modules[module], name) if module.startswith(PACKAGE) else None
    if not (isinstance(kind, type) and dataclasses.is_dataclass(kind)):
        raise KeyError(f"{module}.{name} is not a record")
    return kind
