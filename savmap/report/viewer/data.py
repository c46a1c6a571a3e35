"""A map as the viewer's page holds it: coordinates as whole numbers, covariances to so many digits, everything else as it is.

`source/data.js` reads it.
"""

import base64
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from savmap.errors import visible
from savmap.types import (
    Attribute,
    Doubt,
    Evaluation,
    Floats,
    JointCovariance,
    Measured,
    Placement,
    RowMap,
    SiteMap,
    Structure,
)

Entry = dict[str, Any]
UNIT_M = 1e-5
DIGITS = 5
"""Of a variance: a standard deviation is shown with two."""
TURN = 6
"""Decimals of a quaternion: 0.1 pixel of a panorama of 2048."""
UPPER = np.triu_indices(3)


def page_data(site_map: SiteMap, title: str, evaluation: Evaluation | None, beside: Mapping[str, Entry]) -> Entry:
    """All that the page shows, for JSON. `beside`: by row, what lies beside the page:
    "face", "stills" and "joint"."""
    labels: dict[str, int] = {}
    rows = [
        {
            **_row(row, site_map.placements.get(name), beside.get(name, {}).get("joint", "")),
            "structures": list(_structures(row, labels, evaluation)),
            "face": beside.get(name, {}).get("face"),
            "stills": beside.get(name, {}).get("stills", []),
        }
        for name, row in site_map.rows.items()
    ]
    return {"title": visible(title), "surveyed": evaluation is not None, "rows": rows, "vertex_labels": list(labels)}


def _row(row: RowMap, placement: Placement | None, joint_path: str) -> Entry:
    structures = [structure for group in row.structures.values() for structure in group]
    return {
        "name": visible(row.name),
        "placement": placement and [placement.x_m, placement.z_m, placement.heading_deg],
        "placement_covariance": placement and _digits(placement.covariance[UPPER]),
        "grade": row.verdict and row.verdict.grade,
        "doubts": [_doubt(doubt) for doubt in row.verdict.doubts] if row.verdict else [],
        "remarks": [visible(note) for note in row.verdict.notes] if row.verdict else [],
        "positions": _units(_stacked([structure.vertices for structure in structures]), UNIT_M),
        "covariances": _digits(_stacked([structure.covariances[:, *UPPER] for structure in structures])),
        "joint": _joint(row, joint_path),
        "frames": _frames(row),
    }


def _structures(row: RowMap, labels: dict[str, int], evaluation: Evaluation | None) -> Iterator[Entry]:
    for plugin, group in row.structures.items():
        deviations = evaluation.deviations_of(row.name, plugin) if evaluation else {}
        for structure in group:
            yield {
                "plugin": visible(plugin),
                "id": visible(structure.id),
                "label": visible(structure.label),
                "attributes": {visible(name): _attribute(value) for name, value in structure.attributes.items()},
                "labels": [
                    labels.setdefault(_shortened(label, structure.id), len(labels)) for label in structure.vertex_labels
                ],
                "edges": structure.edges.ravel().tolist(),
                "solid": _solid(structure),
                "off": _off(deviations.get(structure.id)),
            }


def _shortened(label: str, whole: str) -> str:
    """A vertex's label; "+" and what follows its structure's id, where it begins with that: such endings are few."""
    return f"+{visible(label.removeprefix(whole))}" if label.startswith(whole) else f"={visible(label)}"


def _attribute(value: Attribute) -> Entry | float | int | str:
    if isinstance(value, Measured):
        return {"value": value.value, "sigma": value.sigma}
    return visible(value) if isinstance(value, str) else value


def _solid(structure: Structure) -> Entry | None:
    if structure.solid is None:
        return None
    solid = structure.solid
    return {"outline": np.round(solid.outline, 5).tolist(), "depth": np.round(solid.depth, 5).tolist()}


def _off(deviation: float | None) -> float | str | None:
    """How far a structure is off the survey, m; "spurious" where that has none there; None where nobody compared it."""
    if deviation is None or np.isnan(deviation):
        return None
    return round(float(deviation), 5) if np.isfinite(deviation) else "spurious"


def _doubt(doubt: Doubt) -> Entry:
    named = [visible(name) for name in doubt.structures]
    place = None if doubt.place is None else list(doubt.place)
    return {
        "kind": doubt.kind,
        "what": visible(doubt.what),
        "structures": named,
        "place": place,
        "frame": doubt.frame,
    }


def _frames(row: RowMap) -> Entry:
    """The camera's path: frames whose pose is known, in order."""
    path, names = row.trajectory, list(dict.fromkeys(row.frames.passes))
    turns = Rotation.from_matrix(path.world_from_rig[:, :3, :3]).as_quat() if len(path.frames) else np.zeros((0, 4))
    return {
        "number": path.frames.tolist(),
        "pass": [names.index(row.frames.passes[frame]) for frame in path.frames.tolist()],
        "passes": [visible(name) for name in names],
        "stamp": np.round(row.frames.stamps_s[path.frames], 3).tolist(),
        "position": _units(path.world_from_rig[:, :3, 3], UNIT_M),
        "quaternion": np.round(turns, TURN).ravel().tolist(),
    }


def _joint(row: RowMap, path: str) -> Entry | None:
    """Which coordinates, in the order of `positions`, share errors, -1 for those that share none; their covariance is in the page, or, where a
    path is given, in a script beside it."""
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


def _stacked(parts: Sequence[Floats]) -> Floats:
    return np.concatenate(parts) if parts else np.zeros((0, 3))


def _units(values: Floats, unit: float) -> list[int]:
    whole: list[int] = np.round(np.ravel(values) / unit).astype(np.int64).tolist()
    return whole


def _digits(values: Floats) -> list[float]:
    """Numbers in a row, to so many digits, whole ones without a point."""
    return [float(f"{value:.{DIGITS}g}") for value in np.ravel(values)]
