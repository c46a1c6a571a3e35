"""An earlier date under a map in the viewer: its elements in the new rows' frames, what changed, and its
orthophotos."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from savmap.errors import visible
from savmap.maps.comparison import CHANGES, Comparison, Difference, ElementChange, RowComparison, RowMotion
from savmap.report.viewer.packed import UNIT_M, Entry, Labels, path_entry, structure_entries, vertex_entry
from savmap.types import Floats, Orthophoto, RowMap, SiteMap, Structure


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


def site_entry(before: Before | None) -> Entry | None:
    """What the page says of both dates as a whole: rows that only one has."""
    if before is None:
        return None
    comparison = before.comparison
    return {
        "level": comparison.level,
        "missing": [visible(name) for name in comparison.missing],
        "new": [visible(name) for name in comparison.new],
    }


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
    face = lies.get("old face")
    poses = old.trajectory.world_from_rig
    return {
        **vertex_entry(carried),
        "structures": structure_entries(replace(old, structures=carried), labels),
        "face": face and carried_face(face, motion),
        **_stills(old, lies, motion.points(poses[:, :3, 3]), _turn(motion) @ poses[:, :3, :3]),
        "motion": _motion(motion),
        "changes": [_change(one, *numbers) for one in compared.elements],
        "openings": [_opening(one) for one in compared.openings if one.state in CHANGES],
    }


def gone_entry(row: RowMap, labels: Labels, lies: Entry) -> Entry:
    """The earlier date of a row that only the earlier map has, in its own frame: nothing of it was compared with
    anything."""
    poses = row.trajectory.world_from_rig
    return {
        **vertex_entry(row.structures),
        "structures": structure_entries(row, labels),
        "face": lies.get("old face"),
        **_stills(row, lies, poses[:, :3, 3], poses[:, :3, :3]),
        "motion": None,
        "changes": [],
        "openings": [],
    }


def _stills(row: RowMap, lies: Entry, centres: Floats, turns: Floats) -> Entry:
    """The earlier panoramas, and of the camera's path the places from which they were taken, (n, 3) m and (n, 3, 3), in
    the frame that is shown."""
    stills = lies.get("old stills", [])
    kept = np.isin(row.trajectory.frames, [one["frame"] for one in stills])
    return {"stills": stills, "frames": path_entry(row, centres, turns, kept)}


def carried_face(face: Entry, motion: RowMotion) -> Entry:
    """An old orthophoto's place in the new row's frame."""
    right, up = (np.array(face[name]) * face[size] for name, size in (("right", "width_m"), ("up", "height_m")))
    origin = np.array(face["origin_m"])
    corner, beside, above = motion.points(np.array([origin, origin + right, origin + up]))
    width, height = float(np.linalg.norm(beside - corner)), float(np.linalg.norm(above - corner))
    return {
        **face,
        "origin_m": np.round(corner, 6).tolist(),
        "right": ((beside - corner) / width).tolist(),
        "up": ((above - corner) / height).tolist(),
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
        "alternatives_m": [round(one, 3) for one in motion.alternatives_m],
    }


def _change(change: ElementChange, old: Mapping[tuple[str, str], int], new: Mapping[tuple[str, str], int]) -> Entry:
    """An element: its state, its numbers on both dates (None: not there), and all that was tested."""
    return {
        "state": change.state,
        "old": None if change.old_id is None else old[change.plugin, change.old_id],
        "new": None if change.new_id is None else new[change.plugin, change.new_id],
        "tested": [_difference(one) for one in change.differences],
    }


def _opening(change: ElementChange) -> Entry:
    return {
        "state": change.state,
        "name": visible(change.name),
        "place": np.round(change.position_m, 4).tolist(),
        "tested": [_difference(one) for one in change.differences],
    }


def _difference(difference: Difference) -> list[str | int]:
    """What, the difference and its standard deviation in `UNIT_M`, or both texts, and 1 where it is significant."""
    told = int(difference.significant)
    if difference.difference_m is None or difference.sigma_m is None:
        return [difference.what, visible(str(difference.old)), visible(str(difference.new)), told]
    return [difference.what, round(difference.difference_m / UNIT_M), round(difference.sigma_m / UNIT_M), told]
