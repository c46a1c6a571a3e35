"""What plugins of points have in common, from views to drawings: objects whose feet, tops, ends or centres are mapped.

An object is told from others by where its anchor (a foot on the floor, a centre below the ceiling) lies in a level plane. Its tracks
are named "pillar 1 / foot", "pillar 1 / top", and their place is {"pillar": 1, "part": "foot"}.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from savmap.errors import OutputError, StructureError
from savmap.geometry.triangulate import nearest_point
from savmap.types import (
    Axis,
    Detection,
    Feature,
    Floats,
    Ints,
    Measured,
    Panorama,
    RowFacts,
    Structure,
    Track,
    Trajectory,
    View,
    ViewPlan,
    ViewSpec,
)
from savmap.vision import peaks
from savmap.vision.field_of_view import fit_height
from savmap.vision.view_planning import Face, Manual, PassPreview, choose_face, face_at

if TYPE_CHECKING:
    from savmap.evaluation import Score
    from savmap.graph import Constraints, KeySpace, Landmark, Relation, Solution
    from savmap.report.drawing import Drawing

Mask = NDArray[np.bool_]
BORDER_PX = 2


def face_view_plan(
    pass_preview: PassPreview,
    predict: Callable[[View], list[Detection]],
    side: Literal["left", "right"] | None,
    manual: Mapping[str, Manual],
    attitude: Floats | None,
    name: str,
) -> ViewPlan:
    """One view at the face that shows all masks from their lowest to their highest row, as narrow as may be.

    attitude: world_from_rig (3, 3) where an earlier plugin found the face; else the level direction with the largest masks. The
    plan does not claim to know the face. Without views, and with a note, where nothing is detected.
    """
    try:
        face = face_at(attitude) if attitude is not None else face_with_most(pass_preview, predict, side)
        fitted = fit_height(pass_preview, face, lambda view: rows_of(predict(view)), manual.get(name, Manual()), name)
    except StructureError as error:
        return ViewPlan((), notes=(f"{name}: {error}",))
    return ViewPlan((fitted.spec,), notes=(fitted.warning,) if fitted.warning else ())


def face_with_most(
    pass_preview: PassPreview, predict: Callable[[View], list[Detection]], side: Literal["left", "right"] | None
) -> Face:
    """The level direction whose views are covered most by masks. Raises StructureError where there are none."""

    def share(spec: ViewSpec, panorama: Panorama) -> float:
        return float(sum(detection.mask.mean() for detection in predict(pass_preview.renderer.render(panorama, spec))))

    return choose_face(pass_preview, share, side)


def rows_of(detections: Sequence[Detection]) -> tuple[float, float] | None:
    """The top and the bottom row of all masks in a view, px; None without any."""
    spans = [np.flatnonzero(detection.mask.any(axis=1))[[0, -1]] for detection in detections if detection.mask.any()]
    return (float(min(top for top, _ in spans)), float(max(low for _, low in spans))) if spans else None


def touches_border(mask: Mask) -> bool:
    """Whether a mask (h, w) comes within two pixels of the view's border, so that an end may be missing."""
    inner = mask[BORDER_PX:-BORDER_PX, BORDER_PX:-BORDER_PX]
    return bool(mask.sum() > inner.sum())


def upright_ends(mask: Mask) -> tuple[Floats, Floats]:
    """Where the lower and the upper border of a mask (h, w) are in the middle of its width there: pixels (2,) each, x then y."""
    rows = np.flatnonzero(mask.any(axis=1))
    low, high = int(rows[-1]), int(rows[0])
    foot, top = (float(np.flatnonzero(mask[row]).mean()) for row in (low, high))
    return np.array([foot, low + 0.5]), np.array([top, high - 0.5])


def point_feature(
    view: View, detection: Detection, instance: int, part: str, pixel: Floats, sigma_px: float
) -> Feature:
    """A point of the object that a detection shows: pixel (2,), x then y, with a round covariance."""
    covariance = np.eye(2)[None] * sigma_px**2
    return Feature(
        view.frame, view.spec.name, detection.label, part, instance, pixel[None], covariance, score=detection.score
    )


@dataclass(frozen=True, eq=False)
class Sightings:
    """Points seen above the camera, or below it: the features, their frames (n,), the camera's positions (n, 3) m, and the slopes
    (n, 2) of their rays: metres along x and z for each metre upwards."""

    features: Sequence[Feature]
    frames: Ints
    origins: Floats
    slopes: Floats

    def where(self, keep: Mask) -> "Sightings":
        """Those for which a mask (n,) is true."""
        chosen = [feature for feature, kept in zip(self.features, keep, strict=True) if kept]
        return Sightings(chosen, self.frames[keep], self.origins[keep], self.slopes[keep])

    def at(self, level_m: float) -> Floats:
        """Where the rays meet the plane y = `level_m`: (n, 2) x and z, m."""
        return self.origins[:, [0, 2]] + (level_m - self.origins[:, 1:2]) * self.slopes

    def of_part(self, part: str) -> Mask:
        """Which of them are of a part (n,)."""
        return np.array([feature.part == part for feature in self.features], dtype=bool)


def sightings(
    features: Sequence[Feature], facts: RowFacts, path: Trajectory, upwards: bool, max_slope: float
) -> Sightings:
    """The points whose rays rise (or, unless `upwards`, fall) with at most `max_slope` metres aside for each metre; frames that are
    not in the path are left out."""
    world_from_rig = dict(zip(path.frames.tolist(), path.world_from_rig, strict=True))
    kept = [feature for feature in features if feature.frame in world_from_rig]
    poses = np.array([world_from_rig[feature.frame] for feature in kept]).reshape(-1, 4, 4)
    rig_rays = np.array([facts.views[feature.view].rig_rays(feature.pixels[0]) for feature in kept]).reshape(-1, 3)
    rays = np.einsum("nij,nj->ni", poses[:, :3, :3], rig_rays)
    climb = rays[:, 1] if upwards else -rays[:, 1]
    steep = (climb > 0) & (np.hypot(rays[:, 0], rays[:, 2]) < max_slope * climb)
    slopes = rays[:, [0, 2]] / np.where(steep, rays[:, 1], 1.0)[:, None]
    frames = np.array([feature.frame for feature in kept], dtype=np.int64)
    return Sightings(kept, frames, poses[:, :3, 3], slopes).where(steep)


def track_of(number: int, part: str, features: Sequence[Feature]) -> Track:
    """The track of one point of object `number`, from the point features that show it."""
    label = features[0].label
    return Track(
        name=f"{label} {number} / {part}",
        label=label,
        place={label: number, "part": part},
        frames=np.array([feature.frame for feature in features], dtype=np.int64),
        views=tuple(feature.view for feature in features),
        pixels=np.concatenate([feature.pixels for feature in features]),
        covariances=np.concatenate([feature.covariance for feature in features]),
    )


def tracks_on_floor(
    features: Sequence[Feature],
    facts: RowFacts,
    path: Trajectory,
    anchor: str,
    same_m: float,
    least_frames: int = 3,
    max_slope: float = 10.0,
) -> list[Track]:
    """Tracks of objects that stand on the floor, y = 0, numbered along x: a track for each part of each object.

    The rays of the part `anchor` are put on the floor from the camera's path; those that agree in x within `same_m` are one object,
    and the other parts belong to the anchor of their instance. Raises StructureError where none is seen in `least_frames` frames.
    """
    feet = sightings([feature for feature in features if feature.part == anchor], facts, path, False, max_slope)
    x = feet.at(0.0)[:, 0]
    places = peaks.peaks(x, same_m, least_frames)
    if not len(places):
        raise StructureError(f"nothing was seen in {least_frames} frames: was the network trained on such?")
    seen: dict[tuple[int, str, int], list[Feature]] = {}
    for feature in features:
        seen.setdefault(_instance(feature), []).append(feature)
    tracks: list[Track] = []
    for number, place in enumerate(places, start=1):
        anchors = feet.where(np.abs(x - place) <= same_m).features
        parts = [feature for foot in anchors for feature in seen[_instance(foot)]]
        tracks += [track_of(number, part, group) for part, group in _by_part(parts)]
    return tracks


def _instance(feature: Feature) -> tuple[int, str, int]:
    return feature.frame, feature.view, feature.instance


def _by_part(features: Iterable[Feature]) -> list[tuple[str, list[Feature]]]:
    groups: dict[str, list[Feature]] = {}
    for feature in features:
        groups.setdefault(feature.part, []).append(feature)
    return list(groups.items())


def keys_by_object(tracks: Sequence[Track], keys: "KeySpace") -> dict[str, dict[str, int]]:
    """The keys of each object's parts that are tracked: {"pillar 1": {"foot": key, "top": key}}; those of `point_constraints`."""
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
    """A landmark for each track, observed in all its pixels, first where the rays from the path come nearest to one another. The
    relations bind keys of `keys_by_object`."""
    from savmap.graph import Constraints, observe, sight_lines  # gtsam takes long to import

    key_of = keys.keys([track.name for track in tracks])
    first = {track.name: nearest_point(*sight_lines(track, facts, path)) for track in tracks}
    return Constraints(keys.room, key_of, observe(tracks, key_of, facts.views), tuple(relations), first)


def point_structures(tracks: Sequence[Track], landmarks: "Mapping[str, Landmark]", lost_m: float) -> list[Structure]:
    """A structure for each object, "pillar 1", with a vertex for each of its parts in the order of their names, joined by edges in
    that order; attributes: its number and how many observations it has.

    One with a vertex that the solve could not place within `lost_m`, one standard deviation, is left out.
    """
    ordered = sorted(tracks, key=lambda track: (_number(track), track.name))
    groups = [list(group) for _, group in groupby(ordered, key=_number)]
    structures = [_structure(group, [landmarks[track.name] for track in group]) for group in groups]
    return [own for own in structures if np.sqrt(np.linalg.eigvalsh(own.covariances).max()) < lost_m]


def with_sizes(
    structures: Sequence[Structure], solution: "Solution", plugin: str, sizes: Mapping[str, tuple[str, str, Axis]]
) -> list[Structure]:
    """Structures of `point_structures` with sizes as attributes, each with its standard deviation: {"height_m": ("foot", "top", "y")} is
    how far the top lies beyond the foot along y. Sizes between parts that one does not have are left out."""
    return [_with_sizes(structure, solution, plugin, sizes) for structure in structures]


def _with_sizes(
    structure: Structure, solution: "Solution", plugin: str, sizes: Mapping[str, tuple[str, str, Axis]]
) -> Structure:
    places = dict(zip(structure.vertex_labels, structure.vertices, strict=True))
    measured: dict[str, Measured] = {}
    for size, (first, last, axis) in sizes.items():
        if {first, last} <= places.keys():
            column = "xyz".index(axis)
            name, other = (f"{structure.id} / {part}" for part in (first, last))
            sigma = solution.difference_sigma(plugin, name, other, column)
            measured[size] = Measured(float(places[last][column] - places[first][column]), sigma)
    return replace(structure, attributes={**structure.attributes, **measured})


def _object(track: Track) -> str:
    return f"{track.label} {_number(track)}"


def _number(track: Track) -> int:
    return int(track.place[track.label])


def _structure(tracks: Sequence[Track], points: "Sequence[Landmark]") -> Structure:
    label = tracks[0].label
    return Structure(
        id=_object(tracks[0]),
        label=label,
        vertices=np.array([point.position for point in points]),
        covariances=np.array([point.covariance for point in points]),
        vertex_labels=tuple(str(track.place["part"]) for track in tracks),
        edges=np.array([[k, k + 1] for k in range(len(points) - 1)], dtype=np.int64).reshape(-1, 2),
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
) -> "Score":
    """How far the objects' vertices are from the surveyed points (n, k, 3), m; empty without a survey.

    Objects are matched one to one, as many as there can be whose points are all nearer than `gate_m`, then with the least sum of
    distances. ends_x: only objects between these are asked for; others may be mapped, and are not spurious. points: what of an object
    is compared (k, 3), if not its k vertices.
    """
    from savmap.evaluation import Distances, Score  # with scipy, which only scoring needs
    from savmap.geometry.matching import matched

    if truth is None:
        return Score()
    mapped = np.array([points(structure) for structure in structures]).reshape(-1, *truth.shape[1:])
    apart = np.linalg.norm(truth[:, None] - mapped[None], axis=-1)
    pairs = matched(apart.max(axis=-1, initial=0.0), gate_m)
    wanted, inside = (_between(points, ends_x) for points in (truth, mapped))
    hits = {j: apart[i, j] for i, j in pairs.items() if wanted[i]}
    spurious = [j for j in range(len(mapped)) if inside[j] and j not in pairs.values()]
    deviations = {structures[j].id: float(distances.max()) for j, distances in hits.items()}
    deviations |= {structures[j].id: float("inf") for j in spurious}
    distances = np.concatenate([np.zeros(0), *hits.values()])
    return Score(
        apart={heading: Distances(distances, int(wanted.sum()) - len(hits), len(spurious))}, deviations=deviations
    )


def _between(points: Floats, ends_x: tuple[float, float]) -> Mask:
    """Which objects (n, k, 3) have their middle between two x."""
    x = points[..., 0].mean(axis=1)
    between: Mask = (x >= ends_x[0]) & (x <= ends_x[1])
    return between


def draw_points(
    structures: Sequence[Structure], truth: Floats | None, deviations: Mapping[str, float], off_m: float, legend: str
) -> "tuple[Drawing, ...]":
    """Objects as lines through their points, or as a point; the surveyed ones (n, k, 3) underneath, as lines, and those marked that
    are off by more than `off_m`."""
    from savmap.report.drawing import Drawing  # only drawing needs it

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
