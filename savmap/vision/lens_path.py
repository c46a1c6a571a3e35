"""The path of an ordinary lens along a face before it is adjusted: how each picture is turned, by the straight lines
that it shows, and where it was, by one linear system for all places and points with these turns held. No chain of
steps that could break, and none whose scale could run away.

World: x along the face, y up, z out of it; the camera looks about along -z. Lengths are in the middle distance of the
points.
"""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.linalg import splu
from scipy.spatial.transform import Rotation

from savmap.errors import StructureError
from savmap.geometry.cameras import Pinhole
from savmap.geometry.vanishing import manhattan_from_segments
from savmap.types import Bools, Floats, Ints, array_record
from savmap.vision.lens_tracks import LensTracks

FIRST_PICTURES, LEAST_SEGMENTS = 5, 7
AROUND, MOST_OFF = 7, float(np.radians(2.0))
"""A turn further from the middle one of so many pictures before and after it is replaced by that."""
LEAST_TRACK, POINTS, LEAST_LINKS = 3, 1500, 12
"""Pictures a point must be seen in; points that are placed; how many must lead from a picture to the next."""
STEEPEST = 2.0
"""Of rays, across a unit of depth, in the world."""
ROUNDS, LEAST_DEPTH = 6, 0.2
DISTANCE_PRIOR, DEPTH_PRIOR, FIRST_PRIOR = 9e3, 1e3, 1e3
"""Weights of: cameras at one distance, points on a plane (both a pixel's), and the first camera at x = y = 0."""


@dataclass(frozen=True, eq=False)
@array_record
class Sightings:
    """Of points in pictures: which picture and point (n,), and the rays through them at depth 1, undistorted (n, 2);
    how many of each there are."""

    frame: Ints
    point: Ints
    at: Floats
    frames: int
    points: int


def turns(tracks: LensTracks, camera: Pinhole) -> Floats:
    """world_from_rig (f, 3, 3) of each picture by its lines, most of which run along, up, or out of the face. Raises
    StructureError where they show no such directions."""
    ends = [(camera.rays(lines[:, :2]), camera.rays(lines[:, 2:])) for lines in tracks.segments]
    a, b = (np.concatenate([pair[side] for pair in ends[:FIRST_PICTURES]] or [np.zeros((0, 3))]) for side in (0, 1))
    first = manhattan_from_segments(a, b)
    if first is None:
        raise StructureError("too few straight edges are seen in the first pictures: is the face in view?")
    axes, last = list[Floats](), first.rig_from_manhattan
    for pair in ends:
        if len(pair[0]) >= LEAST_SEGMENTS and (frame := manhattan_from_segments(*pair, last)) is not None:
            last = frame.rig_from_manhattan
        axes.append(last)
    seen = Rotation.from_matrix(np.stack(axes).transpose(0, 2, 1))
    about = seen[len(axes) // 2]
    vectors = (seen * about.inv()).as_rotvec()
    middle = np.array([np.median(vectors[max(0, k - AROUND) : k + AROUND + 1], axis=0) for k in range(len(vectors))])
    off = np.linalg.norm(vectors - middle, axis=1) > MOST_OFF
    return np.asarray((Rotation.from_rotvec(np.where(off[:, None], middle, vectors)) * about).as_matrix())


def parts(tracks: LensTracks) -> Ints:
    """To which part each picture belongs (f,): too few points lead from one to the next. The longest one is 0."""
    _, _, links = _chosen(tracks)
    part = np.cumsum(np.append(False, links[1:] < LEAST_LINKS))
    order = np.argsort(-np.bincount(part), kind="stable")
    return np.asarray(np.argsort(order)[part])


def chosen(tracks: LensTracks, camera: Pinhole) -> Sightings:
    """Sightings of the longest tracks, so many that every step has its share, ordered by point."""
    used, numbers, _ = _chosen(tracks)
    at = camera.rays(tracks.pixels[used])
    point = np.searchsorted(numbers, tracks.point[used])
    return Sightings(tracks.frame[used], point, at[:, :2] / at[:, 2:], len(tracks.frames), len(numbers))


def _chosen(tracks: LensTracks) -> tuple[Ints, Ints, Ints]:
    """The sightings (n,) of the longest tracks, the numbers of their points, and how many lead to each picture from
    the one before (f,)."""
    count, order = len(tracks.frames), np.lexsort([tracks.frame, tracks.point])
    point, frame = tracks.point[order], tracks.frame[order]
    begin = np.flatnonzero(np.diff(point, prepend=-1))
    length = np.diff(np.append(begin, len(point)))
    long = np.flatnonzero(length >= LEAST_TRACK)
    want = POINTS * length[long].mean() / count if len(long) else 0.0
    links, kept = np.zeros(count, np.int64), np.zeros(len(begin), np.bool_)
    for track in long[np.argsort(-length[long], kind="stable")].tolist():
        first = int(frame[begin[track]])
        steps = slice(first + 1, first + int(length[track]))
        if links[steps].min() < want:
            links[steps] += 1
            kept[track] = True
    return order[np.repeat(kept, length)], point[begin[kept]], links


def first_path(seen: Sightings, world_from_rig: Floats, pixel: float) -> tuple[Floats, Floats]:
    """Poses world_from_rig (f, 4, 4) and points (p, 3) by sightings, for known turns (f, 3, 3); `pixel`: its angle,
    radians. In x and y, a point is off a camera by the ray's slope times how deep it lies before it."""
    rays = np.einsum("nij,nj->ni", world_from_rig[seen.frame], np.column_stack([seen.at, np.ones(len(seen.at))]))
    slope = rays[:, :2] / np.maximum(-rays[:, 2:], 1e-6)
    usable = (np.abs(slope) < STEEPEST).all(axis=1) & (rays[:, 2] < 0)
    x, places = _system(seen, slope, usable, pixel)
    poses = np.tile(np.eye(4), (seen.frames, 1, 1))
    poses[:, :3, :3], poses[:, :3, 3] = world_from_rig, places
    return poses, x


def _system(seen: Sightings, slope: Floats, usable: Bools, pixel: float) -> tuple[Floats, Floats]:
    """Points (p, 3) and places (f, 3): P_xy + m P_z = C_xy + m C_z for each ray of slope m. The mean depth is 1, or
    all would shrink to nothing."""
    frame, point, slope = seen.frame[usable], seen.point[usable], slope[usable].ravel()
    count = seen.frames
    row, ones = np.arange(len(slope)), np.ones(len(slope))
    of_camera, of_point = 3 * np.repeat(frame, 2), 3 * (count + np.repeat(point, 2))
    axis = np.tile([0, 1], len(frame))
    columns = np.stack([of_point + axis, of_point + 2, of_camera + axis, of_camera + 2], axis=1)
    values = np.stack([ones, slope, -ones, -slope], axis=1)
    shape = len(slope), 3 * (count + seen.points)
    equations = sparse.csr_matrix((values.ravel(), (np.repeat(row, 4), columns.ravel())), shape)
    of_cameras = np.tile([1e-9, 1e-9, DISTANCE_PRIOR * pixel**2], count)
    prior = np.concatenate([of_cameras, np.tile([1e-9, 1e-9, DEPTH_PRIOR * pixel**2], seen.points)])
    prior[:2] = FIRST_PRIOR
    target = np.zeros(len(prior))
    target[3 * count + 2 :: 3] = -1.0
    mean, weight = target / max(seen.points, 1), ones
    for _ in range(ROUNDS):
        solve = splu((equations.T @ sparse.diags(weight) @ equations + sparse.diags(prior)).tocsc()).solve
        x, y = solve(prior * target), solve(mean)
        x = x + y * (1 - mean @ x) / (mean @ y)
        places, points = x[: 3 * count].reshape(-1, 3), x[3 * count :].reshape(-1, 3)
        depth = np.maximum(places[frame, 2] - points[point, 2], LEAST_DEPTH)
        error = np.linalg.norm(np.asarray(equations @ x).reshape(-1, 2), axis=1) / depth
        scale = max(1.5 * float(np.median(error)), 0.5 * pixel)
        weight = np.repeat(1 / (1 + (error / scale) ** 2) / depth**2, 2)
    return points, places
