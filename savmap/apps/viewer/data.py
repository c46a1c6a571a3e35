"""A map as the viewer's page holds it: coordinates as whole numbers, covariances to so many digits, everything else as
it is; and an earlier date under it. `source/site/data.js` reads it."""

import base64
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from savmap.apps.dates.comparison.records import (
    CHANGES,
    Comparison,
    Difference,
    ElementChange,
    RowComparison,
    RowMotion,
)
from savmap.errors import visible
from savmap.maps.exports.frames import alignment_of
from savmap.maps.search import PART
from savmap.types import (
    Alignment,
    Attribute,
    Bools,
    Evaluation,
    Floats,
    JointCovariance,
    MapWarning,
    Measured,
    Orthophoto,
    Placement,
    RowMap,
    SiteMap,
    Structure,
    Trajectory,
)

Entry = dict[str, Any]
Places = Mapping[str, Mapping[str, Sequence[Structure]]]
"""Places between structures, by row and plugin."""
Labels = dict[str, int]
"""What vertices are called, and the number that stands for it."""
UNIT_M = 1e-5
DIGITS = 4
"""Of a variance: a standard deviation, which is shown with two, is right to a 40,000th."""
UPPER = np.triu_indices(3)
TURN = 6
"""Decimals of a quaternion: 0.1 pixel of a panorama of 2048."""


def vertex_entry(structures: Mapping[str, Sequence[Structure]]) -> Entry:
    """The places and covariances of all vertices, one after the other."""
    every = [structure for group in structures.values() for structure in group]
    return {
        "positions": units([structure.vertices for structure in every]),
        "covariances": digits(_stacked([structure.covariances[:, *UPPER] for structure in every])),
    }


def path_entry(row: RowMap, centres: Floats, turns: Floats, kept: Bools) -> Entry:
    """The camera's path, or what of it is kept (n,), in order: frames whose pose is known, with their places `centres`
    (n, 3) m and `turns` (n, 3, 3)."""
    frames, names = row.trajectory.frames[kept], list(dict.fromkeys(row.frames.passes))
    quaternions = Rotation.from_matrix(turns[kept]).as_quat() if len(frames) else np.zeros((0, 4))
    return {
        "number": frames.tolist(),
        "pass": [names.index(row.frames.passes[frame]) for frame in frames.tolist()],
        "passes": [visible(name) for name in names],
        "stamp": np.round(row.frames.stamps_s[frames], 3).tolist(),
        "position": units([centres[kept]]),
        "quaternion": np.round(quaternions, TURN).ravel().tolist(),
    }


def structure_entries(
    row: RowMap, labels: Labels, deviations: Callable[[str], Mapping[str, float]] = lambda plugin: {}
) -> list[Entry]:
    """All else of a row's structures, in the order of their vertices. `deviations`: by id, how far a plugin's are off
    the survey, m."""
    return [
        _structure(plugin, structure, labels, deviations(plugin))
        | {"assumed": np.flatnonzero(structure.assumed(plugin, row.joint)).tolist()}
        for plugin, group in row.structures.items()
        for structure in group
    ]


def place_entries(places: Mapping[str, Sequence[Structure]]) -> list[Entry]:
    """A row's places, each with its two corners and its sizes: of a part of a place, such as "bay 2 / level 1", those
    that the whole has not."""
    by_id = {(plugin, place.id): place for plugin, group in places.items() for place in group}
    entries = []
    for (plugin, name), place in by_id.items():
        whole = by_id.get((plugin, name.rpartition(PART)[0]))
        of_whole = _sizes(whole) if whole else {}
        sizes = {what: size for what, size in _sizes(place).items() if what not in of_whole}
        corners = units([place.vertices.min(axis=0), place.vertices.max(axis=0)])
        entries.append({"id": visible(name), "sizes": sizes, "corners": corners})
    return entries


def _sizes(place: Structure) -> Entry:
    return {visible(name): [round(value, 5), *digits(np.array([sigma]))] for name, value, sigma in place.sizes()}


def _structure(plugin: str, structure: Structure, labels: Labels, deviations: Mapping[str, float]) -> Entry:
    solid = structure.solid
    # "+" and what follows the structure's id, where a label begins with that: such endings are few
    whole, texts = structure.id, structure.vertex_labels
    shortened = (f"+{visible(s.removeprefix(whole))}" if s.startswith(whole) else f"={visible(s)}" for s in texts)
    return {
        "plugin": visible(plugin),
        "id": visible(structure.id),
        "label": visible(structure.label),
        "attributes": {visible(name): _attribute(value) for name, value in structure.attributes.items()},
        "labels": [labels.setdefault(label, len(labels)) for label in shortened],
        "edges": structure.edges.ravel().tolist(),
        "solid": solid and {name: np.round(getattr(solid, name), 5).tolist() for name in ("outline", "depth")},
        "off": _off(deviations.get(structure.id)),
    }


def _attribute(value: Attribute) -> Entry | float | int | str:
    if isinstance(value, Measured):
        return {"value": value.value, "sigma": value.sigma}
    return visible(value) if isinstance(value, str) else value


def _off(deviation: float | None) -> float | str | None:
    """How far a structure is off the survey, m; "spurious" where that has none there; None where nobody compared it."""
    if deviation is None or np.isnan(deviation):
        return None
    return round(float(deviation), 5) if np.isfinite(deviation) else "spurious"


def units(places: Sequence[Floats]) -> list[int]:
    """The coordinates of places, each (n, 3) m, as whole numbers of `UNIT_M`."""
    whole: list[int] = np.round(np.ravel(_stacked(places)) / UNIT_M).astype(np.int64).tolist()
    return whole


def digits(values: Floats) -> list[float]:
    """Numbers in a row, to so many digits."""
    return [float(f"{value:.{DIGITS}g}") for value in np.ravel(values)]


def _stacked(parts: Sequence[Floats]) -> Floats:
    return np.concatenate(parts) if parts else np.zeros((0, 3))


@dataclass(frozen=True, eq=False)
class Before:
    """An earlier map of the same place, what changed since then, its orthophotos by row, where there are any, and the
    folder in which its own page would lie, for its panoramas."""

    site_map: SiteMap
    comparison: Comparison
    photos: Mapping[str, Orthophoto] = field(default_factory=dict)
    folder: Path | None = None

    @property
    def missing(self) -> tuple[RowMap, ...]:
        """The rows that only the earlier map has."""
        return tuple(self.site_map.rows[name] for name in self.comparison.missing)

    def is_shown(self, name: str) -> bool:
        """Whether it is known how the earlier date of a row lies: in the new row, or, of one that is gone, by
        itself."""
        row = self.row(name)
        return name in self.comparison.missing or (row is not None and row.motion is not None)

    def row(self, name: str) -> RowComparison | None:
        """A row of the new map on both dates; None where the earlier map has it not."""
        return next((row for row in self.comparison.rows if row.new == name), None)

    def photo(self, name: str) -> Orthophoto | None:
        """The earlier orthophoto of a row, where it is known how it lies there. Rows are known by their names."""
        return self.photos.get(name) if self.is_shown(name) else None


def row_entry(before: Before, row: RowMap, labels: Labels, lies: Entry) -> Entry | None:
    """The earlier date of a row, in the new one's frame; None where there is none. `lies`: what lies beside the page,
    "old face" in its own frame."""
    compared = before.row(row.name)
    if compared is None or compared.motion is None:
        return None
    motion, old = compared.motion, before.site_map.rows[compared.old]
    carried = {
        plugin: tuple(_carried(structure, motion) for structure in group) for plugin, group in old.structures.items()
    }
    numbers = _numbers(carried), _numbers(row.structures)
    face, poses = lies.get("old face"), old.trajectory.world_from_rig
    in_new = replace(old, structures=carried)
    return {
        **_old_entry(in_new, labels, lies, motion.points(poses[:, :3, 3]), _turn(motion) @ poses[:, :3, :3]),
        "face": face and carried_face(face, motion),
        "motion": _motion(motion),
        "changes": [_change(change, *numbers) for change in compared.elements],
        "openings": [_opening(change) for change in compared.openings if change.state in CHANGES],
    }


def _old_entry(row: RowMap, labels: Labels, lies: Entry, centres: Floats, turns: Floats) -> Entry:
    """An earlier row of which nothing was compared: its structures, its panoramas, and of the camera's path the places
    from which they were taken, (n, 3) m and (n, 3, 3), in the frame that is shown."""
    stills = lies.get("old stills", [])
    kept = np.isin(row.trajectory.frames, [still["frame"] for still in stills])
    return {
        **vertex_entry(row.structures),
        "structures": structure_entries(row, labels),
        "face": lies.get("old face"),
        "stills": stills,
        "frames": path_entry(row, centres, turns, kept),
        "motion": None,
        "changes": [],
        "openings": [],
    }


def carried_face(face: Entry, motion: RowMotion) -> Entry:
    """An old orthophoto's place in the new row's frame."""
    right, up = (np.array(face[name]) * face[size] for name, size in (("right", "width_m"), ("up", "height_m")))
    origin = np.array(face["origin_m"])
    corner, right_end, upper_end = motion.points(np.array([origin, origin + right, origin + up]))
    width, height = float(np.linalg.norm(right_end - corner)), float(np.linalg.norm(upper_end - corner))
    return {
        **face,
        "origin_m": np.round(corner, 6).tolist(),
        "right": ((right_end - corner) / width).tolist(),
        "up": ((upper_end - corner) / height).tolist(),
        "width_m": width,
        "height_m": height,
    }


def _carried(structure: Structure, motion: RowMotion) -> Structure:
    """A structure in the new row's frame; of its own covariances, for how the frames lie is a figure of the row."""
    turn = _turn(motion)
    solid = structure.solid and replace(
        structure.solid,
        outline=motion.points(structure.solid.outline),
        depth=turn @ structure.solid.depth,
    )
    covariances = turn @ structure.covariances @ turn.T
    return replace(structure, vertices=motion.points(structure.vertices), covariances=covariances, solid=solid)


def _turn(motion: RowMotion) -> Floats:
    """Rotation (3, 3)."""
    ends = motion.points(np.vstack([np.zeros(3), np.eye(3)]))
    axes = (ends[1:] - ends[0]).T
    turn: Floats = axes / np.linalg.norm(axes, axis=0)
    return turn


def _numbers(structures: Mapping[str, Sequence[Structure]]) -> dict[tuple[str, str], int]:
    """The place of each structure, by plugin and id, in the order of the page."""
    keys = [(plugin, structure.id) for plugin, group in structures.items() for structure in group]
    return {key: number for number, key in enumerate(keys)}


def _motion(motion: RowMotion) -> Entry:
    return {
        "shift_m": np.round(motion.shift_m, 5).tolist(),
        "sigma_m": np.round(np.sqrt(np.diag(motion.shift_covariance)), 5).tolist(),
        "heading_deg": round(motion.heading_deg, 4),
        "pairs": motion.pairs,
        "alternatives_m": [round(shift, 3) for shift in motion.alternatives_m],
    }


def _change(change: ElementChange, old: Mapping[tuple[str, str], int], new: Mapping[tuple[str, str], int]) -> Entry:
    """An element: its state, its numbers on both dates (None: not there), and all that was tested."""
    return {
        "state": change.state,
        "old": None if change.old_id is None else old[change.plugin, change.old_id],
        "new": None if change.new_id is None else new[change.plugin, change.new_id],
        "tested": [_difference(difference) for difference in change.differences],
    }


def _opening(change: ElementChange) -> Entry:
    return {
        "state": change.state,
        "name": visible(change.name),
        "place": np.round(change.position_m, 4).tolist(),
        "tested": [_difference(difference) for difference in change.differences],
    }


def _difference(difference: Difference) -> list[str | int]:
    """What, the difference and its standard deviation in `UNIT_M`, or both texts, and 1 where it is significant."""
    significant = int(difference.significant)
    if difference.difference_m is None or difference.sigma_m is None:
        return [difference.what, visible(str(difference.old)), visible(str(difference.new)), significant]
    return [difference.what, round(difference.difference_m / UNIT_M), round(difference.sigma_m / UNIT_M), significant]


def old_place(before: Before, site_map: SiteMap, name: str) -> Placement | None:
    """Of a row of the earlier map: carried as the nearest row is that has its place on both dates. None where none has,
    or the row itself has no place. `covariance` is the earlier map's: how well the dates' sites lie on one another is
    not in it."""
    places = before.site_map.placements
    place = places.get(name)
    both = [
        row
        for row in before.comparison.rows
        if row.motion and row.old in places and row.new in site_map.placements and not row.motion.ambiguous
    ]
    if place is None or not both:
        return None
    nearest = min(both, key=lambda row: np.hypot(place.x_m - places[row.old].x_m, place.z_m - places[row.old].z_m))
    assert nearest.motion is not None
    old, new = places[nearest.old], site_map.placements[nearest.new]
    # the frame's origin and a point on its x axis, seen from the nearest row
    ends = place.points(np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]))
    in_nearest = (ends - old.site_from_row[:3, 3]) @ old.site_from_row[:3, :3]
    begin, end = new.points(nearest.motion.points(in_nearest))
    along: Floats = end - begin
    heading = float(np.degrees(np.arctan2(-along[2], along[0])))
    return Placement(float(begin[0]), float(begin[2]), heading, place.covariance)


NOWHERE = Trajectory(np.zeros(0, np.int64), np.zeros((0, 4, 4)))


def page_data(
    site_map: SiteMap,
    title: str,
    evaluation: Evaluation | None,
    files: Mapping[str, Entry],
    before: Before | None = None,
    places: Places = MappingProxyType({}),
) -> Entry:
    """All that the page shows, for JSON. `files`: by row, what lies beside the page:
    "face", "old face", "stills" and "joint". `before`: an earlier date. `places`: whose sizes are shown."""
    labels: Labels = {}
    rows = []
    for name, row in site_map.rows.items():
        lies = files.get(name, {})
        entry = _row(row, site_map.placements.get(name), lies.get("joint", ""))
        entry["structures"] = structure_entries(row, labels, _deviations(evaluation, name))
        placed = name in site_map.placements or len(site_map.rows) + len(site_map.failed) == 1
        aligned = placed and alignment_of(site_map, name) is not None
        entry |= {"face": lies.get("face"), "stills": lies.get("stills", []), "aligned": aligned}
        entry["places"] = place_entries(places.get(name, {}))
        entry["before"] = row_entry(before, row, labels, lies) if before else None
        rows.append(entry)
    dates: Entry | None = None
    if before:
        level, names = before.comparison.level, {"missing": before.comparison.missing, "new": before.comparison.new}
        dates = {"level": level, **{what: list(map(visible, rows_of)) for what, rows_of in names.items()}}
        rows += [_missing_row(row, before, site_map, labels, files.get(row.name, {})) for row in before.missing]
    return {
        "title": visible(title),
        "banner": visible(site_map.banner),
        "surveyed": evaluation is not None,
        "rows": rows,
        "vertex_labels": list(labels),
        "alignment": _alignment(site_map.alignment),
        "dates": dates,
    }


def _missing_row(row: RowMap, before: Before, site_map: SiteMap, labels: Labels, lies: Entry) -> Entry:
    """A row that only the earlier map has, in its own frame: nothing of the new date, where the earlier map says that
    it stood."""
    nothing = replace(row, structures={}, verdict=None, joint=None, trajectory=NOWHERE)
    entry = _row(nothing, old_place(before, site_map, row.name), "")
    entry |= {"structures": [], "face": None, "stills": [], "aligned": False, "places": [], "gone": True}
    poses = row.trajectory.world_from_rig
    return entry | {"before": _old_entry(row, labels, lies, poses[:, :3, 3], poses[:, :3, :3])}


def _deviations(evaluation: Evaluation | None, row: str) -> Callable[[str], Mapping[str, float]]:
    return lambda plugin: evaluation.deviations_of(row, plugin) if evaluation else {}


def _alignment(alignment: Alignment | None) -> Entry | None:
    if alignment is None:
        return None
    return {
        "place": [alignment.x_m, alignment.y_m, alignment.z_m, alignment.heading_deg],
        "covariance": digits(alignment.covariance[UPPER]),
        "anchor": alignment.anchor and list(alignment.anchor),
    }


def _row(row: RowMap, placement: Placement | None, joint_path: str) -> Entry:
    poses = row.trajectory.world_from_rig
    return {
        "name": visible(row.name),
        "placement": placement and [placement.x_m, placement.z_m, placement.heading_deg],
        "placement_covariance": placement and digits(placement.covariance[UPPER]),
        "grade": row.verdict and row.verdict.grade,
        "warnings": [_warning(warning) for warning in row.verdict.warnings] if row.verdict else [],
        "remarks": [visible(note) for note in row.verdict.notes] if row.verdict else [],
        **vertex_entry(row.structures),
        "joint": _joint(row, joint_path),
        "frames": path_entry(row, poses[:, :3, 3], poses[:, :3, :3], np.ones(len(poses), bool)),
    }


def _warning(warning: MapWarning) -> Entry:
    named = [visible(name) for name in warning.subjects]
    place = None if warning.place is None else list(warning.place)
    return {
        "code": warning.code,
        "headline": visible(warning.headline),
        "figure": visible(warning.figure),
        "action": visible(warning.action),
        "details": [visible(line) for line in warning.details],
        "of_row": warning.of_row,
        "subjects": named,
        "place": place,
        "frame": warning.frame,
    }


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
