"""What exports say of structures beside their shape: colours, sigmas, attributes, warnings, and names that are each
given once."""

from collections.abc import Callable, Iterable, Sequence
from importlib.metadata import version

import numpy as np

from savmap.errors import visible
from savmap.types import Floats, Measured, RowMap, Structure

Colour = tuple[float, float, float]
BETWEEN = " | "
"""Between several texts in one cell."""
MOST_LABELS = 8
IN_BRACKETS = "{} ({})"
"""The form of a name with a number, for people to read."""
PALETTE = ("#0072b2", "#e69f00", "#009e73", "#d55e00", "#cc79a7", "#56b4e9", "#f0e442", "#999999")
"""Okabe and Ito's colours, which the colour-blind tell apart, without black."""


def maker() -> str:
    """The program and its version."""
    return f"savmap {version('savmap')}"


def colours(labels: Iterable[str]) -> dict[str, str]:
    """A colour, such as "#0072b2", for each label."""
    return {label: PALETTE[k % len(PALETTE)] for k, label in enumerate(sorted(set(labels)))}


def bytes_of(colour: str) -> tuple[int, int, int]:
    """Red, green and blue of a colour, 0 to 255."""
    red, green, blue = bytes.fromhex(colour.removeprefix("#"))
    return red, green, blue


def linear(colour: str) -> Colour:
    """Red, green and blue of a colour as amounts of light, 0 to 1 (the inverse of sRGB's curve)."""
    red, green, blue = (
        round((value / 255 / 12.92) if value <= 10 else ((value / 255 + 0.055) / 1.055) ** 2.4, 4)
        for value in bytes_of(colour)
    )
    return red, green, blue


def sigmas(structure: Structure) -> Floats:
    """Standard deviations (n, 3) m of a structure's vertices along the axes."""
    spread: Floats = np.sqrt(np.maximum(np.diagonal(structure.covariances, axis1=1, axis2=2), 0.0))
    return spread


def assumed_depths(bodies: Iterable[tuple[str, float]]) -> str:
    """What to say of bodies whose depth was neither measured nor given, each by its label and depth, m: "assumed depth,
    neither measured nor given: post 1.1 m"; nothing of none."""
    depths = dict[str, list[float]]()
    for label, depth_m in bodies:
        depths.setdefault(visible(label), []).append(depth_m)
    said = []
    for label, values in list(depths.items())[:MOST_LABELS]:
        low, high = f"{min(values):.3g}", f"{max(values):.3g}"
        said.append(f"{label} {low} m" if low == high else f"{label} {low} to {high} m")
    if len(depths) > MOST_LABELS:
        said.append(f"and {len(depths) - MOST_LABELS} more")
    return f"assumed depth, neither measured nor given: {', '.join(said)}" if said else ""


def remarks(rows: Iterable[RowMap]) -> list[str]:
    """What to know of rows before they are used, a line each: what must be checked, and how far they may be off."""
    said = list[str]()
    for row in rows:
        warnings = row.verdict.warnings if row.verdict else ()
        said += [f"row {row.name} must be checked: {warning.line}" for warning in warnings]
        off_m = max((part.unchecked_m or 0.0 for group in row.structures.values() for part in group), default=0.0)
        if off_m:
            said.append(
                f"row {row.name} is not checked by a second reference: errors of {off_m:.2f} m would stay hidden"
            )
    return [visible(line) for line in said]


def commented(lines: Iterable[str]) -> str:
    """Lines, of which empty ones are left out, as comments that begin with a hash."""
    return "".join(f"# {line}\n" for line in lines if line)


def attributes(structure: Structure) -> dict[str, float | int | str]:
    """A structure's attributes; the standard deviation of one that was measured is another one, named "NAME sigma"."""
    values = dict[str, float | int | str]()
    for name, value in structure.attributes.items():
        if isinstance(value, Measured):
            values |= {name: value.value, f"{name} sigma": value.sigma}
        else:
            values[name] = value
    return values


def unique(names: Sequence[str], key: Callable[[str], str] = str, form: str = "{}_{}") -> list[str]:
    """The names, each once: one that was there before, `key` of both being equal, has a number added, in this form."""
    taken, given = set[str](), list[str]()
    counts = dict[str, int]()
    for name in names:
        new = name
        while key(new) in taken:
            counts[key(name)] = counts.get(key(name), 1) + 1
            new = form.format(name, counts[key(name)])
        taken.add(key(new))
        given.append(new)
    return given
