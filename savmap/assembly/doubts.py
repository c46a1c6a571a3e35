"""What speaks against rows once they stand in one frame: a given place that they do not fit, landmarks of two rows that
do not fall on one another, and a drive that both saw and place differently.

A row's own checks cannot see its neighbours. Where rows contradict one another nobody can say which is wrong: both are
doubted.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from savmap.assembly.matches import LandmarkMatch
from savmap.assembly.overlap import Overlap
from savmap.graph.site_poses import SitePoses
from savmap.types import CrossRowMatch, Doubt, Placement, RowMap, SiteMap, Verdict

OFF_SIGMA = 4.0
LEAST_OFF_M = 0.05
"""Rows on one drive that are nearer than that are not doubted: its errors are common to the whole path, and their
sigmas are rough."""

Doubts = dict[str, list[Doubt]]
"""Doubts by row."""


def placement_doubts(known: Mapping[str, Placement], poses: SitePoses) -> Doubts:
    """A doubt for each row that does not stand where the site file says."""
    return {name: [doubt] for name, prior in known.items() if (doubt := _off_prior(name, prior, poses))}


def match_doubts(left_out: Sequence[LandmarkMatch], poses: SitePoses) -> Doubts:
    """A doubt in both rows for each pair of landmarks that was left out, as far off as it is with the others."""
    doubts: Doubts = {}
    for match in left_out:
        off = match.residual_text(poses)
        for row, other, own, its in (
            (match.a, match.b, match.in_a, match.in_b),
            (match.b, match.a, match.in_b, match.in_a),
        ):
            line = (
                f"{own.id} is row {other}'s {its.id} by its place, but is {off} off where the rows' other landmarks fit"
            )
            x, y, z = (float(value) for value in own.place)
            action = f"look which of them is wrong: {own.id}, or {its.id} of row {other}"
            doubt = Doubt(
                "site", "two rows put a landmark apart", (own.id,), (x, y, z), None, False, off, action, (line,)
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


def with_doubts(site_map: SiteMap, *found: Doubts) -> SiteMap:
    """The map with doubts in the verdicts of its rows."""
    rows = dict(site_map.rows)
    for doubts in found:
        for name, more in doubts.items():
            rows[name] = _doubted(rows[name], more)
    return replace(site_map, rows=rows)


def _doubted(row: RowMap, more: Sequence[Doubt]) -> RowMap:
    verdict = row.verdict or Verdict()
    return replace(row, verdict=replace(verdict, doubts=(*verdict.doubts, *more)))


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
