"""How far uprights lean and are bowed along the aisle, and beams are tilted and sag, by what the frames show of them
once the map is solved.

The map takes uprights to be upright, beams to be level, and both to be straight. Here its depths are kept, and each
member gets four unknowns: a shift of each of its two edges, its slope, and its bow, a parabola. They are measured at
parts of the edges, each by itself. The pose of a frame may move with them. What beams tilt at is all that tells how far
frames are rolled: floors and connectors leave bays and beams level to `BAY_TILT` and `BEAM_TILT`. It is a linear
least-squares problem in the plane of the face, from which poses are eliminated frame by frame (Schur complement), with
Huber's weights.
"""

import logging
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from savmap.geometry.pinhole import project
from savmap.graph import Landmark
from savmap.types import (
    Attribute,
    Floats,
    Ints,
    Measured,
    RowFacts,
    Structure,
    Track,
    Trajectory,
    array_record,
)
from savmap_shelves.constraints.track_grid import column_of, is_part
from savmap_shelves.mapping import mean_of

_log = logging.getLogger(__name__)
LEAN, BOW = "lean_permille", "bow_permille"
"""Attributes of an upright: how far it leans towards +x, and its middle lies towards +x of the line between its ends,
mm in 1 m of its height."""
TILT, SAG = "tilt_permille", "sag_m"
"""Attributes of a beam: how much higher its right end is, mm in 1 m, and how far its middle lies below the line between
its ends, m."""
PERMILLE = 1000.0
POSE_SIGMAS = np.array([0.05, 0.05, 0.05, 0.02, 0.02, 0.02])
SHIFT_M, MOST_LEAN, MOST_BOW = 0.1, 0.05, 0.02
"""How far poses (m, rad) and edges may be off, uprights may lean, and, as a share of their length, members may be
bowed: so loosely that the pictures decide."""
BAY_TILT, BEAM_TILT = 0.001, 0.001
"""Standard deviations of how far the floor tilts a bay, and a connector a beam in it: of all that is measured, only
these know where down is."""
ROUNDS, HUBER, NORMAL = 10, 2.0, 0.6745
"""NORMAL: the median of absolute values that are normally distributed, in standard deviations."""
LEAST_FRAMES = 8
"""Frames that must show a member."""
LEAST_COSINE = 0.05
"""Of the angle between a ray and the face's normal: flatter ones are left out."""
COMMON_M = 0.0006
"""What all frames may be off by at a place of a member, as by a panorama's seams: a tenth of a pixel, of 2048 around,
at 2 m. It is in the slope twice, and in the bow as the middle's and as half of each end's."""
WAVE = 0.0007
"""What such errors, as waves over a picture, add to slopes: 0.14 px at 1,280 px a turn tilt what is seen at one place
of it by so much, and with it what neighbouring bays are compared by."""
EDGES = {"upright": ("left", "right"), "beam": ("lower", "upper")}
OF_MEMBER, SLOPE, PARABOLA = 4, 2, 3
"""Unknowns of a member, and which are its slope and its bow."""
CLEARLY = 3.0
"""Standard deviations by which a member must be out of plumb or level to be straightened for the solve."""
OUTER = 0.02
"""Of what is seen of a member beyond its ends, where only the pictures tell these."""
PLACES = 8
"""On each edge of a member: errors at one persist from frame to frame."""
LEAST_SCALE = 0.25
"""Of residuals in their standard deviations: rows have 0.5 to 3, and where less is left, poses took up the rest."""
LEAST_FREEDOM, USUAL = 1.0, 4.0
"""How many degrees of freedom a member must have to tell what is usual of these errors, and how many that counts for
beside what a member's residuals show (an inverse gamma prior, whose mean is taken)."""


@dataclass(frozen=True, eq=False)
class Member:
    """An upright or a beam: its bay (-1: none), where its unknowns begin, and the ends (2,) m between which it is
    measured, y of an upright, x of a beam."""

    id: str
    label: str
    bay: int
    column: int
    ends: Floats

    @property
    def length(self) -> float:
        """m."""
        return float(self.ends[1] - self.ends[0])

    def terms(self, edge: int, along: Floats) -> Floats:
        """How far (n, 4) places on an edge, at `along` (n,) m, move across the member with each of its unknowns."""
        terms = np.zeros((len(along), OF_MEMBER))
        way = along - self.ends.mean()
        terms[:, edge], terms[:, SLOPE], terms[:, PARABOLA] = 1.0, way, 1.0 - (2 * way / self.length) ** 2
        return terms

    def places(self, edge: int, along: Floats) -> Ints:
        """Which (n,) of the places on both edges, `PLACES` on each, are nearest."""
        way = (along - self.ends[0]) / self.length
        return np.asarray(edge * PLACES + np.clip(PLACES * way, 0, PLACES - 1), np.int64)


@dataclass(frozen=True, eq=False)
@array_record
class Equations:
    """What a frame tells of places in the face: how far they are off (n,) m, how that goes with the frame's pose (n, 6)
    and with some unknowns of members (n, k), which these are (k,), weights (n,) 1 / m, the number of the member (n,),
    and which of its `PLACES` it is (n,)."""

    errors: Floats
    poses: Floats
    members: Floats
    columns: Ints
    weights: Floats
    member: Ints
    place: Ints


@dataclass(frozen=True, eq=False)
class Layout:
    """Members by id, where their edges are across them, m, by member and edge, and z of the faces by label, m."""

    members: Mapping[str, Member]
    edges: Mapping[tuple[str, str], float]
    depths: Mapping[str, float]


def with_shapes(
    structures: Sequence[Structure],
    tracks: Sequence[Track],
    facts: RowFacts,
    path: Trajectory,
    landmarks: Mapping[str, Landmark],
) -> list[Structure]:
    """The structures, uprights with the attributes `LEAN` and `BOW`, beams with `TILT` and `SAG`, where enough frames
    show them."""
    shapes = shapes_of(structures, tracks, facts, path, landmarks)
    return [replace(part, attributes={**part.attributes, **shapes.get(part.id, {})}) for part in structures]


def shapes_of(
    structures: Sequence[Structure],
    tracks: Sequence[Track],
    facts: RowFacts,
    path: Trajectory,
    landmarks: Mapping[str, Landmark],
) -> dict[str, dict[str, Attribute]]:
    """By structure, what is measured of its shape, each a `Measured`; none of what too little is seen of."""
    parts = [track for track in tracks if is_part(track)]
    layout = _mapped_layout(structures, parts, path, landmarks)
    return {member.id: _shape(member, *unknowns) for member, *unknowns in _measured(parts, facts, path, layout)}


def straightened(tracks: Sequence[Track], facts: RowFacts, path: Trajectory) -> list[Track]:
    """The tracks as they would be if the members that clearly lean or are tilted, by a path up to scale, did not: a
    grid of upright and level members does not fit what a row shows whose uprights all lean. Parts are as they were."""
    parts = [track for track in tracks if is_part(track)]
    layout = _seen_layout(parts, facts, path)
    slopes = {
        member.id: (float(values[SLOPE]), float(member.ends.mean()))
        for member, values, sigmas in _measured(parts, facts, path, layout)
        if abs(values[SLOPE]) > CLEARLY * np.hypot(sigmas[SLOPE], _common(member)[0])
    }
    return [track if is_part(track) else _straight(track, slopes, facts, path) for track in tracks]


def _straight(track: Track, slopes: Mapping[str, tuple[float, float]], facts: RowFacts, path: Trajectory) -> Track:
    """A track's pixels, moved across the members it is of by what their slopes make of the way from their middles."""
    lean, height = slopes.get(f"upright {column_of(track)[0]}", (0.0, 0.0))
    tilt, middle = slopes.get(_object(track), (0.0, 0.0)) if track.label == "beam" else (0.0, 0.0)
    if not lean and not tilt:
        return track
    poses, pixels = _poses(path), track.pixels.copy()
    for k, (frame, view) in enumerate(zip(track.frames.tolist(), track.views, strict=True)):
        spec, pose = facts.views[view], poses.get(frame)
        if pose is None or (ray := pose[:3, :3] @ spec.rig_rays(pixels[k])).item(2) > -LEAST_COSINE:
            continue
        place = pose[:3, 3] - pose[2, 3] / ray[2] * ray
        place[:2] -= lean * (place[1] - height), tilt * (place[0] - middle)
        moved = project((place - pose[:3, 3])[None] @ pose[:3, :3] @ spec.rig_from_view, spec.camera)[0]
        pixels[k] = moved if np.isfinite(moved).all() else pixels[k]
    return replace(track, pixels=pixels)


def _poses(path: Trajectory) -> dict[int, Floats]:
    return dict(zip(path.frames.tolist(), path.world_from_rig, strict=True))


def _mapped_layout(
    structures: Sequence[Structure], parts: Sequence[Track], path: Trajectory, landmarks: Mapping[str, Landmark]
) -> Layout:
    """As the map has the structures of which enough frames show parts."""
    beams = [float(point.position[2]) for name, point in landmarks.items() if " / beam " in name]
    depths = {"upright": 0.0, "beam": float(np.median(beams)) if beams else 0.0}
    seen = _often_seen(parts, path)
    chosen = [part for part in structures if part.id in seen]
    ends = {part.id: part.vertices[:, 1 if part.label == "upright" else 0] for part in chosen}
    edges = {
        (part.id, edge): mean_of(part, 0 if part.label == "upright" else 1, edge)
        for part in chosen
        for edge in EDGES[part.label]
    }
    return Layout(_members({name: (along.min(), along.max()) for name, along in ends.items()}), edges, depths)


def _seen_layout(parts: Sequence[Track], facts: RowFacts, path: Trajectory) -> Layout:
    """As a path has what enough frames show parts of, in the plane of the uprights' faces."""
    poses, seen = _poses(path), _often_seen(parts, path)
    edges: dict[tuple[str, str], float] = {}
    along: dict[str, list[Floats]] = defaultdict(list)
    for track in parts:
        places = _places_of(track, facts, poses, 0.0)
        if _object(track) in seen and len(places.frames):
            across, way = places.positions.T[:: 1 if track.label == "upright" else -1]
            edges[_object(track), _edge(track)] = float(np.median(across))
            along[_object(track)].append(way)
    ends = {name: np.quantile(np.concatenate(ways), (OUTER, 1 - OUTER)) for name, ways in sorted(along.items())}
    return Layout(_members(ends), edges, {"upright": 0.0, "beam": 0.0})


def _often_seen(parts: Sequence[Track], path: Trajectory) -> set[str]:
    """The ids of what enough frames of a path show parts of."""
    shown: dict[str, set[int]] = defaultdict(set)
    for track in parts:
        shown[_object(track)].update(np.intersect1d(track.frames, path.frames).tolist())
    return {name for name, frames in shown.items() if len(frames) >= LEAST_FRAMES}


def _members(ends: Mapping[str, Sequence[float] | Floats]) -> dict[str, Member]:
    """By id, the members that reach between such ends."""
    members = {}
    for number, (name, (first, last)) in enumerate(ends.items()):
        label, bay = ("upright", -1) if name.startswith("upright") else ("beam", int(name.split()[1]))
        members[name] = Member(name, label, bay, OF_MEMBER * number, np.array([first, last]))
    return members


def _object(track: Track) -> str:
    """The id of the structure that a track is of."""
    place = track.place
    return f"upright {place['upright']}" if "upright" in place else f"bay {place['bay']} / beam {place['beam']}"


def _edge(track: Track) -> str:
    return str(track.place["side" if track.label == "upright" else "edge"])


def _equations(parts: Sequence[Track], facts: RowFacts, path: Trajectory, layout: Layout) -> Iterator[Equations]:
    """Of each frame: an equation across each part of an edge."""
    poses, every = _poses(path), list[tuple[Floats | Ints, ...]]()
    for track in parts:
        at = layout.edges.get((_object(track), _edge(track)))
        if at is None:
            continue
        member, axis = layout.members[_object(track)], 0 if track.label == "upright" else 1
        places = _places_of(track, facts, poses, layout.depths[track.label])
        edge, along = EDGES[track.label].index(_edge(track)), places.positions[:, 1 - axis]
        number = np.full(len(along), member.column // OF_MEMBER)
        error, which = places.positions[:, axis] - at, member.places(edge, along)
        of_part = (
            error,
            places.slopes[:, axis],
            member.terms(edge, along),
            places.weights[:, axis],
            number,
            which,
            places.frames,
        )
        # what is further away is no part of the edge: by a few frames whose pose is wrong, it would turn a whole row
        near = np.abs(error) < 2 * SHIFT_M
        every.append(tuple(column[near] for column in of_part))
    if every:
        *columns, frames = (np.concatenate(column) for column in zip(*every, strict=True))
        for frame in np.unique(frames):
            yield _of_frame(*(column[frames == frame] for column in columns))


def _of_frame(
    errors: Floats, slopes: Floats, of_members: Floats, weights: Floats, member: Ints, place: Ints
) -> Equations:
    numbers, slot = np.unique(member, return_inverse=True)
    terms = np.zeros((len(errors), OF_MEMBER * len(numbers)))
    terms[np.arange(len(errors))[:, None], OF_MEMBER * slot[:, None] + np.arange(OF_MEMBER)] = of_members
    columns = (OF_MEMBER * numbers[:, None] + np.arange(OF_MEMBER)).ravel()
    return Equations(errors, slopes, terms, columns, weights, member, place)


@dataclass(frozen=True, eq=False)
@array_record
class FacePlaces:
    """Where n pixels' rays meet the face: the frames (n,), x and y (n, 2) m, their slopes (n, 2, 6) by the pose's place
    and rotation, and their weights (n, 2) 1 / m, each with the other held."""

    frames: Ints
    positions: Floats
    slopes: Floats
    weights: Floats


def _places_of(track: Track, facts: RowFacts, poses: Mapping[int, Floats], z: float) -> FacePlaces:
    """Where the frames with a pose see a track in the plane of a z, m; without rays that hardly meet it, or behind
    them."""
    posed = np.isin(track.frames, [*poses])
    frames, pixels, covariances = track.frames[posed], track.pixels[posed], track.covariances[posed]
    views, names = np.array(track.views)[posed], sorted(set(track.views))
    world = np.array([poses[frame] for frame in frames.tolist()]).reshape(-1, 4, 4)
    near = pixels[:, None] + np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    rays = np.zeros((len(frames), 3, 3))
    for name in names:
        rays[views == name] = facts.views[name].rig_rays(near[views == name])
    rays = rays @ np.swapaxes(world[:, :3, :3], 1, 2)
    steep = (rays[:, :, 2].max(axis=1, initial=-1.0) <= -LEAST_COSINE) & (world[:, 2, 3] > z)
    frames, rays, world, covariances = frames[steep], rays[steep], world[steep], covariances[steep]
    lengths = (z - world[:, 2, 3])[:, None] / rays[:, :, 2]
    places = world[:, None, :3, 3] + lengths[:, :, None] * rays
    by_pixel = np.swapaxes(places[:, 1:, :2] - places[:, :1, :2], 1, 2)
    information = np.linalg.inv(by_pixel @ covariances @ np.swapaxes(by_pixel, 1, 2))
    ray, turned = rays[:, 0], np.cross(np.eye(3), rays[:, :1])
    tangents = (ray[:, :2] / ray[:, 2:])[:, :, None]
    by_place = np.concatenate([np.broadcast_to(np.eye(2), (len(ray), 2, 2)), -tangents], axis=2)
    by_turn = lengths[:, :1, None] * (np.swapaxes(turned[:, :, :2], 1, 2) - tangents * turned[:, None, :, 2])
    weights = np.sqrt(np.diagonal(information, axis1=1, axis2=2))
    return FacePlaces(frames, places[:, 0, :2], np.concatenate([by_place, by_turn], axis=2), weights)


def _measured(
    parts: Sequence[Track], facts: RowFacts, path: Trajectory, layout: Layout
) -> Iterator[tuple[Member, Floats, Floats]]:
    """Members with their unknowns (4,) and the standard deviations (4,) of these. Left out are those that lean as none
    does, of which something else was seen, and all where the equations have no solution: no map is lost for shapes."""
    try:
        values, sigmas = _solved(parts, facts, path, layout)
    except np.linalg.LinAlgError as error:
        _log.warning("row %s: shapes of uprights and beams are not measured: %s", facts.name, error)
        return
    for member in layout.members.values():
        of_member = slice(member.column, member.column + OF_MEMBER)
        is_sound = np.isfinite([values[of_member], sigmas[of_member]]).all()
        if is_sound and abs(values[of_member][SLOPE]) < CLEARLY * MOST_LEAN:
            yield member, values[of_member], sigmas[of_member]


def _solved(parts: Sequence[Track], facts: RowFacts, path: Trajectory, layout: Layout) -> tuple[Floats, Floats]:
    """The members' unknowns (4 k,) and their standard deviations, by iteratively reweighted least squares."""
    frames, members = [*_equations(parts, facts, path, layout)], [*layout.members.values()]
    if not frames:
        return np.zeros(OF_MEMBER * len(members)), np.array([_sigmas(member) for member in members]).ravel()
    unknowns: Floats = np.zeros(OF_MEMBER * len(members))
    residuals, scales = [part.errors for part in frames], np.full(len(members), np.inf)
    covariance: Floats = np.zeros((len(unknowns), len(unknowns)))
    for _ in range(ROUNDS):
        normal, right, gains = _prior(members, unknowns), np.zeros(len(unknowns)), list[Floats]()
        for part, residual in zip(frames, residuals, strict=True):
            roots = _roots(part, residual, scales)
            a, b, e = roots[:, None] * part.poses, roots[:, None] * part.members, roots * part.errors
            gain = np.linalg.solve(a.T @ a + np.diag(POSE_SIGMAS**-2.0), a.T)
            normal[np.ix_(part.columns, part.columns)] += b.T @ b - (b.T @ a) @ (gain @ b)
            right[part.columns] += b.T @ e - (b.T @ a) @ (gain @ e)
            gains.append(gain * roots)
        covariance = np.asarray(np.linalg.inv(normal), np.float64)
        unknowns = covariance @ right
        residuals = [
            (rest := part.errors - part.members @ unknowns[part.columns]) - part.poses @ (gain @ rest)
            for part, gain in zip(frames, gains, strict=True)
        ]
        scales = _scales(frames, residuals, members)
    variances = np.diag(covariance) + _persistent(frames, residuals, scales, members)
    return unknowns, np.sqrt(variances)


def _roots(part: Equations, residual: Floats, scales: Floats) -> Floats:
    """The square roots (n,) of the weights of a frame's equations, large residuals by Huber's."""
    off = np.abs(residual) * part.weights / scales[part.member]
    finite = np.where(np.isfinite(scales), scales, 1.0)[part.member]
    return np.asarray(part.weights / finite / np.sqrt(np.maximum(1.0, off / HUBER)))


def _scales(frames: Sequence[Equations], residuals: Sequence[Floats], members: Sequence[Member]) -> Floats:
    """By how much (k,) each member's parts are off, in their standard deviations; at least half of what is usual, or
    `LEAST_SCALE`: else weights, and with them what poses take up, would grow from round to round."""
    which = np.concatenate([part.member for part in frames])
    off = np.concatenate([np.abs(rest) * part.weights for part, rest in zip(frames, residuals, strict=True)])
    scales = np.array([np.median(off[which == k]) / NORMAL if (which == k).any() else 1.0 for k in range(len(members))])
    return np.asarray(np.maximum(np.maximum(scales, np.median(scales) / 2), LEAST_SCALE))


def _persistent(
    frames: Sequence[Equations], residuals: Sequence[Floats], scales: Floats, members: Sequence[Member]
) -> Floats:
    """What errors that persist at places of members add to the variances (4 k,) of the unknowns.

    Frames average nothing of them out: a member's fit to the mean residuals at its places, of which each is one error.
    Their size is that of these residuals, or as usual of its label where there are few.
    """
    count = 2 * PLACES
    sums = np.zeros((len(members), count, 2 + OF_MEMBER))
    for part, residual in zip(frames, residuals, strict=True):
        weight = _roots(part, residual, scales) ** 2
        terms = part.members[np.arange(len(weight))[:, None], _columns_of(part)]
        np.add.at(
            sums, (part.member, part.place), weight[:, None] * np.column_stack([np.ones(len(weight)), residual, terms])
        )
    fits = [
        _place_errors(of_member[of_member[:, 0] > 0], member) for of_member, member in zip(sums, members, strict=True)
    ]
    added = np.zeros((len(members), OF_MEMBER))
    for label in EDGES:
        chosen = [k for k, member in enumerate(members) if member.label == label]
        rates = [fits[k][0] / fits[k][1] for k in chosen if fits[k][1] > LEAST_FREEDOM]
        usual = float(np.median(rates)) if rates else 0.0
        for k in chosen:
            squares, freedom, gain = fits[k]
            added[k] = (squares + USUAL * usual) / (freedom + USUAL - 2) * gain
    return added.ravel()


def _columns_of(part: Equations) -> Ints:
    """Where (n, 4) the unknowns of each equation's member are among a frame's columns."""
    begin = np.searchsorted(part.columns[::OF_MEMBER], OF_MEMBER * part.member)
    return np.asarray(OF_MEMBER * begin[:, None] + np.arange(OF_MEMBER))


def _place_errors(sums: Floats, member: Member) -> tuple[float, float, Floats]:
    """Of a member's mean residuals at its places: the sum of their squares, m^2, its degrees of freedom, and what one
    m^2 of errors at all places adds to the variance (4,) of each unknown. `sums` (c, 6) of weights, and of residuals
    and terms with these."""
    weight = sums[:, 0]
    if not len(weight):
        return 0.0, 0.0, np.zeros(OF_MEMBER)
    residual, terms = sums[:, 1] / weight, sums[:, 2:] / weight[:, None]
    information = (terms.T * weight) @ terms + np.diag(_sigmas(member) ** -2.0)
    gain = np.linalg.solve(information, terms.T * weight)
    left = np.eye(len(weight)) - terms @ gain
    share = weight / weight.max()
    freedom = float((share * (left**2).sum(axis=1)).sum())
    return float((share * residual**2).sum()), freedom, np.asarray((gain**2).sum(axis=1))


def _sigmas(member: Member) -> Floats:
    """Of a member's unknowns (4,) before anything is seen."""
    return np.array([SHIFT_M, SHIFT_M, MOST_LEAN, MOST_BOW * member.length])


def _prior(members: Sequence[Member], unknowns: Floats) -> Floats:
    """The information (4 k, 4 k) before anything is seen; a beam that is far less level than the others of its bay says
    less of these."""
    prior = np.diag(np.concatenate([_sigmas(member) for member in members]) ** -2.0)
    bays: dict[int, list[int]] = defaultdict(list)
    for member in members:
        if member.bay >= 0:
            bays[member.bay].append(member.column + SLOPE)
    for columns in bays.values():
        off = unknowns[columns] - np.median(unknowns[columns])
        spread = BEAM_TILT**2 * np.maximum(1.0, np.abs(off) / (HUBER * BEAM_TILT))
        prior[np.ix_(columns, columns)] = np.linalg.inv(np.diag(spread) + BAY_TILT**2)
    return prior


def _common(member: Member) -> tuple[float, float]:
    """Standard deviations of a member's slope and bow (m) by what all frames are off by."""
    return float(np.sqrt(2.0)) * COMMON_M / member.length, float(np.sqrt(1.5)) * COMMON_M


def _shape(member: Member, values: Floats, sigmas: Floats) -> dict[str, Attribute]:
    in_slope, in_bow = _common(member)
    slope, bow = (
        Measured(float(values[at]), float(np.hypot(sigmas[at], common)))
        for at, common in ((SLOPE, np.hypot(in_slope, WAVE)), (PARABOLA, in_bow))
    )
    if member.label == "upright":
        return {LEAN: _times(slope, PERMILLE), BOW: _times(bow, PERMILLE / member.length)}
    return {TILT: _times(slope, PERMILLE), SAG: replace(bow, value=-bow.value)}


def _times(measured: Measured, factor: float) -> Measured:
    return Measured(factor * measured.value, factor * measured.sigma)
