"""Signs in the factor graph and in the map: constraints of their corners, structures of the solution, and the bay of
each."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from savmap.geometry.triangulate import nearest_points
from savmap.graph import (
    Constraints,
    KeySpace,
    Relation,
    Solution,
    equal_coordinate,
    flat,
    graph_of,
    image_measurements,
    known_distance,
    rectangle,
    sight_lines,
)
from savmap.types import Axis, Floats, RowFacts, Solid, Structure, Track, Trajectory
from savmap_signs.features import PARTS
from savmap_signs.settings import Settings

NEAR_SIZE_SHARE, NEAR_PLANE_DEG = 0.15, 15.0  # of known sizes and planes, for a sign to have them
NORMALS: Mapping[str, Axis] = {"face": "z", "across": "x", "floor": "y"}
LOST_M = 0.5  # standard deviation of a corner that the solve did not determine
THICKNESS_M = 0.002  # of a plate; assumed
RING = np.array([[0, 1], [1, 2], [2, 3], [3, 0]], dtype=np.int64)
SECTION = "bay"
AT_FACE_M, BESIDE_M = 0.6, 0.4  # of a sign's middle: before or behind the face; left or right of a bay


def constrain(
    tracks: Sequence[Track], facts: RowFacts, start: Trajectory, plugin: str, config: Settings
) -> Constraints:
    """Projection factors of all corners, a factor of shape for each sign, and relations of what the settings know."""
    keys = KeySpace(plugin).keys(track.name for track in tracks)
    initial = {track.name: _initial_position(track, facts, start) for track in tracks}
    signs = [[track.name for track in sign_tracks] for sign_tracks in _tracks_by_sign(tracks).values()]
    shape = {"rectangle": rectangle, "flat": flat}[config.shape]
    relations = [
        relation
        for names in signs
        for relation in _relations(names, keys, np.array([initial[name] for name in names]), config)
    ]
    return Constraints(
        plugin=plugin,
        keys=keys,
        measurements=image_measurements(tracks, keys, facts.views),
        relations=tuple(relations),
        initial=initial,
        factors=graph_of([shape([keys[name] for name in names], config.shape_sigma_m) for names in signs]),
    )


def _tracks_by_sign(tracks: Sequence[Track]) -> dict[int, list[Track]]:
    """The four tracks of each sign, in the order of `PARTS`."""
    grouped: dict[int, list[Track]] = {}
    for track in sorted(tracks, key=lambda track: PARTS.index(str(track.place["part"]))):
        grouped.setdefault(int(track.place["sign"]), []).append(track)
    return grouped


def _initial_position(track: Track, facts: RowFacts, start: Trajectory) -> Floats:
    """The point (3,) m nearest to the rays of a track from the camera's first path."""
    origins, rays = sight_lines(track, facts, start)
    point: Floats = nearest_points(origins, rays[None])[0]
    return point


def _relations(names: Sequence[str], keys: Mapping[str, int], quad: Floats, config: Settings) -> Iterator[Relation]:
    corners = [keys[name] for name in names]
    size = nearest_size(quad, config.sizes_m)
    if size is not None:
        sign = names[0].partition(" / ")[0]
        yield known_distance(corners[0], corners[1], size[0], config.size_sigma_m, f"width of {sign}")
        yield known_distance(corners[0], corners[3], size[1], config.size_sigma_m, f"height of {sign}")
    for axis in _parallel_axes(quad, config.parallel):
        yield from (equal_coordinate(axis, corners[0], other, config.shape_sigma_m) for other in corners[1:])


def nearest_size(quad: Floats, sizes: Sequence[tuple[float, float]]) -> tuple[float, float] | None:
    """The known size, width and height in metres, that corners (4, 3) m are within 15 % of; None if there is none."""
    measured = np.array(_size(quad))
    deviations = {size: float(np.abs(measured / np.array(size) - 1).max()) for size in sizes}
    near = [size for size in sizes if deviations[size] < NEAR_SIZE_SHARE]
    return min(near, key=lambda size: deviations[size], default=None)


def _size(quad: Floats) -> tuple[float, float]:
    """Width and height, m, of corners (4, 3): means of opposite sides."""
    sides = np.linalg.norm(np.roll(quad, -1, axis=0) - quad, axis=1)
    return float(sides[[0, 2]].mean()), float(sides[[1, 3]].mean())


def _parallel_axes(quad: Floats, planes: Sequence[str]) -> Iterator[Axis]:
    """The normals of those of the planes that corners (4, 3) m are nearly parallel to."""
    normal = _normal(quad)
    for plane in planes:
        if abs(normal["xyz".index(NORMALS[plane])]) > np.cos(np.radians(NEAR_PLANE_DEG)):
            yield NORMALS[plane]


def _normal(quad: Floats) -> Floats:
    """The unit normal (3,) of corners (4, 3) in order."""
    normal = np.cross(quad[2] - quad[0], quad[3] - quad[1])
    unit: Floats = normal / np.linalg.norm(normal)
    return unit


def describe(tracks: Sequence[Track], solution: Solution, plugin: str) -> list[Structure]:
    """One structure "sign k" for each sign. A sign is left out if a corner's standard deviation reaches `LOST_M`."""
    signs = [
        _structure(number, sign_tracks, solution, plugin) for number, sign_tracks in _tracks_by_sign(tracks).items()
    ]
    return [sign for sign in signs if np.sqrt(np.linalg.eigvalsh(sign.covariances).max()) < LOST_M]


def _structure(number: int, tracks: Sequence[Track], solution: Solution, plugin: str) -> Structure:
    landmarks = [solution.landmarks_of(plugin)[track.name] for track in tracks]
    vertices = np.array([landmark.position for landmark in landmarks])
    width, height = _size(vertices)
    place = tracks[0].place
    return Structure(
        id=f"sign {number}",
        label=tracks[0].label,
        vertices=vertices,
        covariances=np.array([landmark.covariance for landmark in landmarks]),
        vertex_labels=tuple(track.name for track in tracks),
        edges=RING,
        attributes={
            "sign": number,
            "text": str(place["text"]),
            "confidence": int(place["per_mille"]) / 1000,
            "code": str(place["code"]),
            "width_m": round(width, 4),
            "height_m": round(height, 4),
            "observations": sum(landmark.observations for landmark in landmarks),
        },
        solid=Solid(vertices, THICKNESS_M * _normal(vertices), assumed=True, ifc_class="IfcSign"),
    )


def with_bays(signs: Sequence[Structure], others: Mapping[str, Sequence[Structure]]) -> list[Structure]:
    """Signs at the face get the attribute `bay`, such as "bay 3": the bay in front of which they hang. A sign at an
    upright belongs to the bay that begins there, as one faces it. Bays are what others mapped with an attribute
    `bay`."""
    spans = _section_spans([part for parts in others.values() for part in parts if SECTION in part.attributes])
    return [_with_bay(sign, spans) for sign in signs]


def _section_spans(parts: Sequence[Structure]) -> dict[int, tuple[float, float]]:
    """From where to where, m along x, each bay reaches."""
    positions: dict[int, list[float]] = {}
    for part in parts:
        positions.setdefault(int(float(part.attributes[SECTION])), []).extend(part.vertices[:, 0].tolist())
    return {number: (min(x), max(x)) for number, x in sorted(positions.items())}


def _with_bay(sign: Structure, spans: Mapping[int, tuple[float, float]]) -> Structure:
    x, _, z = np.asarray(sign.vertices.mean(axis=0)).tolist()
    inside = [number for number, (left, right) in spans.items() if left <= x <= right]
    begins = [number for number, (left, _) in spans.items() if left - BESIDE_M <= x < left]
    ends = [number for number, (_, right) in spans.items() if right < x <= right + BESIDE_M]
    sections = inside or begins or ends
    if abs(z) > AT_FACE_M or not sections:
        return sign
    return replace(sign, attributes={**sign.attributes, "bay": f"{SECTION} {sections[0]}"})
