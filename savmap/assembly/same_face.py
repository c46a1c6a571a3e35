"""Rows that look at one face: at the same part of a video, to the same side. One was copied from the other and not put
right."""

from collections.abc import Iterator, Mapping
from itertools import combinations

from savmap.site.model import Pass, Row, pass_names
from savmap.types import Doubt

MOSTLY = 0.5
"""Two passes are of the same frames where they have more than this share of the shorter one in common."""


def same_face_doubts(rows: Mapping[str, Row]) -> dict[str, list[Doubt]]:
    """By row, a doubt for each other row that looks at the same face."""
    doubts: dict[str, list[Doubt]] = {}
    for first, second, line in rows_with_same_face(rows):
        action = f"correct the `side` of one: row {first} or {second}"
        for name in (first, second):
            doubt = Doubt("site", "two rows look at the same face", action=action, details=(line,))
            doubts.setdefault(name, []).append(doubt)
    return doubts


def rows_with_same_face(rows: Mapping[str, Row]) -> Iterator[tuple[str, str, str]]:
    """The names of two rows that look at the same face, and what to tell of them in one line."""
    for (first, one), (second, other) in combinations(rows.items(), 2):
        for name, own in zip(pass_names(one.passes), one.passes, strict=True):
            if any(_is_same_face(own, another) for another in other.passes):
                sides = f"both to the {own.side}" if own.side else "and neither has a `side`"
                what = f"rows {first} and {second} look at the same frames ({first}, {name}), {sides}: is one face mapped twice? Correct the `side` of one"
                yield first, second, what
                break


def _is_same_face(one: Pass, other: Pass) -> bool:
    """Whether two passes are mostly of the same frames and look at them in the same way."""
    if (one.video, one.side, one.views) != (other.video, other.side, other.views):
        return False
    begin, end = max(one.start_s, other.start_s), min(_end_s(one), _end_s(other))
    shorter = min(_end_s(one) - one.start_s, _end_s(other) - other.start_s)
    return end > begin and (end == float("inf") or end - begin > MOSTLY * shorter)


def _end_s(row_pass: Pass) -> float:
    return float("inf") if row_pass.end_s is None else row_pass.end_s
