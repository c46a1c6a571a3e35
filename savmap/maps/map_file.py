"""A SiteMap as map.json and back. The same map always gives the same bytes.

Coordinates are rounded to 0.01 mm, standard deviations to 0.001 mm, covariances to six digits, quaternions to nine
decimals.
"""

import json
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from savmap.errors import OutputError
from savmap.files.atomic import read_json, write_text
from savmap.files.validation import checked
from savmap.maps.schema import (
    FORMAT,
    VERSION,
    FrameEntry,
    MapFile,
    MeasuredEntry,
    PlacementEntry,
    RowEntry,
    StructureEntry,
    TieEntry,
    ViewEntry,
)
from savmap.types import (
    Attribute,
    Floats,
    FrameTable,
    Measured,
    Placement,
    ReferenceUse,
    RowMap,
    SiteMap,
    Structure,
    Tie,
    Trajectory,
    ViewSpec,
)

SIGMA, FIGURE = 6, 6
UPPER = np.triu_indices(3)


def rounded(values: Floats | Iterable[float], decimals: int) -> list[float]:
    """Numbers to so many decimals, without negative zeros."""
    return [round(float(value), decimals) + 0.0 for value in values]


def significant(value: float) -> float:
    """A number to six digits."""
    return float(f"{value:.6g}") + 0.0


def symmetric(upper: Iterable[float]) -> Floats:
    """The symmetric matrix (3, 3) of an upper triangle, row by row."""
    full = np.zeros((3, 3))
    full[UPPER] = list(upper)
    matrix: Floats = full + np.triu(full, 1).T
    return matrix


def placement_entry(own: Placement) -> dict[str, Any]:
    """A row's place."""
    x, z, heading = rounded((own.x_m, own.z_m, own.heading_deg), FIGURE)
    covariance = [significant(value) for value in own.covariance[UPPER]]
    return {"x_m": x, "z_m": z, "heading_deg": heading, "covariance": covariance}


def placement(own: PlacementEntry) -> Placement:
    """And back."""
    return Placement(own.x_m, own.z_m, own.heading_deg, symmetric(own.covariance))


def tie_entry(own: Tie) -> dict[str, Any]:
    """A thing that two rows see; null for what it does not tell."""
    names = {"row_a": own.row_a, "row_b": own.row_b, "id_a": own.id_a, "id_b": own.id_b}
    return {**names, "residual_m": _known(own.residual_m), "sigma_m": _known(own.sigma_m)}


def tie(own: TieEntry) -> Tie:
    """And back."""
    residual, sigma = (np.array(values, dtype=np.float64) for values in (own.residual_m, own.sigma_m))
    return Tie(own.row_a, own.row_b, own.id_a, own.id_b, residual, sigma)


def _known(values: Floats) -> list[float | None]:
    return [None if np.isnan(value) else rounded([value], SIGMA)[0] for value in values]


_COORDINATE, _QUATERNION = 5, 9
_NUMBERS = re.compile(r"\[\n\s*([-+.\deE,\s]+?)\s*\n\s*\]")

Entry = dict[str, Any]


def write_map(site: SiteMap, path: Path) -> None:
    """Write map.json, whole or not at all. Raises OutputError."""
    write_text(path, map_text(site))


def read_map(path: Path) -> SiteMap:
    """The map in a map.json. Raises OutputError with one line: file, place, problem."""
    return _site_map(read_json(path), str(path))


def map_of(text: str, where: str) -> SiteMap:
    """The map in a text that was read at `where`. Raises OutputError as `read_map` does."""
    return _site_map(json.loads(text), where)


def _site_map(content: object, path: str) -> SiteMap:
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise OutputError(f'{path}: is not a map (it has no "format": "{FORMAT}")')
    if content.get("version") != VERSION:
        raise OutputError(f"{path}: is a map of version {content.get('version')}; this program reads version {VERSION}")
    entry = checked(MapFile, content, path)
    try:
        rows = {name: _row_map(name, row) for name, row in entry.rows.items()}
    except ValueError as error:
        raise OutputError(f"{path}: {error}") from error
    placed = {name: placement(own) for name, own in entry.placed.items()}
    return SiteMap(rows, entry.made_by, entry.failed, placed, tuple(tie(own) for own in entry.ties))


def map_text(site: SiteMap) -> str:
    """The text of map.json: keys sorted, numbers rounded, arrays of numbers on one line. Raises OutputError on NaN."""
    rows = {name: _row_entry(row) for name, row in site.rows.items()}
    content = {"format": FORMAT, "version": VERSION, "units": "m", "made_by": dict(site.made_by), "rows": rows}
    if site.failed:
        content["failed"] = dict(site.failed)
    if site.placed:
        content["placed"] = {name: placement_entry(own) for name, own in site.placed.items()}
    if site.ties:
        content["ties"] = [tie_entry(own) for own in site.ties]
    try:
        text = json.dumps(content, indent=1, sort_keys=True, allow_nan=False, ensure_ascii=False)
    except ValueError as error:
        raise OutputError(f"the map holds a number that is not finite ({error}); it was not written") from error
    return _NUMBERS.sub(lambda found: "[" + " ".join(found[1].split()) + "]", text) + "\n"


def _row_entry(row: RowMap) -> Entry:
    return {
        "trajectory": _trajectory_entries(row.frames, row.trajectory),
        "views": {name: _view_entry(spec) for name, spec in row.views.items()},
        "structures": {plugin: [_structure_entry(own) for own in every] for plugin, every in row.structures.items()},
        "references": [_reference_entry(own) for own in row.references],
        "report": {name: _plain(value) for name, value in row.report.items()},
    }


def _trajectory_entries(table: FrameTable, trajectory: Trajectory) -> list[Entry]:
    where = {int(frame): index for index, frame in enumerate(trajectory.frames)}
    return [
        {"frame": frame, "stamp_s": stamp, "pass": name, **_pose_entry(trajectory, where.get(frame))}
        for frame, (stamp, name) in enumerate(zip(rounded(table.stamps_s, FIGURE), table.passes, strict=True))
    ]


def _pose_entry(trajectory: Trajectory, index: int | None) -> Entry:
    if index is None:
        return {"position_m": None, "orientation_xyzw": None, "sigma_m": None}
    pose = trajectory.world_from_rig[index]
    quaternion = Rotation.from_matrix(pose[:3, :3]).as_quat(canonical=True)
    sigma = None if trajectory.sigma_m is None else rounded(trajectory.sigma_m[index], SIGMA)
    position = rounded(pose[:3, 3], _COORDINATE)
    return {"position_m": position, "orientation_xyzw": rounded(quaternion, _QUATERNION), "sigma_m": sigma}


def _view_entry(spec: ViewSpec) -> Entry:
    yaw, pitch, roll, hfov = rounded((spec.yaw_deg, spec.pitch_deg, spec.roll_deg, spec.hfov_deg), FIGURE)
    size = {"width": int(spec.width), "height": int(spec.height)}
    return {"yaw_deg": yaw, "pitch_deg": pitch, "roll_deg": roll, "hfov_deg": hfov, **size}


def _structure_entry(own: Structure) -> Entry:
    return {
        "id": own.id,
        "label": own.label,
        "vertices": [
            {
                "label": label,
                "position_m": rounded(vertex, _COORDINATE),
                "sigma_m": rounded(np.sqrt(np.diag(covariance)), SIGMA),
                "covariance_m2": [significant(value) for value in covariance[UPPER]],
            }
            for label, vertex, covariance in zip(own.vertex_labels, own.vertices, own.covariances, strict=True)
        ],
        "edges": [[int(end) for end in edge] for edge in own.edges],
        "attributes": {name: _attribute_entry(value) for name, value in own.attributes.items()},
    }


def _reference_entry(own: ReferenceUse) -> Entry:
    names = ("value", "sigma", "solved", "residual")
    numbers = rounded((own.value, own.sigma, own.solved, own.solved - own.value), FIGURE)
    return {"name": own.name, "unit": own.unit, **dict(zip(names, numbers, strict=True))}


def _row_map(name: str, row: RowEntry) -> RowMap:
    return RowMap(
        name=name,
        frames=_frame_table(row.trajectory),
        views={view: _view(view, own) for view, own in row.views.items()},
        trajectory=_trajectory(row.trajectory),
        structures={plugin: tuple(_structure(own) for own in every) for plugin, every in row.structures.items()},
        references=tuple(ReferenceUse(own.name, own.value, own.sigma, own.solved, own.unit) for own in row.references),
        report=row.report,
    )


def _frame_table(entries: list[FrameEntry]) -> FrameTable:
    return FrameTable(np.array([own.stamp_s for own in entries]), tuple(own.pass_name for own in entries))


def _trajectory(entries: list[FrameEntry]) -> Trajectory:
    if [own.frame for own in entries] != list(range(len(entries))):
        raise ValueError("trajectory: frames should be numbered 0, 1, 2 ... in order")
    placed = [own for own in entries if own.position_m is not None and own.orientation_xyzw is not None]
    poses = np.tile(np.eye(4), (len(placed), 1, 1))
    if placed:
        poses[:, :3, :3] = Rotation.from_quat([own.orientation_xyzw for own in placed]).as_matrix()
        poses[:, :3, 3] = [own.position_m for own in placed]
    sigmas = [own.sigma_m for own in placed if own.sigma_m is not None]
    sigma = np.array(sigmas).reshape(-1, 3) if len(sigmas) == len(placed) else None
    return Trajectory(np.array([own.frame for own in placed], dtype=np.int64), poses, sigma)


def _view(name: str, own: ViewEntry) -> ViewSpec:
    return ViewSpec(name, own.yaw_deg, own.pitch_deg, own.roll_deg, own.hfov_deg, own.width, own.height)


def _structure(own: StructureEntry) -> Structure:
    if any(not 0 <= end < len(own.vertices) for edge in own.edges for end in edge):
        raise ValueError(f"{own.id}: an edge joins a vertex that is not there")
    return Structure(
        id=own.id,
        label=own.label,
        vertices=np.array([vertex.position_m for vertex in own.vertices], dtype=np.float64).reshape(-1, 3),
        covariances=np.array([symmetric(vertex.covariance_m2) for vertex in own.vertices]).reshape(-1, 3, 3),
        vertex_labels=tuple(vertex.label for vertex in own.vertices),
        edges=np.array(own.edges, dtype=np.int64).reshape(-1, 2),
        attributes={name: _attribute(value) for name, value in own.attributes.items()},
    )


def _attribute_entry(value: Attribute) -> Entry | float | int | str:
    if isinstance(value, Measured):
        return {"value": _plain(value.value), "sigma": _plain(value.sigma)}
    return _plain(value)


def _attribute(entry: float | int | str | MeasuredEntry) -> Attribute:
    return Measured(entry.value, entry.sigma) if isinstance(entry, MeasuredEntry) else entry


def _plain(value: float | int | str) -> float | int | str:
    if isinstance(value, str):
        return value
    return int(value) if isinstance(value, int | np.integer) else round(float(value), FIGURE) + 0.0
