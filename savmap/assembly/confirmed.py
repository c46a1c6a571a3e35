"""Doubts that a person looked at and found wrong: the row is as it was mapped, and they become notes.

A doubt is named by its own line: headline, figure and action. So a line confirms what was looked at and nothing else:
where the map has changed, and the words with it, the doubt is back.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from savmap.types import Doubt, SiteMap, Verdict
from savmap.types.verdicts import by_cause

NEAR = 0.1
"""Figures with decimals may differ by that share: mapping again, or elsewhere, changes the last digits. Whole numbers,
which count or name things, may not."""
KINDS = ("shape", "support")
"""What a person can tell by looking: whether a structure is there, and is what it is taken for. Not whether it was
measured well."""
_FIGURE = re.compile(r"-?\d+\.\d+")


@dataclass(frozen=True)
class Confirmed:
    """A map in whose verdicts what was confirmed is a note, and lines, one for each that confirmed nothing."""

    site_map: SiteMap
    unused: tuple[str, ...]


def with_confirmed(site_map: SiteMap, lines: Mapping[str, Sequence[str]]) -> Confirmed:
    """The map, where doubts of its rows that `lines` by row name are notes: those of `KINDS` that have structures or a
    place. The others of one cause are one doubt, which a line of its own may settle."""
    rows, unused = dict(site_map.rows), list[str]()
    for name, row in site_map.rows.items():
        if row.verdict is None:
            continue
        of_row = lines.get(name, ())
        first = _settled(row.verdict, of_row)
        together = replace(first, doubts=by_cause(first.doubts))
        rows[name] = replace(row, verdict=_settled(together, of_row))
        doubts = (*row.verdict.doubts, *together.doubts)
        unused += (f"row {name}: {why}" for why in _without_effect(doubts, of_row))
    return Confirmed(replace(site_map, rows=rows), tuple(sorted(unused)))


def means(line: str, doubt: Doubt) -> bool:
    """Whether a line is a doubt's own words, with or without its kind before them."""
    said, words = " ".join(line.split()).removeprefix(f"{doubt.kind}: "), " ".join(doubt.line.split())
    figures = [[float(figure) for figure in _FIGURE.findall(text)] for text in (said, words)]
    same_words = _FIGURE.sub("", said) == _FIGURE.sub("", words)
    return same_words and all(abs(a - b) <= NEAR * abs(b) for a, b in zip(*figures, strict=True))


def _settled(verdict: Verdict, lines: Sequence[str]) -> Verdict:
    settled = [doubt for doubt in verdict.doubts if _can_be_seen(doubt) and any(means(line, doubt) for line in lines)]
    kept = tuple(doubt for doubt in verdict.doubts if doubt not in settled)
    notes = (*verdict.notes, *(f"confirmed in the site file: {doubt.line}" for doubt in settled))
    return Verdict(kept, notes)


def _without_effect(doubts: Sequence[Doubt], lines: Sequence[str]) -> Iterator[str]:
    for line in lines:
        meant = [doubt for doubt in doubts if means(line, doubt)]
        if not meant:
            yield f"`confirmed` has a line that no doubt says now: {line}"
        elif not any(_can_be_seen(doubt) for doubt in meant):
            yield f"`confirmed` cannot settle this, which no look at the pictures tells: {line}"


def _can_be_seen(doubt: Doubt) -> bool:
    return doubt.kind in KINDS and (bool(doubt.structures) or doubt.place is not None)
