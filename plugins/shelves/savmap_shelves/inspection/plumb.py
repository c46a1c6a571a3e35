"""How far uprights lean along the aisle, by what the frames show of them once the map is solved.

The map takes uprights to be upright and beams to be level. Here its heights and depths are kept, and each upright gets
two unknowns: a shift and a lean. The pose of a frame may move with them; beams, which stay level, tell how far it is
rolled, so that the lean is the upright's. It is a linear least-squares problem in the plane of the face, from which
poses are eliminated frame by frame (Schur complement), with Huber's weights.
"""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from savmap.graph import Landmark
from savmap.types import Floats, Measured, RowFacts, Structure, Track, Trajectory, ViewSpec, array_record
from savmap_shelves.mapping import number_of

LEAN = "lean_permille"
"""The attribute of an upright: how far it leans towards +x, mm in 1 m."""
PERMILLE = 1000.0
POSE_SIGMAS = np.array([0.05, 0.05, 0.05, 0.02, 0.02, 0.02])
SHIFT_M, MOST_LEAN = 0.1, 0.05
"""How far poses (m, rad) and uprights may be off, and how much these may lean: so loosely that the pictures decide."""
ROUNDS, HUBER, NORMAL = 10, 2.0, 0.6745
"""NORMAL: the median of absolute values that are normally distributed, in standard deviations."""
LEAST_FRAMES = 8
"""Frames that must show an upright."""
LEAST_COSINE = 0.05
"""Of the angle between a ray and the face's normal: flatter ones are left out."""
COMMON_PERMILLE = 0.3
"""What errors that all frames share, as of a panorama's seams, add to the standard deviation: a tenth of a pixel, of
2048 around, at both ends of 3 m of an upright that is seen from 2 m."""


@dataclass(frozen=True, eq=False)
@array_record
class Equations:
    """What a frame tells of places in the face: how far they are off (n,) m, how that goes with the frame's pose (n, 6)
    and with the uprights' shifts and leans (n, 2 k), and their weights (n,) 1 / m."""

    errors: Floats
    poses: Floats
    uprights: Floats
    weights: Floats


def with_leans(
    structures: Sequence[Structure],
    tracks: Sequence[Track],
    facts: RowFacts,
    path: Trajectory,
    landmarks: Mapping[str, Landmark],
) -> list[Structure]:
    """The structures, uprights with the attribute `LEAN` where enough frames show them."""
    measured = leans(tracks, facts, path, landmarks)

    def leaning(part: Structure) -> Structure:
        number = number_of(part, "upright") if part.label == "upright" else -1
        if number not in measured:
            return part
        return replace(part, attributes={**part.attributes, LEAN: measured[number]})

    return [leaning(part) for part in structures]


def leans(
    tracks: Sequence[Track], facts: RowFacts, path: Trajectory, landmarks: Mapping[str, Landmark]
) -> dict[int, Measured]:
    """By upright, how far it leans towards +x, mm in 1 m; none of uprights that too few frames show."""
    standing = [track for track in tracks if track.name in landmarks and track.place.get("end") != "foot"]
    shown: dict[int, set[int]] = defaultdict(set)
    for track in standing:
        shown[_upright(track)].update(track.frames.tolist())
    numbers = sorted(number for number, frames in shown.items() if len(frames) >= LEAST_FRAMES)
    if not numbers:
        return {}
    values, sigmas = _solved(list(_equations(standing, facts, path, landmarks, numbers)), len(numbers))
    return {
        number: Measured(PERMILLE * float(value), float(np.hypot(PERMILLE * sigma, COMMON_PERMILLE)))
        for number, value, sigma in zip(numbers, values, sigmas, strict=True)
    }


def _upright(track: Track) -> int:
    """The number of the upright at whose edge a track lies."""
    place = track.place
    return int(place["upright"]) if "upright" in place else int(place["bay"]) + (place["side"] == "right")


def _equations(
    tracks: Sequence[Track],
    facts: RowFacts,
    path: Trajectory,
    landmarks: Mapping[str, Landmark],
    numbers: Sequence[int],
) -> Iterator[Equations]:
    """Of each frame: an equation across an upright's edge for each of its ends, and two for a beam's corner."""
    poses = dict(zip(path.frames.tolist(), path.world_from_rig, strict=True))
    column = {number: 2 * k for k, number in enumerate(numbers)}
    lines: dict[int, list[tuple[float, Floats, Floats, float]]] = defaultdict(list)
    for track in tracks:
        point, at = landmarks[track.name].position, column.get(_upright(track))
        seen = zip(track.frames.tolist(), track.views, track.pixels, track.covariances, strict=True)
        for frame, view, pixel, covariance in seen:
            place = (
                _place_in_face(facts.views[view], poses[frame], point[2], pixel, covariance) if frame in poses else None
            )
            if place is None:
                continue
            for axis in (0, 1) if track.label == "beam" else (0,):
                of_uprights = np.zeros(2 * len(numbers))
                if axis == 0 and at is not None:
                    of_uprights[at : at + 2] = 1.0, place.position[1]
                error = float(place.position[axis] - point[axis])
                lines[frame].append((error, place.slopes[axis], of_uprights, place.weights[axis]))
    for frame_lines in lines.values():
        yield Equations(*(np.array(part) for part in zip(*frame_lines, strict=True)))


@dataclass(frozen=True, eq=False)
class FacePlace:
    """Where a pixel's ray meets the face: x and y (2,) m, their slopes (2, 6) by the pose's place and rotation, and
    their weights (2,) 1 / m, each with the other held."""

    position: Floats
    slopes: Floats
    weights: Floats


def _place_in_face(spec: ViewSpec, pose: Floats, z: float, pixel: Floats, covariance: Floats) -> FacePlace | None:
    """None for a ray that hardly meets it."""
    rays = spec.rig_rays(pixel + np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])) @ pose[:3, :3].T
    if rays[:, 2].max() > -LEAST_COSINE:
        return None
    lengths = (z - pose[2, 3]) / rays[:, 2]
    places = pose[:3, 3] + lengths[:, None] * rays
    by_pixel = (places[1:, :2] - places[0, :2]).T
    information = np.linalg.inv(by_pixel @ covariance @ by_pixel.T)
    ray, turned = rays[0], np.cross(np.eye(3), rays[0])
    tangents = ray[:2] / ray[2]
    by_place = np.column_stack([np.eye(2), -tangents])
    by_turn = lengths[0] * (turned[:, :2].T - tangents[:, None] * turned[:, 2])
    return FacePlace(places[0, :2], np.hstack([by_place, by_turn]), np.sqrt(np.diag(information)))


def _solved(frames: Sequence[Equations], count: int) -> tuple[Floats, Floats]:
    """Leans and their standard deviations (count,) of uprights, by iteratively reweighted least squares."""
    prior = np.diag(np.tile([SHIFT_M**-2.0, MOST_LEAN**-2.0], count))
    unknowns: Floats = np.zeros(2 * count)
    residuals, scale = [part.errors for part in frames], np.inf
    normal: Floats = prior
    for _ in range(ROUNDS):
        normal, right, gains = prior.copy(), np.zeros(2 * count), list[Floats]()
        for part, residual in zip(frames, residuals, strict=True):
            large = np.abs(residual) * part.weights / (HUBER * scale)
            roots = part.weights / np.sqrt(np.maximum(1.0, large))
            a, b, e = roots[:, None] * part.poses, roots[:, None] * part.uprights, roots * part.errors
            gain = np.linalg.solve(a.T @ a + np.diag(POSE_SIGMAS**-2.0), a.T)
            normal += b.T @ b - (b.T @ a) @ (gain @ b)
            right += b.T @ e - (b.T @ a) @ (gain @ e)
            gains.append(gain * roots)
        unknowns = np.linalg.solve(normal, right).astype(np.float64)
        residuals = [
            (rest := part.errors - part.uprights @ unknowns) - part.poses @ (gain @ rest)
            for part, gain in zip(frames, gains, strict=True)
        ]
        scaled = np.concatenate([np.abs(rest) * part.weights for part, rest in zip(frames, residuals, strict=True)])
        scale = max(float(np.median(scaled)) / NORMAL, np.finfo(float).tiny)
    sigmas = scale * np.sqrt(np.diag(np.linalg.inv(normal)))
    return unknowns[1::2], sigmas[1::2]
