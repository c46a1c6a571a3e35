"""Text from files that anybody may have written: read within bounds of size, and put on one line to be shown."""

import json
import math
import re
from pathlib import Path
from typing import NoReturn

from savmap.errors import CONTROLS, without_secrets

MB = 1 << 20
MOST_MB = 64
"""Of a text file: a map of a hundred rows has 10."""
MOST_VALUES = 8_000_000
"""Of a JSON file: each takes up to 100 bytes of memory."""
MOST_NAME, MOST_PATH = 255, 3000
"""Bytes of a file's name, and of a path, which may follow that of a folder: no system takes more than 4096."""
BINARY = re.compile(rb"[\x00-\x08\x0e-\x1a\x1c-\x1f]")
UTF_16 = (b"\xff\xfe", b"\xfe\xff")
SPACES = " '\u00a0\u2007\u2009\u202f\u2019"
"""What parts groups of three digits, beside the comma and the point: in France, in Switzerland, by ISO 80000."""
READINGS = {
    decimal: re.compile(
        rf"[+-]?(?=[{decimal}]?\d)(\d+|[1-9]\d{{0,2}}([{SPACES}{group}])\d{{3}}(?:\2\d{{3}})*)?([{decimal}]\d*)?"
        r"(e[+-]?\d{1,3})?",
        re.IGNORECASE,
    )
    for decimal, group in (".,", ",.")
}
"""Numbers whose decimals follow a point, and a comma."""
SURROGATES = re.compile("[\ud800-\udfff]")


def bounded_bytes(path: Path, most_mb: float = MOST_MB) -> bytes:
    """What a regular file or a URL holds. Raises OSError, and ValueError for what is no file (nothing is waited for),
    or too large."""
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise ValueError("is a device or a pipe, not a file")
    most = int(most_mb * MB)
    with path.open("rb") as stream:
        content = bytes(stream.read(most + 1))
    if len(content) > most:
        raise ValueError(f"is larger than {most_mb:g} MB, which is the most that is read of such a file")
    return content


def head_of(path: Path, size: int) -> bytes:
    """The first bytes of a file; none of a device, or where it cannot be read."""
    try:
        if not path.is_file():
            return b""
        with path.open("rb") as stream:
            return stream.read(size)
    except OSError:
        return b""


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
    """What a JSON text holds. Raises ValueError for too many values, for numbers that are not finite, and for all that
    JSON does not allow."""
    if (values := sum(map(text.count, ",[{"))) > MOST_VALUES:
        raise ValueError(f"it holds {values} values; at most {MOST_VALUES} are read")
    try:
        content: object = json.loads(text, parse_constant=_refuse, parse_float=_finite, parse_int=_whole)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None
    return content


def readings(text: str) -> dict[str, float]:
    """What a number means by the sign before its decimals, "." or ",", of those that it can be written with; digits may
    stand in groups. "1,234" may be 1234 or 1.234, "1,234.5" is one number, "1,23,4" none."""
    numbers = {}
    for decimal, form in READINGS.items():
        if form.fullmatch(text):
            numbers[decimal] = float(re.sub(f"[^{decimal}0-9e+-]", "", text.lower()).replace(",", "."))
    return numbers


def json_visible(text: str) -> str:
    """A JSON text whose characters that do something to a terminal stand as JSON's escapes, and halves of characters as
    replacement characters, and URLs without their secrets; line ends between values stay."""
    return CONTROLS.sub(_json_escape, without_secrets(text))


def _json_escape(match: re.Match[str]) -> str:
    letter = match[0]
    return letter if letter == "\n" else "\ufffd" if SURROGATES.match(letter) else f"\\u{ord(letter):04x}"


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"{text:.20} is too large")
    return value


def _whole(text: str) -> int:
    _finite(text)
    return int(text)


def _refuse(name: str) -> NoReturn:
    raise ValueError(f"{name} is not a number")


def fault_of_path(text: str) -> str:
    """What is wrong with a path that no file can have; nothing where one may."""
    if any(ord(letter) < ord(" ") or letter == "\x7f" for letter in text) or SURROGATES.search(text):
        return "holds a control character (a backslash in double quotation marks may make one) or half a character"
    longest = max(len(part.encode()) for part in text.split("/"))
    return "is too long" if longest > MOST_NAME or len(text.encode()) > MOST_PATH else ""
