"""What speaks against rows once they stand in one frame, and which of it a person settled.

A row's own checks cannot see its neighbours: a given place that a row does not fit, landmarks of two rows that do not
fall on one another, a drive that both saw and place differently, a face that was mapped under two names. Where rows
contradict one another nobody can say which is wrong: both are warned of.

Warnings that a person looked at and found wrong become notes: `confirmed` names them by code and subject.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations_with_replacement

import numpy as np

from savmap.assembly.matches import LandmarkMatch
from savmap.assembly.overlap import Overlap
from savmap.graph.site_poses import SitePoses
from savmap.site.model import Confirmed, Pass, Row, pass_names
from savmap.types import CrossRowMatch, MapWarning, Placement, SiteMap, Verdict
from savmap.types.verdicts import by_code

OFF_SIGMA = 4.0
LEAST_OFF_M = 0.05
"""Rows on one drive that are nearer than that are not warned of: its errors are common to the whole path, and their
sigmas are rough."""
MOSTLY = 0.5
"""Two passes are of the same frames where they have more than this share of the shorter one in common."""
MapWarnings = dict[str, list[MapWarning]]
"""MapWarnings by row."""


def placement_warnings(priors: Mapping[str, Placement], poses: SitePoses) -> MapWarnings:
    """A warning for each row that does not stand where the site file says."""
    warnings: MapWarnings = {}
    for name, prior in priors.items():
        place = poses.rows[name]
        heading = (place.heading_deg - prior.heading_deg + 180) % 360 - 180
        off = np.array([place.x_m - prior.x_m, place.z_m - prior.z_m, heading])
        if off @ np.linalg.solve(prior.covariance, off) >= OFF_SIGMA**2:
            size = float(np.hypot(*off[:2]))
            figure = f"{size:.2f} m, {abs(heading):.2f} degrees off"
            details = ("the row stands off its given place, by what it has in common with other rows",)
            warnings[name] = [MapWarning("site-misfit", (f"row {name}",), figure, details=details, size=size)]
    return warnings


def match_warnings(left_out: Sequence[LandmarkMatch], poses: SitePoses) -> MapWarnings:
    """A warning in both rows for each pair of landmarks that was left out, as far off as it is with the others."""
    warnings: MapWarnings = {}
    for match in left_out:
        off = match.residual_text(poses)
        for row, other, landmark, partner in (
            (match.a, match.b, match.in_a, match.in_b),
            (match.b, match.a, match.in_b, match.in_a),
        ):
            name, its = landmark.id, partner.id
            line = f"{name} is row {other}'s {its} by its place, but is {off} off where the rows' other landmarks fit"
            warning = MapWarning(
                "site-misfit",
                (name, f"row {other}"),
                figure=off,
                place=tuple(landmark.place.tolist()),
                details=(line,),
            )
            warnings.setdefault(row, []).append(warning)
    return warnings


def drive_warnings(overlaps: Sequence[Overlap], records: Sequence[CrossRowMatch]) -> MapWarnings:
    """A warning in both rows for each common drive (with its record, in the same order) of which they say different
    things."""
    warnings: MapWarnings = {}
    for overlap, record in zip(overlaps, records, strict=True):
        off, sigmas = np.abs(record.residual_m), np.abs(record.residual_m) / record.sigma_m
        worst = int(np.argmax(np.where(off > LEAST_OFF_M, sigmas, 0.0)))
        if off[worst] <= LEAST_OFF_M or sigmas[worst] < OFF_SIGMA:
            continue
        where = ("along the site's x", "in height", "along the site's z")[worst]
        figure = f"{off[worst]:.2f} m apart {where}, {sigmas[worst]:.0f} sigma"
        for row, other in ((overlap.prior.a, overlap.prior.b), (overlap.prior.b, overlap.prior.a)):
            size = float(off[worst])
            details = (f"rows {row} and {other} put their common drive apart",)
            warning = MapWarning("site-misfit", (f"row {other}",), figure, details=details, size=size)
            warnings.setdefault(row, []).append(warning)
    return warnings


def with_warnings(site_map: SiteMap, *several: MapWarnings) -> SiteMap:
    """The map with warnings in the verdicts of its rows."""
    rows = dict(site_map.rows)
    for warnings in several:
        for name, more in warnings.items():
            verdict = rows[name].verdict or Verdict()
            rows[name] = replace(rows[name], verdict=replace(verdict, warnings=(*verdict.warnings, *more)))
    return replace(site_map, rows=rows)


def same_face_warnings(rows: Mapping[str, Row]) -> dict[str, list[MapWarning]]:
    """By row, a warning for each other row that looks at the same face."""
    warnings: dict[str, list[MapWarning]] = {}
    for first, second, line in rows_with_same_face(rows):
        for name, other in ((first, second), (second, first)):
            warning = MapWarning("site-misfit", (f"row {other}",), details=(line,))
            warnings.setdefault(name, []).append(warning)
    return warnings


def rows_with_same_face(rows: Mapping[str, Row]) -> Iterator[tuple[str, str, str]]:
    """The names of two rows that look at the same face, or twice that of one whose passes do, and what to tell of them
    in one line."""
    for (first, row), (second, other) in combinations_with_replacement(rows.items(), 2):
        for number, (name, row_pass) in enumerate(zip(pass_names(row.passes), row.passes, strict=True), 1):
            others = other.passes if first != second else row.passes[number:]
            if any(_is_same_face(row_pass, other_pass) for other_pass in others):
                sides = f"both to the {row_pass.side}" if row_pass.side else "and neither has a `side`"
                who = f"rows {first} and {second} look" if first != second else f"two passes of row {first} look"
                frames = f"{who} at the same frames ({first}, {name}), {sides}: one face would be mapped twice"
                yield first, second, f"{frames}; correct the `side` of one"
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
class Settled:
    """A map in whose verdicts what was confirmed is a note, and lines, one for each subject that nothing warns of."""

    site_map: SiteMap
    unused: tuple[str, ...]


def with_confirmed(site_map: SiteMap, confirmed: Mapping[str, Sequence[Confirmed]]) -> Settled:
    """The map, where warnings of its rows are notes that are `confirmed`, by row name; the others are one a code."""
    rows, unused = dict(site_map.rows), list[str]()
    for name, row in site_map.rows.items():
        if row.verdict is None:
            continue
        looked_at = [(entry.code, subject) for entry in confirmed.get(name, ()) for subject in entry.subjects]
        left, settled = [], set[tuple[str, str]]()
        for warning in row.verdict.warnings:
            of_warning = {(warning.code, subject) for subject in warning.subjects} & {*looked_at}
            settled |= of_warning
            subjects = tuple(subject for subject in warning.subjects if (warning.code, subject) not in of_warning)
            left += [replace(warning, subjects=subjects)] if subjects or not warning.subjects else []
        notes = (
            f"confirmed in the site file: {code}, {subject}"
            for code, subject in looked_at
            if (code, subject) in settled
        )
        rows[name] = replace(row, verdict=Verdict(by_code(left), (*row.verdict.notes, *notes)))
        unused += (
            f"row {name}: `confirmed` has what nothing warns of now: {code}, {subject}"
            for code, subject in looked_at
            if (code, subject) not in settled
        )
    return Settled(replace(site_map, rows=rows), tuple(unused))
