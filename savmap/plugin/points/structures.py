"""From tracks of points to the graph, to structures in the map, to scores and drawings."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import groupby
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from savmap.errors import OutputError
from savmap.geometry.triangulate import nearest_point
from savmap.types import Axis, Floats, Measured, RowFacts, Structure, Track, Trajectory

if TYPE_CHECKING:
    from savmap.graph import Constraints, KeySpace, Landmark, Relation, Solution
    from savmap.types import Drawing, Score

Mask = NDArray[np.bool_]


def keys_by_object(tracks: Sequence[Track], keys: "KeySpace") -> dict[str, dict[str, int]]:
    """The keys of each object's parts that are tracked: {"pillar 1": {"foot": key, "top": key}}; those of
    `point_constraints`."""
    objects: dict[str, dict[str, int]] = {}
    for track, key in zip(tracks, keys.keys([track.name for track in tracks]).values(), strict=True):
        objects.setdefault(_object(track), {})[str(track.place["part"])] = key
    return objects


def point_constraints(
    tracks: Sequence[Track],
    facts: RowFacts,
    path: Trajectory,
    keys: "KeySpace",
    relations: "Iterable[Relation]" = (),
) -> "Constraints":
    """A landmark for each track, observed in all its pixels, first where the rays from the path come nearest to one
    another. The relations bind keys of `keys_by_object`."""
    from savmap.graph import Constraints, image_measurements, sight_lines  # gtsam takes long to import

    key_of = keys.keys([track.name for track in tracks])
    first = {track.name: nearest_point(*sight_lines(track, facts, path)) for track in tracks}
    return Constraints(keys.plugin, key_of, image_measurements(tracks, key_of, facts.views), tuple(relations), first)


def point_structures(
    tracks: Sequence[Track], landmarks: "Mapping[str, Landmark]", lost_m: float, closed: bool = False
) -> list[Structure]:
    """A structure for each object, "pillar 1", with a vertex for each of its tracks, joined by edges in their order,
    and, if `closed`, the last with the first; attributes: its number and how many observations it has.

    One with a vertex that the solve could not place within `lost_m`, one standard deviation, is left out.
    """
    groups = [list(group) for _, group in groupby(sorted(tracks, key=_number), key=_number)]
    structures = [_structure(group, [landmarks[track.name] for track in group], closed) for group in groups]
    return [each for each in structures if np.sqrt(np.linalg.eigvalsh(each.covariances).max()) < lost_m]


def with_sizes(
    structures: Sequence[Structure], solution: "Solution", plugin: str, sizes: Mapping[str, tuple[str, str, Axis]]
) -> list[Structure]:
    """Structures of `point_structures` with sizes as attributes, each with its standard deviation: {"height_m":
    ("foot", "top", "y")} is how far the top lies beyond the foot along y. Sizes between parts that one does not have
    are left out."""
    sized = []
    for structure in structures:
        places = dict(zip(structure.vertex_labels, structure.vertices, strict=True))
        measured: dict[str, Measured] = {}
        for size, (first, last, axis) in sizes.items():
            if {first, last} <= places.keys():
                column = "xyz".index(axis)
                name, other = (f"{structure.id} / {part}" for part in (first, last))
                sigma = solution.difference_sigma(plugin, name, other, column)
                measured[size] = Measured(float(places[last][column] - places[first][column]), sigma)
        sized.append(replace(structure, attributes={**structure.attributes, **measured}))
    return sized


def _object(track: Track) -> str:
    return f"{track.label} {_number(track)}"


def _number(track: Track) -> int:
    return int(track.place[track.label])


def _structure(tracks: Sequence[Track], points: "Sequence[Landmark]", closed: bool) -> Structure:
    label, count = tracks[0].label, len(points)
    edges = [[k, (k + 1) % count] for k in range(count if closed else count - 1)]
    return Structure(
        id=_object(tracks[0]),
        label=label,
        vertices=np.array([point.position for point in points]),
        covariances=np.array([point.covariance for point in points]),
        vertex_labels=tuple(str(track.place["part"]) for track in tracks),
        edges=np.array(edges, dtype=np.int64).reshape(-1, 2),
        attributes={label: _number(tracks[0]), "observations": sum(point.observations for point in points)},
    )


def surveyed_points(survey: Mapping[str, Any], key: str, count: int) -> Floats | None:
    """The objects of a row in a survey file: points (n, count, 3) m under `key`; None where it has none.

    Raises OutputError where they are no numbers, or not so many.
    """
    if key not in survey:
        return None
    try:
        points = np.asarray(survey[key], dtype=np.float64).reshape(-1, count, 3)
    except (TypeError, ValueError):
        raise OutputError(f"survey: {key}: each entry should have {count} points of x, y, z in metres") from None
    if not np.isfinite(points).all():
        raise OutputError(f"survey: {key}: a coordinate is not finite")
    return points


def score_points(
    structures: Sequence[Structure],
    truth: Floats | None,
    gate_m: float,
    heading: str,
    ends_x: tuple[float, float] = (-np.inf, np.inf),
    points: Callable[[Structure], Floats] = lambda structure: structure.vertices,
    asked: Mask | None = None,
) -> "Score":
    """How far the objects' vertices are from the surveyed points (n, k, 3), m; empty without a survey.

    Objects are matched one to one, as many as there can be whose points are all nearer than `gate_m`, then with the
    least sum of distances. ends_x: only objects between these are asked for; others may be mapped, and are not
    spurious. points: what of an object is compared (k, 3), if not its k vertices. asked: only these of the surveyed
    (n,) are asked for.
    """
    from savmap.geometry.matching import matched
    from savmap.types import Distances, Score  # with scipy, which only scoring needs

    if truth is None:
        return Score()
    mapped = np.array([points(structure) for structure in structures]).reshape(-1, *truth.shape[1:])
    separations = np.linalg.norm(truth[:, None] - mapped[None], axis=-1)
    pairs = matched(separations.max(axis=-1, initial=0.0), gate_m)
    middles_x = [points[..., 0].mean(axis=1) for points in (truth, mapped)]
    wanted, inside = ((x >= ends_x[0]) & (x <= ends_x[1]) for x in middles_x)
    wanted &= np.ones(len(truth), np.bool_) if asked is None else asked
    hits = {j: separations[i, j] for i, j in pairs.items() if wanted[i]}
    spurious = [j for j in range(len(mapped)) if inside[j] and j not in pairs.values()]
    deviations = {structures[j].id: float(distances.max()) for j, distances in hits.items()}
    deviations |= {structures[j].id: float("inf") for j in spurious}
    distances = np.concatenate([np.zeros(0), *hits.values()])
    return Score(
        distances={heading: Distances(distances, int(wanted.sum()) - len(hits), len(spurious))}, deviations=deviations
    )


def draw_points(
    structures: Sequence[Structure], truth: Floats | None, deviations: Mapping[str, float], off_m: float, legend: str
) -> "tuple[Drawing, ...]":
    """Objects as lines through their points, or as a point; the surveyed ones (n, k, 3) underneath, as lines, and those
    marked that are off by more than `off_m`."""
    from savmap.types import Drawing  # only drawing needs it

    surveyed = () if truth is None else truth
    return (
        *(Drawing("line", points, "survey", "fixture", legend) for points in surveyed),
        *(
            Drawing(
                "line" if len(structure.vertices) > 1 else "point",
                structure.vertices,
                "off" if deviations.get(structure.id, 0.0) > off_m else "mapped",
                "fixture",
                legend,
                name=structure.id,
            )
            for structure in structures
        ),
    )
