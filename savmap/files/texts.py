"""Text from files that anybody may have written: read within bounds of size, depth and number, and put on one line to
be shown."""

import json
import math
import os
import re
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import NoReturn

from savmap.errors import CONTROLS, OutputError
from savmap.files.urls import is_url

MB = 1 << 20
MOST_MB = 64
"""Of a text file: a map of a hundred rows has 10."""
MOST_VALUES = 8_000_000
"""Of a JSON file: each takes up to 100 bytes of memory."""
MOST_NAME, MOST_PATH = 255, 3000
"""Bytes of a file's name, and of a path, which may follow that of a folder: no system takes more than 4096."""
MOST_DIGITS = 300
"""Of a whole number: a double holds up to 308."""
BINARY = re.compile(rb"[\x00-\x08\x0e-\x1a\x1c-\x1f]")
UTF_16 = (b"\xff\xfe", b"\xfe\xff")
SURROGATES = re.compile("[\ud800-\udfff]")
SPECIAL = "is a device or a pipe, not a file"


def bounded_bytes(path: Path, most_mb: float = MOST_MB) -> bytes:
    """What a regular file or a URL holds. Raises OSError, and ValueError for what is no file (nothing is waited for),
    or too large."""
    most = int(most_mb * MB)
    if is_url(path):
        with path.open("rb") as remote:
            content = bytes(remote.read(most + 1))
    else:
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        with open(descriptor, "rb", closefd=True) as stream:
            kind = os.fstat(descriptor).st_mode
            if not stat.S_ISREG(kind):
                raise ValueError(SPECIAL)
            content = stream.read(most + 1)
    if len(content) > most:
        raise ValueError(f"is larger than {most_mb:g} MB, which is the most that is read of such a file")
    return content


def is_text(head: bytes) -> bool:
    """Whether the first bytes of a file are those of a text, in whatever encoding: no control characters but those of
    lines, or the mark of UTF-16."""
    return head.startswith(UTF_16) or not BINARY.search(head)


def bounded_text(path: Path, most_mb: float = MOST_MB) -> str:
    """The text of a UTF-8 file, its line ends as `\\n`. Raises OSError, and ValueError as `bounded_bytes` does."""
    try:
        text = bounded_bytes(path, most_mb).decode("utf-8")
    except UnicodeDecodeError as error:
        raise ValueError(f"is not a text file (byte {error.start} is not UTF-8)") from error
    return text.replace("\r\n", "\n").replace("\r", "\n")


def json_of(text: str) -> object:
    """What a JSON text holds. Raises ValueError for too many values, numbers that are not finite, halves of surrogate
    pairs, and all that JSON does not allow."""
    values = sum(map(text.count, ",[{"))
    if values > MOST_VALUES:
        raise ValueError(f"it holds {values} values; at most {MOST_VALUES} are read")
    try:
        content: object = json.loads(text, parse_constant=_refuse, parse_float=_finite, parse_int=_whole)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None
    if "\\ud" in text.lower() and any(map(SURROGATES.search, _texts(content))):
        raise ValueError("a text in it holds half a character")
    return content


def json_visible(text: str) -> str:
    """A JSON text whose characters that do something to a terminal stand as JSON's escapes, and halves of characters as
    replacement characters; line ends between values stay."""
    return CONTROLS.sub(_json_escape, text)


def _json_escape(found: re.Match[str]) -> str:
    letter = found[0]
    return letter if letter == "\n" else "\ufffd" if SURROGATES.match(letter) else f"\\u{ord(letter):04x}"


def _texts(content: object) -> Iterator[str]:
    """All texts in a JSON content, keys too."""
    left = [content]
    while left:
        value = left.pop()
        if isinstance(value, str):
            yield value
        elif isinstance(value, dict):
            left += [*value, *value.values()]
        elif isinstance(value, list):
            left += value


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"{text:.20} is too large")
    return value


def _whole(text: str) -> int:
    if len(text) > MOST_DIGITS:
        raise ValueError(f"{text:.20}... is too large")
    return int(text)


def _refuse(name: str) -> NoReturn:
    raise ValueError(f"{name} is not a number")


def fault_of_path(text: str) -> str:
    """What is wrong with a path that no file can have; nothing where one may."""
    if any(ord(letter) < ord(" ") or letter == "\x7f" for letter in text) or SURROGATES.search(text):
        return "holds a control character or half a character"
    longest = max(len(part.encode()) for part in text.split("/"))
    return "is too long" if longest > MOST_NAME or len(text.encode()) > MOST_PATH else ""


def require_file(path: Path) -> None:
    """Raise OutputError for a device or a pipe, which reading would wait for."""
    try:
        kind = stat.S_IFREG if is_url(path) else path.stat().st_mode
    except OSError:
        return
    if not (stat.S_ISREG(kind) or stat.S_ISDIR(kind)):
        raise OutputError(f"{path}: {SPECIAL}")
