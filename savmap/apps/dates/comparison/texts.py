"""A comparison as JSON and as lines for a terminal."""

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from savmap.apps.dates.comparison.elements import LEAN
from savmap.apps.dates.comparison.records import (
    CHANGES,
    Comparison,
    Difference,
    ElementChange,
    RowComparison,
    RowMotion,
    ScaleDifference,
)
from savmap.maps.exports.files import json_text

FORMAT, VERSION = "savmap-comparison", 1
PLACE, CHANCE = 5, 3
"""Decimals of metres, digits of p."""
MM = 1000.0


def comparison_text(comparison: Comparison) -> str:
    """The text of a comparison's JSON file."""
    return json_text(as_json(comparison))


def as_json(comparison: Comparison) -> dict[str, Any]:
    """All of a comparison: rows, their motions, and every element and opening with its state and what was tested."""
    return {
        "format": FORMAT,
        "version": VERSION,
        "level": comparison.level,
        "missing_rows": list(comparison.missing),
        "new_rows": list(comparison.new),
        "failed_rows": list(comparison.failed),
        "maybe_renamed_rows": [list(names) for names in comparison.renamed],
        "rows": [_row(row) for row in comparison.rows],
    }


def _row(row: RowComparison) -> dict[str, Any]:
    return {
        "old": row.old,
        "new": row.new,
        "new_from_old": _motion(row.motion) if row.motion else None,
        "scales": list(map(_scale, row.scales)),
        "elements": list(map(_element, row.elements)),
        "openings": list(map(_element, row.openings)),
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
        "alternatives_m": [round(shift, 3) for shift in motion.alternatives_m],
    }


def _scale(scale: ScaleDifference) -> dict[str, Any]:
    sigmas = {"sigma": scale.sigma, "old_sigma": scale.old_sigma, "new_sigma": scale.new_sigma}
    return {
        "axis": scale.axis,
        "share": round(scale.share, 7),
        **{name: round(value, 7) for name, value in sigmas.items()},
        "p": _digits(scale.p),
        "significant": scale.significant,
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
        "hit": None if change.hit is None else round(change.hit, PLACE),
        "differences": list(map(_difference, change.differences)),
    }


def _difference(difference: Difference) -> dict[str, Any]:
    entry: dict[str, Any] = {"what": difference.what, "old": _value(difference.old), "new": _value(difference.new)}
    if difference.difference_m is not None and difference.sigma_m is not None:
        unit = "permille" if difference.what == LEAN else "m"
        entry |= {f"difference_{unit}": round(difference.difference_m, 6)}
        entry |= {f"sigma_{unit}": round(difference.sigma_m, 6)}
    return {**entry, "p": _digits(difference.p), "significant": difference.significant}


def _rounded(values: Any, decimals: int = PLACE) -> list[float]:
    rounded: list[float] = (np.round(np.asarray(values, np.float64), decimals) + 0.0).tolist()
    return rounded


def _digits(p: float) -> float:
    return float(f"{p:.{CHANCE}g}")


def _value(value: float | str) -> float | str:
    return value if isinstance(value, str) else round(value, PLACE)


def comparison_lines(comparison: Comparison) -> Iterator[str]:
    """How each row's frame and scale lie, a line for each change, and a sum."""
    yield from (f"row {name}: missing" for name in comparison.missing)
    yield from (f"row {name}: new" for name in comparison.new)
    yield from (f"row {name}: cannot be compared, for one of the runs could not map it" for name in comparison.failed)
    yield from renamed_lines(comparison)
    for row in comparison.rows:
        yield f"row {row.new}: {motion_text(row.motion)}"
        yield from (f"  {line}" for line in (*remarks(row), scale_text(row)) if line)
        yield from _table(row.changes)
        yield f"  {counts_text(row)}"
        yield from (f"  {line}" for line in posts_texts(row))


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
    others = ", ".join(f"{shift:+.2f} m" for shift in motion.alternatives_m)
    return f"ambiguous: shifted by {others} it fits as well, and nothing in the row tells which is right"


def renamed_lines(comparison: Comparison) -> Iterator[str]:
    """A line for each missing and new row that may be one."""
    for old, new in comparison.renamed:
        yield f"row {new} looks like row {old} had looked: if it is that row, give it the same name in both site files"


def remarks(row: RowComparison) -> tuple[str, ...]:
    """What a reader must know before the changes: that the frames may lie otherwise, that the scales differ, or that
    little agrees."""
    if row.motion is None:
        return ("check that both maps are of the same place, and the same face of it",)
    said = [ambiguity_text(row.motion)] if row.motion.ambiguous else []
    both = sum(bool(change.old_id and change.new_id) for change in row.elements)
    single = sum(change.state in ("missing", "new") for change in row.elements)
    if both < single:
        said.append(f"only {both} of {both + single} elements are in both maps: check that it is the same place")
    if row.scale_differs:
        said.append(
            "the maps differ in scale by more than their references allow: check camera heights and lengths of both"
        )
    return tuple(said)


def scale_text(row: RowComparison) -> str:
    """By how much more the new map measures along each axis, with standard deviations of what both maps' references
    allow; empty where nothing tells."""
    axes = ", ".join(
        f"{scale.axis} {100 * scale.share:+.2f} % (+- {100 * scale.sigma:.2f} %, {scale.sigmas:.1f} sigma)"
        for scale in row.scales
    )
    return axes and f"scale of the new map against the old one's: {axes}"


def unsaid_text(comparison: Comparison) -> str:
    """Why the comparison cannot say whether anything changed; empty where it can say so of all rows."""
    if not comparison.rows and not comparison.failed:
        return "no row in common, and rows are known by their names"
    if not comparison.compared and not comparison.failed:
        return f"nothing in common was found in row {', '.join(comparison.unknown)}"
    return f"nothing is known of row {', '.join(comparison.unknown)}" if comparison.unknown else ""


def counts_text(row: RowComparison) -> str:
    """How many elements are in which state."""
    counts = Counter(change.state for change in row.elements)
    sizes = Counter(change.state for change in row.openings)
    text = ", ".join(f"{count} {state}" for state, count in sorted(counts.items())) or "no elements"
    return text + (f"; openings: {', '.join(f'{n} {state}' for state, n in sorted(sizes.items()))}" if sizes else "")


def posts_texts(row: RowComparison) -> list[str]:
    """For each label of posts, how many of those that both maps have stand or lean otherwise."""
    posts = [change for change in row.elements if change.is_post]
    lines = []
    for label in dict.fromkeys(change.label for change in posts):
        of_label = [change for change in posts if change.label == label]
        moved = sum(change.hit is not None for change in of_label)
        leans = any(figure.what == LEAN for change in of_label for figure in change.differences)
        unsaid = "" if leans else "; how far they lean is not in both maps"
        lines.append(f"{label}: {moved} of {len(of_label)} stand or lean otherwise than before{unsaid}")
    return lines


def _table(changes: Sequence[ElementChange]) -> Iterator[str]:
    """A line for each change, in columns."""
    cells = [(change.state, change_name(change), change_text(change)) for change in changes]
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
    hit = "" if change.hit is None else f"stands or leans otherwise than before ({100 * change.hit:.1f} % sure): "
    return hit + "; ".join(difference_text(difference) for difference in change.significant)


def difference_text(difference: Difference) -> str:
    """A difference with its standard deviation and chance."""
    if difference.difference_m is None or difference.sigma_m is None:
        return f'{difference.what} "{difference.old}" is "{difference.new}"'
    sure = f"{difference.sigmas:.1f} sigma, p {difference.p:.0e}"
    if difference.what == LEAN:
        return f"lean {difference.difference_m:+.1f} mm in 1 m (+- {difference.sigma_m:.1f}, {sure})"
    by, sigma = MM * difference.difference_m, MM * difference.sigma_m
    return f"{difference.what} {by:+.0f} mm (+- {sigma:.1f} mm, {sure})"
