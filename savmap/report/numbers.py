"""Numbers and names as people read them."""

import re
from collections.abc import Iterable

MINUS, NOTHING = "\u2212", "\u2013"


def fixed(value: float | None, decimals: int, plus: bool = False) -> str:
    """A number with so many decimals; a dash for none, and a true minus that is not given to zero."""
    if value is None or value != value:
        return NOTHING
    text = f"{abs(value):.{decimals}f}"
    zero = not text.strip("0.")
    return ("" if zero else MINUS if value < 0 else "+" if plus else "") + text


def centimetres(value_m: float | None, plus: bool = False) -> str:
    """Metres as centimetres with two decimals."""
    return fixed(None if value_m is None else 100 * value_m, 2, plus)


def duration(seconds: float) -> str:
    """Such as "2 h 04 min", "3 min 20 s" or "4.2 s"."""
    if seconds < 60:
        return f"{seconds:.1f} s"
    if round(seconds) < 3600:
        return f"{round(seconds) // 60} min {round(seconds) % 60:02d} s"
    return f"{round(seconds / 60) // 60} h {round(seconds / 60) % 60:02d} min"


def natural(names: Iterable[str]) -> list[str]:
    """Names in the order in which people count: A2 before A10."""

    def parts(name: str) -> list[tuple[bool, int, str]]:
        split = filter(None, re.split(r"([0-9]+)", name))
        return [(not part.isdigit(), int(part) if part.isdigit() else 0, part) for part in split]

    return sorted(names, key=parts)


def anchors(names: Iterable[str]) -> dict[str, str]:
    """For each name an id of letters, digits and dashes that no other name has."""
    ids: dict[str, str] = {}
    for name in names:
        anchor = "row-" + (re.sub(r"[^A-Za-z0-9]+", "-", name).strip("-")[:40] or "x")
        candidates = (anchor if k == 1 else f"{anchor}-{k}" for k in range(1, len(ids) + 2))
        ids[name] = next(candidate for candidate in candidates if candidate not in ids.values())
    return ids


def shortened(text: str, most: int = 24) -> str:
    """The text, or its beginning with an ellipsis."""
    return text if len(text) <= most else text[: most - 1].rstrip() + "\N{HORIZONTAL ELLIPSIS}"
