"""The depth of flat parts of a structure, by a plane sweep: a plane is moved through depths until the pictures of all
frames correlate on it.

Edges along the camera's path say little of their depth. Marks on a part do (labels, holes, scratches): from frame to
frame they move by metres against the background. The frames' pictures of a part are warped to a plane. At the part's
own depth, each mark has the same place in all of them. Sections of the parts vote, each for the depth of its highest
correlation, so that goods in front of a part and reflections are outvoted. Where too few sections have texture, there
is no result.

The sweep works in shares of the camera's distance: the path's scale need not be known.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Self

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.types import Bools, FlatDepth, FlatParts, Floats, Ints, PlanePatch, Trajectory, ViewSpec, array_record
from savmap.vision.evidence.planes import BORDER_PX, PackedView, placed

Bytes = NDArray[np.uint8]
Singles = NDArray[np.float32]

REACH, STEP = 0.04, 0.002
"""Range and step of the sweep, as shares of the camera's distance: 8 cm and 4 mm at 2 m, where a step moves a mark that
is seen from both sides by half a pixel."""
SECTION = 0.15
"""The length of a section, as a share of the distance: 30 cm at 2 m, the usual distance between labels."""
ASLANT = 1.7
"""The greatest tangent of the angle, about 60 degrees, at which a frame may see a section."""
FINENESS = 0.6
"""The side of a cell of the plane, in pixels of the frames."""
MOST_PARTS, MOST_SHOTS, MOST_CELLS = 48, 24, 200_000
"""The most parts, evenly chosen; frames that see a part; and cells of a part, which usually has some thousands."""
AWAY = 0.5
"""Frames whose distance differs from the median by more than this share are left out: their resolution of a cell
differs."""
LEAST_SHOTS, LEAST_SPREAD = 4, 0.5
"""A section needs so many frames, and directions whose tangents differ by so much."""
LEAST_CORRELATION, LEAST_RISE, LEAST_CONTRAST = 0.5, 0.2, 1.5
"""A section has a depth if its correlation has such a peak, so far above the median over depths, and if its contrast,
grey levels, is above the picture's noise."""
WIDTH = 0.0015
"""The scatter of sections that agree, as a share of the distance: 3 mm at 2 m."""
LEAST_SECTIONS, LEAST_PARTS, LEAST_PLACES, LEAST_SHARE = 6, 3, 3, 0.6
"""A consensus needs so many sections, parts, places along them, and so large a share of all votes."""
PLACE = 0.5
"""Sections within this share of the distance along the parts are seen in the same frames: their errors are correlated.
"""
COMMON_SIGMA = 0.0003
"""The error that all sections may have in common, as a share of the distance: a twentieth of a pixel."""
ROUNDS = 10


@dataclass(frozen=True)
class Vote:
    """A section's vote: the coordinate across the plane, its weight (the sharpness of the peak), the section's place
    along the parts, and the number of its part. Unit: the camera's median distance."""

    coordinate: float
    weight: float
    along: float
    part: int


@dataclass(frozen=True, eq=False)
@array_record
class Shot:
    """A view of a part. `place` (3,): the camera, to the right of the part's origin, up, and in front of it, in the
    path's unit. `pixels_from_part` (3, 3): the homography to pixels from (right, up, 1)."""

    packed_view: PackedView
    spec: ViewSpec
    place: Floats
    pixels_from_part: Floats

    @classmethod
    def of(cls, packed_view: PackedView, spec: ViewSpec, world_from_rig: Floats, part: PlanePatch) -> Self:
        """A packed view from a camera at a known pose."""
        return cls(packed_view, spec, *placed(part, spec, world_from_rig))

    def pixels_from(self, depths: Floats, distance: float, height: float) -> Floats:
        """The homographies (n, 3, 3) to pixels from planes at depths (n,) in front of the part.

        The plane is scaled so that a camera at `distance` and `height` sees the part's edges at the same pixels for
        every depth: these edges were measured in the pictures.
        """
        return self._pixels_from(depths, (distance - depths) / distance, height)

    def _pixels_from(self, depths: Floats, shrunk: Floats, height: float) -> Floats:
        right, up, before = self.place
        nearer = before / (before - depths)
        moved = np.zeros((len(depths), 3, 3))
        moved[:, 0, 0], moved[:, 1, 1], moved[:, 2, 2] = nearer, nearer * shrunk, 1.0
        moved[:, 0, 2], moved[:, 1, 2] = right * (1 - nearer), up * (1 - nearer) + nearer * height * (1 - shrunk)
        return np.asarray(self.pixels_from_part @ moved)


def depth_of(
    plugin: str, flat: FlatParts, packed_views: Sequence[PackedView], views: Mapping[str, ViewSpec], path: Trajectory
) -> FlatDepth | None:
    """The depth of a plugin's flat parts, by its packed views of frames whose pose is known. None where the sections
    have no consensus."""
    poses = dict(zip(path.frames.tolist(), path.world_from_rig, strict=True))
    located = [packed_view for packed_view in packed_views if packed_view.frame in poses]
    frames: Ints = np.unique(np.array([packed_view.frame for packed_view in located], np.int64))
    mean = float(np.mean([poses[frame][flat.column, 3] for frame in frames.tolist()])) if located else 0.0
    chosen = np.unique(np.linspace(0, len(flat.parts) - 1, min(len(flat.parts), MOST_PARTS)).astype(int)).tolist()
    cameras = np.array([poses[packed_view.frame][:3, 3] for packed_view in located]).reshape(-1, 3)
    shots = {
        n: [
            Shot.of(located[k], views[located[k].view], poses[located[k].frame], flat.parts[n])
            for k in near_cameras(flat.parts[n], cameras)
        ]
        for n in chosen
    }
    sweeps = {
        n: sweep for n, part_shots in shots.items() if (sweep := Sweep.over(flat.parts[n], part_shots)) is not None
    }
    if not sweeps or mean == 0:
        return None
    unit = float(np.median([sweep.distance for sweep in sweeps.values()]))
    grey = lru_cache(4 * MOST_SHOTS)(PackedView.grey)
    agreement = consensus(
        [vote for number, sweep in sweeps.items() for vote in sweep.votes(number, flat.column, unit, grey)]
    )
    if agreement is None:
        return None
    share, sigma = agreement[0] * unit / mean, agreement[1] * unit / abs(mean)
    normal = flat.parts[0].axes[flat.column, 2]
    proud = float(np.sign(normal)) * flat.proud_m
    return FlatDepth(plugin, flat.landmark, flat.axis, share, sigma, frames, agreement[2], proud, flat.proud_sigma_m)


def near_cameras(part: PlanePatch, cameras: Floats) -> list[int]:
    """The indices of those cameras (n, 3) that are in front of a part and not too far beside it to see any of it."""
    right, before = part.axes[:, ::2].T @ (cameras - part.origin).T
    near = (before > 0) & (right > -ASLANT * before) & (right < part.size[0] + ASLANT * before)
    return np.flatnonzero(near).tolist()


@dataclass(frozen=True, eq=False)
@array_record
class Sweep:
    """A part, cut into `count` sections of `columns` cells by `rows`, and the shots that see any section.

    `visible` (shots, sections): whether a shot sees a section; `tangents` (shots, sections): the direction in which it
    does; `distance`, `height`: the camera's median ones; `cell`: a cell's side.
    """

    part: PlanePatch
    shots: Sequence[Shot]
    distance: float
    height: float
    cell: float
    rows: int
    columns: int
    visible: Bools
    tangents: Floats

    @classmethod
    def over(cls, part: PlanePatch, shots: Sequence[Shot], reach: float = REACH) -> "Sweep | None":
        """The sweep over a part, by `reach` times the camera's distance to either side; None where too few shots see
        it."""
        width, tall = part.size.tolist()
        distance, height = (float(np.median([shot.place[axis] for shot in shots])) if shots else 0.0 for axis in (2, 1))
        near = [shot for shot in shots if abs(shot.place[2] - distance) < AWAY * distance]
        if len(near) < LEAST_SHOTS:
            return None
        cell = FINENESS * distance / float(np.median([shot.spec.camera[0, 0] for shot in near]))
        count = max(round(width / (SECTION * distance)), 1)
        rows, columns = int(tall / cell), int(width / count / cell)
        if rows < 1 or columns < 3 or rows * columns * count > MOST_CELLS:
            return None
        sides = np.arange(count + 1) * columns * cell
        places = np.array([shot.place for shot in near])[:, :, None]
        tangents = ((sides[:-1] + sides[1:]) / 2 - places[:, 0]) / places[:, 2]
        shown = _shown(near, sides, tall, reach * ASLANT * distance)
        visible = shown[:, :-1] & shown[:, 1:] & (np.abs(tangents) < ASLANT)
        use = np.flatnonzero(visible.any(axis=1))
        use = use[np.unique(np.linspace(0, len(use) - 1, min(len(use), MOST_SHOTS)).astype(int))] if len(use) else use
        if len(use) < LEAST_SHOTS:
            return None
        return cls(part, [near[k] for k in use], distance, height, cell, rows, columns, visible[use], tangents[use])

    @property
    def count(self) -> int:
        """The number of sections."""
        return int(self.visible.shape[1])

    @property
    def informative(self) -> Ints:
        """The indices (n,) of the sections that enough shots see, from directions that differ enough."""
        first, last = (np.where(self.visible, self.tangents, fill) for fill in (np.inf, -np.inf))
        spread = last.max(axis=0) - first.min(axis=0)
        return np.flatnonzero((self.visible.sum(axis=0) >= LEAST_SHOTS) & (spread >= LEAST_SPREAD))

    def votes(self, number: int, column: int, unit: float, grey: Callable[[PackedView], Bytes]) -> Iterator[Vote]:
        """The votes of the sections of part `number`: coordinates along axis `column`, in units of `unit`. `grey`
        decodes a packed view."""
        forward = self.part.axes[column, 2]
        start = float(self.part.origin @ self.part.right)
        for depth, weight, along in self.section_depths([grey(shot.packed_view) for shot in self.shots]):
            coordinate = float(self.part.origin[column] + forward * depth) / unit
            yield Vote(coordinate, weight, (start + along) / unit, number)

    def section_depths(self, pictures: Sequence[Bytes]) -> "list[tuple[float, float, float]]":
        """Depth in front of the part, weight and place along it of each section that has a depth. `pictures` (h, w):
        grey, of the shots."""
        depths = np.arange(-REACH, REACH + STEP / 2, STEP) * self.distance
        correlation, contrast = self.correlations(depths, pictures)
        peaks = []
        for section in self.informative.tolist():
            peak = _peak(depths, correlation[:, section], contrast[:, section], self.distance)
            if peak is not None:
                peaks.append((*peak, (section + 0.5) * self.columns * self.cell))
        return peaks

    def correlations(self, depths: Floats, pictures: Sequence[Bytes] | Sequence[Singles]) -> tuple[Floats, Floats]:
        """The mean correlation (n, sections) of all pairs of frames on planes at depths (n,) in front of the part, and
        the contrast (n, sections) there, grey levels."""
        first, last = self.visible.argmax(axis=1), self.count - self.visible[:, ::-1].argmax(axis=1)
        grids = np.zeros((len(self.shots), 3, 3))
        grids[:, 0, 0], grids[:, 1, 1], grids[:, 2, 2] = self.cell, -self.cell, 1.0
        grids[:, 0, 2] = self.cell * (first * self.columns + 0.5)
        grids[:, 1, 2] = float(self.part.size[1]) / 2 + self.cell * (self.rows - 1) / 2
        maps = [
            shot.pixels_from(depths, self.distance, self.height) @ grid
            for shot, grid in zip(self.shots, grids, strict=True)
        ]
        laid = np.zeros((len(self.shots), self.rows, self.count * self.columns), pictures[0].dtype)
        places = [
            row[:, begin * self.columns : end * self.columns]
            for row, begin, end in zip(laid, first.tolist(), last.tolist(), strict=True)
        ]
        mean = np.full(self.columns, 1 / self.columns, np.float32)
        frames = self.visible.sum(axis=0)
        pairs, energies = np.zeros((2, len(depths), self.count))
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        for number in range(len(depths)):
            for place, picture, homographies in zip(places, pictures, maps, strict=True):
                size = place.shape[::-1]
                cv2.warpPerspective(np.asarray(picture), homographies[number], size, place, flags)
            detail = laid.astype(np.float32)
            sections = detail.reshape(-1, self.columns)
            sections -= (sections @ mean)[:, None]
            energies[number] = self._by_section(np.einsum("nrx,nrx->rx", detail, detail))
            pairs[number] = self._by_section(np.square(detail.sum(axis=0))) - energies[number]
        contrast = np.sqrt(energies / np.maximum(frames * self.rows * self.columns, 1))
        return pairs / np.maximum((frames - 1) * energies, 1e-9), contrast

    def _by_section(self, cells: Singles) -> Floats:
        """The sum of values (rows, columns of the part) over each section."""
        return np.asarray(cells.reshape(self.rows, self.count, self.columns).sum(axis=(0, 2)), np.float64)


def _shown(shots: Sequence[Shot], x: Floats, top: float, slack: float) -> Bools:
    """Which shots show the lines that cross the part at x (n,), from 0 to `top`, with `slack` on the part to either
    side (shots, n)."""
    ends = np.array([(x + side * slack, np.full_like(x, y), np.ones_like(x)) for side in (-1, 1) for y in (0.0, top)])
    u, v, depth = np.moveaxis(np.array([shot.pixels_from_part for shot in shots])[:, None] @ ends, 2, 0)
    u, v = u / np.maximum(depth, 1e-9), v / np.maximum(depth, 1e-9)
    width, height = np.array([(shot.spec.width, shot.spec.height) for shot in shots]).T[..., None, None]
    inside = (depth > 0) & (np.minimum(u, v) > BORDER_PX)
    inside &= (u < width - 1 - BORDER_PX) & (v < height - 1 - BORDER_PX)
    return np.asarray(inside.all(axis=1))


def _peak(depths: Floats, correlation: Floats, contrast: Floats, distance: float) -> tuple[float, float] | None:
    """The depth at which the correlation (k,) over depths (k,) peaks, and the peak's sharpness as a weight. None
    without a peak."""
    top, peak = float(correlation.max()), summit(correlation)
    if peak is None or top < LEAST_CORRELATION or top - float(np.median(correlation)) < LEAST_RISE:
        return None
    if contrast[int(correlation.argmax())] < LEAST_CONTRAST:
        return None
    step = depths[1] - depths[0]
    return float(depths[0] + step * peak[0]), peak[1] * (distance / step) ** 2 / (1.02 - min(top, 1.0))


def summit(curve: Floats) -> tuple[float, float] | None:
    """Where a curve (n,) has its maximum, in samples and parts of one, and how much it bends there. None at the ends,
    or without a maximum."""
    best = int(curve.argmax())
    if not 0 < best < len(curve) - 1:
        return None
    before, top, after = curve[best - 1 : best + 2].tolist()
    bend = 2 * top - before - after
    return (best + 0.5 * (after - before) / bend, bend) if bend > 0 else None


def consensus(votes: Sequence[Vote]) -> tuple[float, float, int] | None:
    """The coordinate of most votes, its sigma, and the number of votes that agree. None where too few agree."""
    if len(votes) < LEAST_SECTIONS:
        return None
    coordinates = np.array([vote.coordinate for vote in votes])
    weights = np.array([vote.weight for vote in votes])
    weights = np.minimum(weights, 5 * np.median(weights))
    nearness = np.exp(-0.5 * np.square((coordinates[:, None] - coordinates) / WIDTH))
    mode = coordinates[int((nearness @ weights).argmax())]
    near = np.abs(coordinates - mode) < 3 * WIDTH
    parts = {vote.part for vote, kept in zip(votes, near, strict=True) if kept}
    groups = np.array([np.floor(vote.along / PLACE) for vote in votes])[near]
    few = near.sum() < LEAST_SECTIONS or len(parts) < LEAST_PARTS or len(set(groups.tolist())) < LEAST_PLACES
    if few or near.mean() < LEAST_SHARE:
        return None
    coordinate, weights = _robust_mean(coordinates[near], weights[near])
    return coordinate, _sigma(weights * (coordinates[near] - coordinate), weights, groups), int(near.sum())


def _robust_mean(values: Floats, weights: Floats) -> tuple[float, Floats]:
    """The weighted mean of values (n,), and their final weights (n,): outliers count less (Huber)."""
    mean, final = float(np.average(values, weights=weights)), weights
    for _ in range(ROUNDS):
        off = np.abs(values - mean)
        scale = max(1.5 * 1.48 * float(np.median(off)), 1e-5)
        final = weights * np.minimum(1.0, scale / np.maximum(off, 1e-9))
        mean = float(np.average(values, weights=final))
    return mean, final


def _sigma(pulls: Floats, weights: Floats, groups: Floats) -> float:
    """The sigma of a weighted mean, by its weighted residuals `pulls` (n,) and their groups (n,): errors within a group
    may be correlated. Few groups underestimate their scatter. The correction is near to Student's t: two thirds more
    for four groups."""
    sums = np.array([pulls[groups == group].sum() for group in np.unique(groups)])
    scatter = float(np.linalg.norm(sums) / weights.sum()) * np.sqrt(len(sums) / (len(sums) - 1))
    return float(np.hypot(scatter * (len(sums) + 1) / (len(sums) - 1), COMMON_SIGMA))
