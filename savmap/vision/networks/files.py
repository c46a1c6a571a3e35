"""The files that a network is made of: an ONNX file, and those that it names for its weights (ONNX: external data)."""

import hashlib
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from savmap.files.atomic import sha256

LOCATION = re.compile(rb"\x0a\x08location\x12([\x80-\xff]*[\x00-\x7f])")
"""How a tensor's external data begin: a StringStringEntryProto (onnx.proto) whose key is `location`; then the length of
the file's name."""


def network_files(model: Path) -> tuple[Path, ...]:
    """The ONNX file, then those with its weights that are there, by name. Raises OSError."""
    facts = model.stat()
    return (model, *(file for file in map(model.parent.joinpath, _named(model, facts.st_mtime_ns)) if file.is_file()))


def network_digest(model: Path) -> str:
    """SHA-256 of a network: of its file; or, with weights beside it, of a line for each file with its own. Raises
    OutputError, OSError."""
    digests = [sha256(file) for file in network_files(model)]
    return digests[0] if len(digests) == 1 else hashlib.sha256("\n".join(digests).encode()).hexdigest()


@cache
def _named(model: Path, changed_ns: int) -> tuple[str, ...]:
    """The files that an ONNX file named then."""
    return tuple(sorted(set(_locations(model.read_bytes()))))


def _locations(content: bytes) -> Iterator[str]:
    for found in LOCATION.finditer(content):
        length = sum((byte & 0x7F) << 7 * place for place, byte in enumerate(found[1]))
        yield content[found.end() : found.end() + length].decode(errors="surrogateescape")
