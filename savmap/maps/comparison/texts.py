"""A comparison as JSON and as lines for a terminal."""

import json
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from savmap.files.texts import json_visible
from savmap.maps.comparison.records import CHANGES, Comparison, Difference, ElementChange, RowComparison, RowMotion

FORMAT, VERSION = "savmap-comparison", 1
PLACE, CHANCE = 5, 3
"""Decimals of metres, digits of p."""
MM = 1000.0


def comparison_text(comparison: Comparison) -> str:
    """The text of a comparison's JSON file."""
    return json_visible(json.dumps(as_json(comparison), indent=1, ensure_ascii=False, allow_nan=False)) + "\n"


def as_json(comparison: Comparison) -> dict[str, Any]:
    """All of a comparison: rows, their motions, and every element and opening with its state and what was tested."""
    return {
        "format": FORMAT,
        "version": VERSION,
        "level": comparison.level,
        "missing_rows": list(comparison.missing),
        "new_rows": list(comparison.new),
        "rows": [_row(row) for row in comparison.rows],
    }


def _row(row: RowComparison) -> dict[str, Any]:
    return {
        "old": row.old,
        "new": row.new,
        "new_from_old": _motion(row.motion) if row.motion else None,
        "elements": [_element(one) for one in row.elements],
        "openings": [_element(one) for one in row.openings],
    }


def _motion(motion: RowMotion) -> dict[str, Any]:
    return {
        "shift_m": _rounded(motion.shift_m),
        "shift_sigma_m": _rounded(np.sqrt(np.diag(motion.shift_covariance))),
        "heading_deg": round(motion.heading_deg, PLACE),
        "covariance": [[float(f"{value:.6g}") for value in line] for line in motion.covariance.tolist()],
        "scale": _rounded(motion.scale, 7),
        "middle_m": _rounded(motion.middle_m),
        "pairs": motion.pairs,
        "alternatives_m": [round(one, 3) for one in motion.alternatives_m],
    }


def _element(change: ElementChange) -> dict[str, Any]:
    return {
        "plugin": change.plugin,
        "label": change.label,
        "state": change.state,
        "old": change.old_id,
        "new": change.new_id,
        "text": change.text,
        "position_m": _rounded(change.position_m),
        "p": _digits(change.p) if change.differences else None,
        "differences": [_difference(one) for one in change.differences],
    }


def _difference(difference: Difference) -> dict[str, Any]:
    entry: dict[str, Any] = {"what": difference.what, "old": _value(difference.old), "new": _value(difference.new)}
    if difference.difference_m is not None and difference.sigma_m is not None:
        entry |= {"difference_m": round(difference.difference_m, 6), "sigma_m": round(difference.sigma_m, 6)}
    return {**entry, "p": _digits(difference.p), "significant": difference.significant}


def _rounded(values: Any, decimals: int = PLACE) -> list[float]:
    rounded: list[float] = (np.round(np.asarray(values, np.float64), decimals) + 0.0).tolist()
    return rounded


def _digits(p: float) -> float:
    return float(f"{p:.{CHANCE}g}")


def _value(value: float | str) -> float | str:
    return value if isinstance(value, str) else round(value, PLACE)


def comparison_lines(comparison: Comparison) -> Iterator[str]:
    """How each row's frame lies, a line for each change, and a sum."""
    yield from (f"row {name}: missing" for name in comparison.missing)
    yield from (f"row {name}: new" for name in comparison.new)
    for row in comparison.rows:
        yield f"row {row.new}: {motion_text(row.motion)}"
        if row.motion and row.motion.ambiguous:
            yield f"  {ambiguity_text(row.motion)}"
        yield from _table(row.changes)
        yield f"  {counts_text(row)}"


def motion_text(motion: RowMotion | None) -> str:
    """How the old frame lies in the new one, with standard deviations of its origin's shift."""
    if motion is None:
        return "nothing in common was found, so that nothing is compared"
    sigmas = np.sqrt(np.diag(motion.shift_covariance)).tolist()
    axes = zip("xyz", motion.shift_m.tolist(), sigmas, strict=True)
    shift = ", ".join(f"{axis} {value:+.3f} m (+- {MM * sigma:.0f} mm)" for axis, value, sigma in axes)
    return f"old frame moved by {shift}, turned by {motion.heading_deg:.2f} deg; {motion.pairs} elements in common"


def ambiguity_text(motion: RowMotion) -> str:
    """What else the row may be."""
    others = ", ".join(f"{one:+.2f} m" for one in motion.alternatives_m)
    return f"ambiguous: shifted by {others} it fits as well, and nothing in the row tells which is right"


def counts_text(row: RowComparison) -> str:
    """How many elements are in which state."""
    counts = Counter(one.state for one in row.elements)
    sizes = Counter(one.state for one in row.openings)
    text = ", ".join(f"{count} {state}" for state, count in sorted(counts.items())) or "no elements"
    return text + (f"; openings: {', '.join(f'{n} {state}' for state, n in sorted(sizes.items()))}" if sizes else "")


def _table(changes: Sequence[ElementChange]) -> Iterator[str]:
    """A line for each change, in columns."""
    cells = [(one.state, change_name(one), change_text(one)) for one in changes]
    widths = [max((len(line[column]) for line in cells), default=0) for column in (0, 1)]
    yield from (f"  {state:{widths[0]}}  {name:{widths[1]}}  {what}".rstrip() for state, name, what in cells)


def change_name(change: ElementChange) -> str:
    """An element's name, the one it had before where that is another, and what is written on it."""
    before = f" (was {change.old_id})" if change.old_id and change.new_id and change.old_id != change.new_id else ""
    return f"{change.name}{before}" + (f' "{change.text}"' if change.text else "")


def change_text(change: ElementChange) -> str:
    """What differs, or where something is that has no partner."""
    if change.state in CHANGES and not change.differences:
        x, y, _ = change.position_m.tolist()
        return f"at x {x:.2f} m, y {y:.2f} m"
    return "; ".join(difference_text(one) for one in change.significant)


def difference_text(difference: Difference) -> str:
    """A difference with its standard deviation and chance."""
    if difference.difference_m is None or difference.sigma_m is None:
        return f'{difference.what} "{difference.old}" is "{difference.new}"'
    by, sigma = MM * difference.difference_m, MM * difference.sigma_m
    return f"{difference.what} {by:+.0f} mm (+- {sigma:.1f} mm, {difference.sigmas:.1f} sigma, p {difference.p:.0e})"
