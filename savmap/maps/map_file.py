"""A SiteMap as map.json and back. The same map always gives the same bytes.

Coordinates are rounded to 0.01 mm, standard deviations to 0.001 mm, covariances to six digits, quaternions to nine
decimals.
"""

import base64
import binascii
import json
import os
import re
from collections.abc import Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from savmap.errors import OutputError
from savmap.files.atomic import read_json, write_text
from savmap.files.texts import json_of, json_visible
from savmap.files.urls import where
from savmap.files.validation import checked
from savmap.maps import schema
from savmap.maps.schema import MeasuredEntry
from savmap.types import (
    Alignment,
    AlignmentResidual,
    Attribute,
    CrossRowMatch,
    Floats,
    FrameTable,
    JointCovariance,
    MapWarning,
    Measured,
    Placement,
    ReferenceUse,
    RowMap,
    SiteMap,
    Solid,
    Structure,
    Trajectory,
    Verdict,
    ViewSpec,
)

COORDINATE, SIGMA, FIGURE, QUATERNION = 5, 6, 6, 9
"""Decimals."""
LEAST_SIGMA = 10.0**-FIGURE
"""Of a reference: readers divide by it."""
UPPER = np.triu_indices(3)
JOINT_NUMBERS = "<f4"
NUMBER_LIST = re.compile(r"\[\n\s*([-+.\deE,\s]+?)\s*\n\s*\]")

Entry = dict[str, Any]


def map_in(source: Path) -> Path:
    """A map file, or that of a folder."""
    return source / "map.json" if os.path.isdir(source) else source  # no error for names that no file can have


def require_other(output: Path | None, *maps: Path) -> None:
    """Raise OutputError where something else would be written over a map that is read."""
    for path in maps if output is not None else ():
        with suppress(OSError, ValueError):  # names that no file can have are told where they are written
            if os.path.samefile(str(output), path):
                raise OutputError(f"{output}: is the map itself; choose another file")


def write_map(site: SiteMap, path: str | Path) -> None:
    """Write map.json, whole or not at all. Raises OutputError."""
    write_text(where(path), map_text(site))


def read_map(path: Path) -> SiteMap:
    """The map in a map.json. Raises OutputError with one line: file, place, problem."""
    try:
        return _site_map(read_json(path), str(path))
    except OutputError as error:
        if os.path.exists(path):
            raise
        raise OutputError(f"{error}: there is no map; `savmap map` makes one") from None


def map_of(text: str, where: str) -> SiteMap:
    """The map in a text that was read at `where`. Raises OutputError as `read_map` does."""
    try:
        return _site_map(json_of(text), where)
    except ValueError as error:
        raise OutputError(f"{where}: is not JSON ({error})") from error


def map_text(site: SiteMap) -> str:
    """The text of map.json: keys sorted, numbers rounded, arrays of numbers on one line. Raises OutputError on NaN."""
    rows = {name: _row_entry(row) for name, row in site.rows.items()}
    content = {
        "format": schema.FORMAT,
        "version": schema.VERSION,
        "units": "m",
        "made_by": dict(site.made_by),
        "rows": rows,
    }
    if site.failed:
        content["failed"] = dict(site.failed)
    if site.placements:
        content["placed"] = {name: _placement_entry(placement) for name, placement in site.placements.items()}
    if site.matches:
        content["ties"] = [_match_entry(match) for match in site.matches]
    if site.alignment:
        content["aligned"] = _alignment_entry(site.alignment)
    try:
        text = json.dumps(content, indent=1, sort_keys=True, allow_nan=False, ensure_ascii=False)
    except ValueError as error:
        raise OutputError(f"the map holds a number that is not finite ({error}); it was not written") from error
    return json_visible(NUMBER_LIST.sub(lambda match: "[" + " ".join(match[1].split()) + "]", text)) + "\n"


def _row_entry(row: RowMap) -> Entry:
    verdict = {"verdict": _verdict_entry(row.verdict)} if row.verdict else {}
    joint = {"joint": _joint_entry(row.joint)} if row.joint else {}
    return {
        "trajectory": _trajectory_entries(row.frames, row.trajectory),
        "views": {name: _view_entry(spec) for name, spec in row.views.items()},
        "structures": {plugin: list(map(_structure_entry, group)) for plugin, group in row.structures.items()},
        "references": [_reference_entry(use) for use in row.references],
        "report": {name: _value(value) for name, value in row.report.items()},
        **verdict,
        **joint,
    }


def _verdict_entry(verdict: Verdict) -> Entry:
    warnings = [_warning_entry(warning) for warning in verdict.warnings]
    return {"grade": verdict.grade, "warnings": warnings, "notes": list(verdict.notes)}


def _warning_entry(warning: MapWarning) -> Entry:
    """With its headline and its action, for those who read the file without savmap."""
    place = None if warning.place is None else _rounded(warning.place, COORDINATE)
    said = {"headline": warning.headline, "figure": warning.figure, "action": warning.action}
    where = {"subjects": list(warning.subjects), "place_m": place, "frame": warning.frame}
    return {"code": warning.code, **said, "details": list(warning.details), **where}


def _verdict(entry: schema.VerdictEntry) -> Verdict:
    warnings = (
        MapWarning(item.code, tuple(item.subjects), item.figure, item.place_m, item.frame, tuple(item.details))
        for item in entry.warnings
    )
    return Verdict(tuple(warnings), tuple(entry.notes))


def _quaternion(rotation: Floats) -> list[float]:
    """x, y, z, w of a rotation (3, 3). Rounded numbers are no unit quaternion: they are taken as a reader takes them,
    so that a map that is read and written again has the same bytes."""
    first = _rounded(Rotation.from_matrix(rotation).as_quat(canonical=True), QUATERNION)
    read = Rotation.from_quat(first).as_matrix()
    return _rounded(Rotation.from_matrix(read).as_quat(canonical=True), QUATERNION)


def _trajectory_entries(table: FrameTable, trajectory: Trajectory) -> list[Entry]:
    index_of = {int(frame): index for index, frame in enumerate(trajectory.frames)}
    return [
        {"frame": frame, "stamp_s": stamp, "pass": name, **_pose_entry(trajectory, index_of.get(frame))}
        for frame, (stamp, name) in enumerate(zip(_rounded(table.stamps_s, FIGURE), table.passes, strict=True))
    ]


def _pose_entry(trajectory: Trajectory, index: int | None) -> Entry:
    if index is None:
        return {"position_m": None, "orientation_xyzw": None, "sigma_m": None}
    pose = trajectory.world_from_rig[index]
    sigma = None if trajectory.sigma_m is None else _rounded(trajectory.sigma_m[index], SIGMA)
    position = _rounded(pose[:3, 3], COORDINATE)
    return {"position_m": position, "orientation_xyzw": _quaternion(pose[:3, :3]), "sigma_m": sigma}


def _view_entry(spec: ViewSpec) -> Entry:
    yaw, pitch, roll, hfov = _rounded((spec.yaw_deg, spec.pitch_deg, spec.roll_deg, spec.hfov_deg), FIGURE)
    size = {"width": int(spec.width), "height": int(spec.height)}
    return {"yaw_deg": yaw, "pitch_deg": pitch, "roll_deg": roll, "hfov_deg": hfov, **size}


def _structure_entry(structure: Structure) -> Entry:
    vertices = zip(structure.vertex_labels, structure.vertices, structure.covariances, strict=True)
    solid = {"solid": _solid_entry(structure.solid)} if structure.solid else {}
    return {
        "id": structure.id,
        "label": structure.label,
        "vertices": [_vertex_entry(*vertex) for vertex in vertices],
        "edges": [[int(end) for end in edge] for edge in structure.edges],
        "attributes": {name: _attribute_entry(value) for name, value in structure.attributes.items()},
        **solid,
    }


def _solid_entry(solid: Solid) -> Entry:
    outline, depth = [_rounded(corner, COORDINATE) for corner in solid.outline], _rounded(solid.depth, COORDINATE)
    return {"outline_m": outline, "depth_m": depth, "assumed": solid.assumed, "ifc_class": solid.ifc_class}


def _vertex_entry(label: str, position: Floats, covariance: Floats) -> Entry:
    return {
        "label": label,
        "position_m": _rounded(position, COORDINATE),
        "sigma_m": _rounded(np.sqrt(np.diag(_symmetric(_upper_triangle(covariance)))), SIGMA),
        "covariance_m2": _upper_triangle(covariance),
    }


def _joint_entry(joint: JointCovariance) -> Entry:
    triangle = joint.covariance[np.triu_indices(len(joint.covariance))].astype(JOINT_NUMBERS)
    coordinates = {
        plugin: {name: numbers.tolist() for name, numbers in group.items()}
        for plugin, group in joint.coordinates.items()
    }
    text = base64.b64encode(triangle.tobytes()).decode("ascii")
    hidden = {"unchecked_m": [_rounded(line, COORDINATE) for line in joint.hidden]} if len(joint.hidden) else {}
    return {"size": len(joint.covariance), "coordinates": coordinates, "covariance_m2": text, **hidden}


def _reference_entry(use: ReferenceUse) -> Entry:
    """The residual is that of the rounded numbers, which a reader has."""
    value, sigma, solved = _rounded((use.value, use.sigma, use.solved), FIGURE)
    (residual,) = _rounded((solved - value,), FIGURE)
    sigma = max(sigma, LEAST_SIGMA)
    used = None if use.sigma_used is None else max(round(use.sigma_used, FIGURE), sigma)
    softened = used if used and used > sigma else None
    written = ReferenceUse(use.name, value, sigma, solved, use.unit, softened, use.left_out)
    numbers = {"value": value, "sigma": sigma, "sigma_used": used, "solved": solved, "residual": residual}
    return {"name": use.name, "unit": use.unit, **numbers, "state": written.state}


def _placement_entry(placement: Placement) -> Entry:
    x, z, heading = _rounded((placement.x_m, placement.z_m, placement.heading_deg), FIGURE)
    return {"x_m": x, "z_m": z, "heading_deg": heading, "covariance": _upper_triangle(placement.covariance)}


def _alignment_entry(alignment: Alignment) -> Entry:
    x, y, z, heading = _rounded((alignment.x_m, alignment.y_m, alignment.z_m, alignment.heading_deg), FIGURE)
    place = {"x_m": x, "y_m": y, "z_m": z, "heading_deg": heading, "covariance": _upper_triangle(alignment.covariance)}
    rest: Entry = {"residuals": list(map(_residual_entry, alignment.residuals))} if alignment.residuals else {}
    if alignment.scale is not None:
        rest["scale"] = _attribute_entry(alignment.scale)
    return {**place, **rest, "anchor_lat_lon_deg": alignment.anchor and _rounded(alignment.anchor, QUATERNION)}


def _residual_entry(residual: AlignmentResidual) -> Entry:
    """Null for axes that are not given."""
    numbers = {"residual_m": _or_null(residual.residual_m), "sigma_m": _or_null(residual.sigma_m)}
    deviation = min(round(float(residual.deviation), FIGURE), schema.LARGEST)
    return {"row": residual.row, "at": residual.at, **numbers, "deviation": deviation, "used": residual.used}


def _match_entry(match: CrossRowMatch) -> Entry:
    """Null for axes that the match does not measure."""
    names = {"row_a": match.row_a, "row_b": match.row_b, "id_a": match.id_a, "id_b": match.id_b}
    return {**names, "residual_m": _or_null(match.residual_m), "sigma_m": _or_null(match.sigma_m)}


def _rounded(values: Floats | Iterable[float], decimals: int) -> list[float]:
    """Numbers to so many decimals, without negative zeros."""
    return [round(float(value), decimals) + 0.0 for value in values]


def _upper_triangle(covariance: Floats) -> list[float]:
    """The upper triangle of a matrix (3, 3), row by row, to six digits."""
    return [float(f"{value:.6g}") + 0.0 for value in covariance[UPPER]]


def _or_null(values: Floats) -> list[float | None]:
    return [None if np.isnan(value) else _rounded([value], SIGMA)[0] for value in values]


def _attribute_entry(value: Attribute) -> Entry | float | int | str:
    if isinstance(value, Measured):
        return {"value": _value(value.value), "sigma": _value(value.sigma)}
    return _value(value)


def _attribute(entry: float | int | str | MeasuredEntry) -> Attribute:
    return Measured(entry.value, entry.sigma) if isinstance(entry, MeasuredEntry) else entry


def _value(value: float | int | str) -> float | int | str:
    if isinstance(value, str):
        return value
    return int(value) if isinstance(value, int | np.integer) else round(float(value), FIGURE) + 0.0


def _site_map(content: object, path: str) -> SiteMap:
    schema.require_format(content, path, "map", schema.FORMAT, schema.VERSION)
    entry = checked(schema.MapFile, content, path)
    try:
        rows = {name: _row_map(name, row) for name, row in entry.rows.items()}
        placements = {
            name: Placement(placed.x_m, placed.z_m, placed.heading_deg, _symmetric(placed.covariance))
            for name, placed in entry.placed.items()
        }
        matches = tuple(_match(match) for match in entry.ties)
        alignment = _alignment(entry.aligned)
    except ValueError as error:
        raise OutputError(f"{path}: {error}") from error
    return SiteMap(rows, entry.made_by, entry.failed, placements, matches, alignment)


def _row_map(name: str, row: schema.RowEntry) -> RowMap:
    stamps_s, passes = [frame.stamp_s for frame in row.trajectory], tuple(frame.pass_name for frame in row.trajectory)
    verdict = None if row.verdict is None else _verdict(row.verdict)
    return RowMap(
        name=name,
        frames=FrameTable(np.array(stamps_s), passes),
        views={view: _view(view, entry) for view, entry in row.views.items()},
        trajectory=_trajectory(row.trajectory),
        structures={plugin: tuple(map(_structure, group)) for plugin, group in row.structures.items()},
        references=tuple(map(_reference, row.references)),
        report=row.report,
        verdict=verdict,
        joint=_joint(row),
    )


def _joint(row: schema.RowEntry) -> JointCovariance | None:
    """A row's joint covariance. Raises ValueError where it is none of the row's structures."""
    if row.joint is None:
        return None
    sizes = {(plugin, entry.id): len(entry.vertices) for plugin, group in row.structures.items() for entry in group}
    coordinates = {
        plugin: {
            name: _coordinates(vertices, f"{plugin}: {name}", sizes.get((plugin, name)), row.joint.size)
            for name, vertices in group.items()
        }
        for plugin, group in row.joint.coordinates.items()
    }
    if any(len(line) != row.joint.size for line in row.joint.unchecked_m):
        raise ValueError(f"joint: unchecked_m should be lines of {row.joint.size} numbers")
    hidden = {"hidden": np.array(row.joint.unchecked_m)} if row.joint.unchecked_m else {}
    return JointCovariance(coordinates, _joint_matrix(row.joint), **hidden)


def _coordinates(vertices: list[tuple[int, int, int]], where: str, count: int | None, size: int) -> Any:
    if count is None:
        raise ValueError(
            f"joint: {where} is none of the structures; whoever edits a map takes it out of `joint`, too, or leaves "
            "`joint` out"
        )
    if len(vertices) != count:
        raise ValueError(f"joint: {where} has {count} vertices, not {len(vertices)}")
    if any(number >= size for vertex in vertices for number in vertex):
        raise ValueError(f"joint: {where}: a coordinate is not among the {size}")
    return np.array(vertices, dtype=np.int64).reshape(-1, 3)


def _joint_matrix(entry: schema.JointEntry) -> Floats:
    try:
        content = base64.b64decode(entry.covariance_m2, validate=True)
    except (binascii.Error, ValueError) as error:
        raise ValueError(f"joint: covariance_m2 is not base64 ({error})") from error
    triangle = np.frombuffer(content[: len(content) // 4 * 4], JOINT_NUMBERS).astype(np.float64)
    if len(triangle) != entry.size * (entry.size + 1) // 2 or not np.isfinite(triangle).all():
        raise ValueError(f"joint: covariance_m2 is not the finite upper triangle of {entry.size} lines")
    return _symmetric(triangle, entry.size)


def _reference(entry: schema.ReferenceEntry) -> ReferenceUse:
    """A reference; an older map has one standard deviation, that which was used."""
    softened = entry.sigma_used if entry.sigma_used is not None and entry.sigma_used > entry.sigma else None
    given = entry.name, entry.value, entry.sigma, entry.solved, entry.unit
    return ReferenceUse(*given, softened, entry.state == "left out")


def _trajectory(entries: list[schema.FrameEntry]) -> Trajectory:
    if [entry.frame for entry in entries] != list(range(len(entries))):
        raise ValueError("trajectory: frames should be numbered 0, 1, 2 ... in order")
    located = [entry for entry in entries if entry.position_m is not None and entry.orientation_xyzw is not None]
    poses = np.tile(np.eye(4), (len(located), 1, 1))
    if located:
        poses[:, :3, :3] = Rotation.from_quat([entry.orientation_xyzw for entry in located]).as_matrix()
        poses[:, :3, 3] = [entry.position_m for entry in located]
    sigmas = [entry.sigma_m for entry in located if entry.sigma_m is not None]
    sigma = np.array(sigmas).reshape(-1, 3) if len(sigmas) == len(located) else None
    return Trajectory(np.array([entry.frame for entry in located], dtype=np.int64), poses, sigma)


def _view(name: str, entry: schema.ViewEntry) -> ViewSpec:
    angles = entry.yaw_deg, entry.pitch_deg, entry.roll_deg, entry.hfov_deg
    return ViewSpec(name, *angles, entry.width, entry.height)


def _structure(entry: schema.StructureEntry) -> Structure:
    if any(not 0 <= end < len(entry.vertices) for edge in entry.edges for end in edge):
        raise ValueError(f"{entry.id}: an edge joins a vertex that is not there")
    return Structure(
        id=entry.id,
        label=entry.label,
        vertices=np.array([vertex.position_m for vertex in entry.vertices], dtype=np.float64).reshape(-1, 3),
        covariances=np.array([_symmetric(vertex.covariance_m2) for vertex in entry.vertices]).reshape(-1, 3, 3),
        vertex_labels=tuple(vertex.label for vertex in entry.vertices),
        edges=np.array(entry.edges, dtype=np.int64).reshape(-1, 2),
        attributes={name: _attribute(value) for name, value in entry.attributes.items()},
        solid=_solid(entry.solid),
    )


def _solid(entry: schema.SolidEntry | None) -> Solid | None:
    if entry is None:
        return None
    return Solid(
        np.array(entry.outline_m, np.float64), np.array(entry.depth_m, np.float64), entry.assumed, entry.ifc_class
    )


def _alignment(entry: schema.AlignmentEntry | None) -> Alignment | None:
    if entry is None:
        return None
    place = entry.x_m, entry.y_m, entry.heading_deg, _symmetric(entry.covariance)
    residuals = tuple(map(_residual, entry.residuals))
    scale = None if entry.scale is None else Measured(entry.scale.value, entry.scale.sigma)
    return Alignment(*place, entry.z_m, entry.anchor_lat_lon_deg, residuals, scale)


def _residual(entry: schema.AlignmentResidualEntry) -> AlignmentResidual:
    residual, sigma = (np.array(values, dtype=np.float64) for values in (entry.residual_m, entry.sigma_m))
    return AlignmentResidual(entry.row, entry.at, residual, sigma, entry.deviation, entry.used)


def _match(entry: schema.MatchEntry) -> CrossRowMatch:
    residual, sigma = (np.array(values, dtype=np.float64) for values in (entry.residual_m, entry.sigma_m))
    return CrossRowMatch(entry.row_a, entry.row_b, entry.id_a, entry.id_b, residual, sigma)


def _symmetric(upper: Sequence[float] | Floats, size: int = 3) -> Floats:
    """The symmetric matrix (size, size) of an upper triangle, row by row."""
    full = np.zeros((size, size))
    full[np.triu_indices(size)] = upper
    matrix: Floats = full + np.triu(full, 1).T
    return matrix
