"""What speaks against rows once they stand in one frame, and which of it a person settled.

A row's own checks cannot see its neighbours: a given place that a row does not fit, landmarks of two rows that do not
fall on one another, a drive that both saw and place differently, a face that was mapped under two names. Where rows
contradict one another nobody can say which is wrong: both are doubted.

Doubts that a person checked and found wrong become notes. A doubt is named by its own line: headline, figure and
action. So a line confirms what was checked and nothing else: where the map has changed, and the words with it, the
doubt is back.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from savmap.assembly.matches import LandmarkMatch
from savmap.assembly.overlap import Overlap
from savmap.graph.site_poses import SitePoses
from savmap.site.model import Pass, Row, pass_names
from savmap.types import CrossRowMatch, Doubt, Placement, SiteMap, Verdict
from savmap.types.verdicts import by_cause

OFF_SIGMA = 4.0
LEAST_OFF_M = 0.05
"""Rows on one drive that are nearer than that are not doubted: its errors are common to the whole path, and their
sigmas are rough."""
MOSTLY = 0.5
"""Two passes are of the same frames where they have more than this share of the shorter one in common."""
NEAR = 0.1
"""Figures with decimals may differ by that share: mapping again, or elsewhere, changes the last digits. Whole numbers,
which count or name elements, may not."""
KINDS = ("shape", "support")
"""What a person can tell from the pictures: whether a structure exists, and is what it is taken for. Not whether it was
measured well."""
_FIGURE = re.compile(r"-?\d+\.\d+")

Doubts = dict[str, list[Doubt]]
"""Doubts by row."""


def placement_doubts(priors: Mapping[str, Placement], poses: SitePoses) -> Doubts:
    """A doubt for each row that does not stand where the site file says."""
    return {name: [doubt] for name, prior in priors.items() if (doubt := _off_prior(name, prior, poses))}


def match_doubts(left_out: Sequence[LandmarkMatch], poses: SitePoses) -> Doubts:
    """A doubt in both rows for each pair of landmarks that was left out, as far off as it is with the others."""
    doubts: Doubts = {}
    for match in left_out:
        off = match.residual_text(poses)
        for row, other, landmark, partner in (
            (match.a, match.b, match.in_a, match.in_b),
            (match.b, match.a, match.in_b, match.in_a),
        ):
            name, its = landmark.id, partner.id
            line = f"{name} is row {other}'s {its} by its place, but is {off} off where the rows' other landmarks fit"
            doubt = Doubt(
                "site",
                "two rows put a landmark apart",
                structures=(name,),
                place=tuple(landmark.place.tolist()),
                figure=off,
                action=f"look which of them is wrong: {name}, or {its} of row {other}",
                details=(line,),
            )
            doubts.setdefault(row, []).append(doubt)
    return doubts


def drive_doubts(overlaps: Sequence[Overlap], records: Sequence[CrossRowMatch]) -> Doubts:
    """A doubt in both rows for each common drive (with its record, in the same order) of which they say different
    things."""
    doubts: Doubts = {}
    for overlap, record in zip(overlaps, records, strict=True):
        off, sigmas = np.abs(record.residual_m), np.abs(record.residual_m) / record.sigma_m
        worst = int(np.argmax(np.where(off > LEAST_OFF_M, sigmas, 0.0)))
        if off[worst] <= LEAST_OFF_M or sigmas[worst] < OFF_SIGMA:
            continue
        where = ("along the site's x", "in height", "along the site's z")[worst]
        figure = f"{off[worst]:.2f} m apart {where}, {sigmas[worst]:.0f} sigma"
        for row, other in ((overlap.prior.a, overlap.prior.b), (overlap.prior.b, overlap.prior.a)):
            action = f"check the references and places of these rows: {row}, {other}"
            doubt = Doubt("site", "two rows put their common drive apart", figure=figure, action=action)
            doubts.setdefault(row, []).append(doubt)
    return doubts


def with_doubts(site_map: SiteMap, *several: Doubts) -> SiteMap:
    """The map with doubts in the verdicts of its rows."""
    rows = dict(site_map.rows)
    for doubts in several:
        for name, more in doubts.items():
            verdict = rows[name].verdict or Verdict()
            rows[name] = replace(rows[name], verdict=replace(verdict, doubts=(*verdict.doubts, *more)))
    return replace(site_map, rows=rows)


def _off_prior(name: str, prior: Placement, poses: SitePoses) -> Doubt | None:
    """A doubt about a row that does not stand where it was given."""
    place = poses.rows[name]
    heading = (place.heading_deg - prior.heading_deg + 180) % 360 - 180
    off = np.array([place.x_m - prior.x_m, place.z_m - prior.z_m, heading])
    if off @ np.linalg.solve(prior.covariance, off) < OFF_SIGMA**2:
        return None
    figure = f"{np.hypot(*off[:2]):.2f} m, {abs(heading):.2f} degrees off"
    details = ("by what it has in common with other rows",)
    what = "the row stands off its given place"
    return Doubt("site", what, figure=figure, action=f"check the place given for row: {name}", details=details)


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
    for (first, row), (second, other) in combinations(rows.items(), 2):
        for name, row_pass in zip(pass_names(row.passes), row.passes, strict=True):
            if any(_is_same_face(row_pass, other_pass) for other_pass in other.passes):
                sides = f"both to the {row_pass.side}" if row_pass.side else "and neither has a `side`"
                frames = f"rows {first} and {second} look at the same frames ({first}, {name}), {sides}"
                yield first, second, f"{frames}: is one face mapped twice? Correct the `side` of one"
                break


def _is_same_face(first: Pass, second: Pass) -> bool:
    """Whether two passes are mostly of the same frames and look at them in the same way."""
    if (first.video, first.side, first.views) != (second.video, second.side, second.views):
        return False
    begin, end = max(first.start_s, second.start_s), min(_end_s(first), _end_s(second))
    shorter = min(_end_s(first) - first.start_s, _end_s(second) - second.start_s)
    return end > begin and (end == float("inf") or end - begin > MOSTLY * shorter)


def _end_s(row_pass: Pass) -> float:
    return float("inf") if row_pass.end_s is None else row_pass.end_s


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
