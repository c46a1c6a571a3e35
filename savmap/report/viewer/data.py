"""A map as the viewer's page holds it. `source/site/data.js` reads it."""

import base64
from collections.abc import Callable, Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from savmap.errors import visible
from savmap.maps.exports.frames import alignment_of
from savmap.report.viewer.dates import Before, gone_entry, row_entry, site_entry
from savmap.report.viewer.gone import old_place
from savmap.report.viewer.packed import (
    UPPER,
    Entry,
    Labels,
    Places,
    digits,
    path_entry,
    place_entries,
    structure_entries,
    vertex_entry,
)
from savmap.types import Alignment, Doubt, Evaluation, JointCovariance, Placement, RowMap, SiteMap, Trajectory

NOWHERE = Trajectory(np.zeros(0, np.int64), np.zeros((0, 4, 4)))


def page_data(
    site_map: SiteMap,
    title: str,
    evaluation: Evaluation | None,
    beside: Mapping[str, Entry],
    before: Before | None = None,
    places: Places = MappingProxyType({}),
) -> Entry:
    """All that the page shows, for JSON. `beside`: by row, what lies beside the page:
    "face", "old face", "stills" and "joint". `before`: an earlier date. `places`: whose sizes are shown."""
    labels: Labels = {}
    rows = []
    for name, row in site_map.rows.items():
        lies = beside.get(name, {})
        entry = _row(row, site_map.placements.get(name), lies.get("joint", ""))
        entry["structures"] = structure_entries(row, labels, _deviations(evaluation, name))
        entry |= {"face": lies.get("face"), "stills": lies.get("stills", []), "aligned": _is_aligned(site_map, name)}
        entry["places"] = place_entries(places.get(name, {}))
        entry["before"] = row_entry(before, row, labels, lies) if before else None
        rows.append(entry)
    if before:
        rows += [_gone(row, before, site_map, labels, beside.get(row.name, {})) for row in before.missing]
    return {
        "title": visible(title),
        "banner": visible(site_map.banner),
        "surveyed": evaluation is not None,
        "rows": rows,
        "vertex_labels": list(labels),
        "alignment": _alignment(site_map.alignment),
        "dates": site_entry(before),
    }


def _gone(row: RowMap, before: Before, site_map: SiteMap, labels: Labels, lies: Entry) -> Entry:
    """A row that only the earlier map has: nothing of the new date, where the earlier map says that it stood."""
    nothing = replace(row, structures={}, verdict=None, joint=None, trajectory=NOWHERE)
    entry = _row(nothing, old_place(before, site_map, row.name), "")
    entry |= {"structures": [], "face": None, "stills": [], "aligned": False, "places": [], "gone": True}
    return entry | {"before": gone_entry(row, labels, lies)}


def _deviations(evaluation: Evaluation | None, row: str) -> Callable[[str], Mapping[str, float]]:
    return lambda plugin: evaluation.deviations_of(row, plugin) if evaluation else {}


def _is_aligned(site_map: SiteMap, row: str) -> bool:
    """Whether it is known where in the user's world the row stands."""
    placed = row in site_map.placements or len(site_map.rows) + len(site_map.failed) == 1
    return placed and alignment_of(site_map, row) is not None


def _alignment(alignment: Alignment | None) -> Entry | None:
    if alignment is None:
        return None
    return {
        "place": [alignment.x_m, alignment.y_m, alignment.z_m, alignment.heading_deg],
        "covariance": digits(alignment.covariance[UPPER]),
        "anchor": alignment.anchor and list(alignment.anchor),
    }


def _row(row: RowMap, placement: Placement | None, joint_path: str) -> Entry:
    return {
        "name": visible(row.name),
        "placement": placement and [placement.x_m, placement.z_m, placement.heading_deg],
        "placement_covariance": placement and digits(placement.covariance[UPPER]),
        "grade": row.verdict and row.verdict.grade,
        "doubts": [_doubt(doubt) for doubt in row.verdict.doubts] if row.verdict else [],
        "remarks": [visible(note) for note in row.verdict.notes] if row.verdict else [],
        **vertex_entry(row.structures),
        "joint": _joint(row, joint_path),
        "frames": _frames(row),
    }


def _doubt(doubt: Doubt) -> Entry:
    named = [visible(name) for name in doubt.structures]
    place = None if doubt.place is None else list(doubt.place)
    return {
        "kind": doubt.kind,
        "headline": visible(doubt.headline),
        "figure": visible(doubt.figure),
        "action": visible(doubt.action),
        "details": [visible(line) for line in doubt.details],
        "of_row": doubt.of_row,
        "structures": named,
        "place": place,
        "frame": doubt.frame,
    }


def _frames(row: RowMap) -> Entry:
    poses = row.trajectory.world_from_rig
    return path_entry(row, poses[:, :3, 3], poses[:, :3, :3], np.ones(len(poses), bool))


def _joint(row: RowMap, path: str) -> Entry | None:
    """Which coordinates, in the order of `positions`, share errors, -1 for those that share none; their covariance is
    in the page, or, where a path is given, in a script beside it."""
    if row.joint is None:
        return None
    numbers = [
        row.joint.coordinates.get(plugin, {}).get(structure.id, np.full((len(structure.vertices), 3), -1))
        for plugin, group in row.structures.items()
        for structure in group
    ]
    coordinates = np.concatenate(numbers).ravel().tolist() if numbers else []
    kept = {"path": path} if path else {"covariance": joint_text(row.joint)}
    return {"size": len(row.joint.covariance), "coordinates": coordinates, **kept}


def joint_text(joint: JointCovariance) -> str:
    """The upper triangle of a joint covariance, row by row: little-endian single precision as base64."""
    triangle = joint.covariance[np.triu_indices(len(joint.covariance))].astype("<f4")
    return base64.b64encode(triangle.tobytes()).decode("ascii")
