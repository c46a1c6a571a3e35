"""Records as bytes and back, exactly: dataclasses of savmap, their mappings and arrays; nothing in the bytes is ever run.

The bytes are compressed: a JSON tree, in which arrays stand by type, shape and place, then the arrays' own bytes.
"""

import dataclasses
import json
import sys
import zlib
from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

import numpy as np

Record = TypeVar("Record")
LEVEL = 1
HEAD = 8
PACKAGE = "savmap."
NUMBERS = "biuf"


def packed(record: object) -> bytes:
    """A record as bytes. TypeError for what is neither a dataclass of savmap, a mapping, a sequence, an array, nor plain."""
    arrays = bytearray()
    tree = json.dumps(_tree(record, arrays), separators=(",", ":")).encode()
    return zlib.compress(len(tree).to_bytes(HEAD, "little") + tree + arrays, LEVEL)


def unpacked(content: bytes, kind: type[Record]) -> Record:
    """The record of this kind that the bytes hold. ValueError where they hold something else, or are damaged."""
    try:
        plain = memoryview(zlib.decompress(content))
        size = int.from_bytes(plain[:HEAD], "little")
        tree = json.loads(bytes(plain[HEAD : HEAD + size]))
        record = _record(tree, plain[HEAD + size :])
    except (zlib.error, KeyError, IndexError, TypeError, AttributeError, json.JSONDecodeError) as error:
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
    kind = type(value)
    if dataclasses.is_dataclass(kind) and kind.__module__.startswith(PACKAGE):
        fields = [_tree(getattr(value, own.name), arrays) for own in dataclasses.fields(kind)]
        return {"record": [kind.__module__, kind.__qualname__, fields]}
    if isinstance(value, Mapping):
        return {"mapping": [[_tree(key, arrays), _tree(own, arrays)] for key, own in value.items()]}
    if isinstance(value, frozenset):
        return {"set": [_tree(own, arrays) for own in sorted(value)]}
    if isinstance(value, Sequence):
        return {"tuple" if isinstance(value, tuple) else "list": [_tree(own, arrays) for own in value]}
    raise TypeError(f"a {type(value).__name__} cannot be stored")


def _record(tree: Any, arrays: memoryview) -> Any:
    if not isinstance(tree, dict):
        return tree
    ((kind, content),) = tree.items()
    if kind == "array":
        dtype, shape, place = content
        count = int(np.prod(shape))
        return np.frombuffer(arrays, np.dtype(dtype), count, place).reshape(shape).copy()
    if kind == "record":
        module, name, fields = content
        return _class(module, name)(*(_record(own, arrays) for own in fields))
    if kind == "mapping":
        return {_record(key, arrays): _record(own, arrays) for key, own in content}
    items = (_record(own, arrays) for own in content)
    return {"set": frozenset, "tuple": tuple, "list": list}[kind](items)


def _class(module: str, name: str) -> Any:
    """A dataclass of savmap that is loaded already: the bytes cannot make anything else."""
    found = getattr(sys.modules[module], name) if module.startswith(PACKAGE) else None
    if not (isinstance(found, type) and dataclasses.is_dataclass(found)):
        raise KeyError(f"{module}.{name} is not a record")
    return found
