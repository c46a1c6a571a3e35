"""The joint covariance of a row's vertices in map.json."""

import base64
import binascii
from typing import Any

import numpy as np

from savmap.maps import schema
from savmap.types import Floats, JointCovariance

NUMBERS = "<f4"


def joint_entry(joint: JointCovariance) -> dict[str, Any]:
    """What map.json holds of it."""
    triangle = joint.covariance[np.triu_indices(len(joint.covariance))].astype(NUMBERS)
    coordinates = {
        plugin: {name: numbers.tolist() for name, numbers in group.items()}
        for plugin, group in joint.coordinates.items()
    }
    text = base64.b64encode(triangle.tobytes()).decode("ascii")
    return {"size": len(joint.covariance), "coordinates": coordinates, "covariance_m2": text}


def joint_of(row: schema.RowEntry) -> JointCovariance | None:
    """A row's joint covariance. Raises ValueError where it is none of the row's structures."""
    if row.joint is None:
        return None
    sizes = {(plugin, one.id): len(one.vertices) for plugin, group in row.structures.items() for one in group}
    coordinates = {
        plugin: {
            name: _numbers(vertices, f"{plugin}: {name}", sizes.get((plugin, name)), row.joint.size)
            for name, vertices in group.items()
        }
        for plugin, group in row.joint.coordinates.items()
    }
    return JointCovariance(coordinates, _matrix(row.joint))


def _numbers(vertices: list[tuple[int, int, int]], where: str, count: int | None, size: int) -> Any:
    if count is None:
        raise ValueError(
            f"joint: {where} is none of the structures; whoever edits a map takes it out of `joint`, too, or leaves `joint` out"
        )
    if len(vertices) != count:
        raise ValueError(f"joint: {where} has {count} vertices, not {len(vertices)}")
    if any(number >= size for vertex in vertices for number in vertex):
        raise ValueError(f"joint: {where}: a coordinate is not among the {size}")
    return np.array(vertices, dtype=np.int64).reshape(-1, 3)


def _matrix(entry: schema.JointEntry) -> Floats:
    try:
        content = base64.b64decode(entry.covariance_m2, validate=True)
    except (binascii.Error, ValueError) as error:
        raise ValueError(f"joint: covariance_m2 is not base64 ({error})") from error
    triangle = np.frombuffer(content[: len(content) // 4 * 4], NUMBERS).astype(np.float64)
    if len(triangle) != entry.size * (entry.size + 1) // 2 or not np.isfinite(triangle).all():
        raise ValueError(f"joint: covariance_m2 is not the finite upper triangle of {entry.size} lines")
    upper = np.zeros((entry.size, entry.size))
    upper[np.triu_indices(entry.size)] = triangle
    matrix: Floats = upper + np.triu(upper, 1).T
    return matrix
