"""Structures as the viewer's page holds them: coordinates as whole numbers, covariances to so many digits, everything
else as it is."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from savmap.errors import visible
from savmap.maps.assumed import assumed_coordinates
from savmap.types import Attribute, Bools, Floats, Measured, RowMap, Structure

Entry = dict[str, Any]
Places = Mapping[str, Mapping[str, Sequence[Structure]]]
"""Places between structures, by row and plugin."""
Labels = dict[str, int]
"""What vertices are called, and the number that stands for it."""
UNIT_M = 1e-5
PART = " / "
"""Between the parts of an id."""
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
        | {"assumed": np.flatnonzero(assumed_coordinates(row, plugin, structure)).tolist()}
        for plugin, group in row.structures.items()
        for structure in group
    ]


def place_entries(places: Mapping[str, Sequence[Structure]]) -> list[Entry]:
    """A row's places, each with its two corners and its sizes: of a part of a place, such as "bay 2 / level 1", those
    that the whole has not."""
    known = {(plugin, place.id): _sizes(place) for plugin, group in places.items() for place in group}
    corners = {
        (plugin, place.id): [place.vertices.min(axis=0), place.vertices.max(axis=0)]
        for plugin, group in places.items()
        for place in group
    }
    entries = []
    for (plugin, name), sizes in known.items():
        of_whole = known.get((plugin, name.rpartition(PART)[0]), {})
        own = {what: size for what, size in sizes.items() if what not in of_whole}
        entries.append({"id": visible(name), "sizes": own, "corners": units(corners[plugin, name])})
    return entries


def _sizes(place: Structure) -> Entry:
    return {visible(name): [round(value, 5), *digits(np.array([sigma]))] for name, value, sigma in place.sizes()}


def _structure(plugin: str, structure: Structure, labels: Labels, deviations: Mapping[str, float]) -> Entry:
    shortened = (_shortened(label, structure.id) for label in structure.vertex_labels)
    return {
        "plugin": visible(plugin),
        "id": visible(structure.id),
        "label": visible(structure.label),
        "attributes": {visible(name): _attribute(value) for name, value in structure.attributes.items()},
        "labels": [labels.setdefault(label, len(labels)) for label in shortened],
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


def units(places: Sequence[Floats]) -> list[int]:
    """The coordinates of places, each (n, 3) m, as whole numbers of `UNIT_M`."""
    return list(_whole(_stacked(places)))


def _whole(values: Floats) -> Iterator[int]:
    yield from np.round(np.ravel(values) / UNIT_M).astype(np.int64).tolist()


def digits(values: Floats) -> list[float]:
    """Numbers in a row, to so many digits, whole ones without a point."""
    return [float(f"{value:.{DIGITS}g}") for value in np.ravel(values)]


def _stacked(parts: Sequence[Floats]) -> Floats:
    return np.concatenate(parts) if parts else np.zeros((0, 3))
