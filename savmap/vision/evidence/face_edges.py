"""The face beside a drive and its posts, by straight edges alone: no network, grey levels only, so that any paint does.

Each frame is seen by a camera square to the face. Its upright edges are divided by the contrast around them and kept
with their signs. A plane is moved through depths (a plane sweep: Collins 1996, "A space-sweep approach to true
multi-image matching"), and on each the edges of all frames are averaged: at the face's depth posts stay sharp, and what
is off the plane is smeared by parallax. A pair of columns scores the mean over the height of sqrt(|e| |e'|), where e
and e' are its averaged edges, at most 1. The face is the nearest plane on which bays have pairs that score more than
pairs usually do at that depth. Its posts share one width, and each may stand a little nearer or farther, for a path
drifts.

Face frame: x right as one looks at the face, y down, z from the drive towards the face. Lengths are in the path's unit,
of which a rough metre must be known: posts are 3 to 16 cm wide.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from savmap.errors import StructureError
from savmap.geometry import sphere
from savmap.geometry.poses import middle_rotation
from savmap.geometry.vanishing import manhattan_from_segments
from savmap.types import Floats, Ints, Panorama, array_record
from savmap.vision.odometry import WalkedPath, seen
from savmap.vision.view_planning import LEAST_SUPPORT, Side

Bytes = NDArray[np.uint8]
Singles = NDArray[np.float32]

FOCAL, WIDTH, HEIGHT, JOINED = 192, 640, 1280, 8
"""Of the view square to the face, pixels: 118 degrees wide, 147 high. So many of its rows are joined to one."""
SPARSE = 8
"""Rays are computed for every eighth pixel, and interpolated between."""
WINDOW_PX, NOISE = 8.0, 1.5
"""Sigma of the window whose contrast an edge is divided by, and grey levels that are added to this."""
UNIT = 32.0
"""Steps of a packed edge in 1: edges up to 4 fit into a byte."""
CELLS = 150
"""Columns of averaged edges in a depth of the face."""
LEAST_FRAMES, ENOUGH = 6, 16
"""Frames that see a cell: where fewer do, anything scores; so many are enough for the sweep."""
NEAREST_M, FARTHEST_M, STEP = 0.45, 3.5, 1.01
"""Depths of the sweep, and the factor from each to the next."""
SLOPES: Floats = np.linspace(-0.01, 0.01, 9)
"""Of the depth along the way, which are tried."""
BAY_M, PAIR_M = 1.0, 4.0
"""A plane is judged by the best pair in each bay, and by as many of these as the way has lengths of the second kind."""
USUAL, MARGIN = 45, 0.05
"""Over how many depths what a bay usually scores is a running median, and by how much more a post scores."""
PEAK, SHARE, NEARER = 9, 0.3, 0.88
"""A nearer plane than the one that stands out most is the face where it does so more than the planes of so many depths
around it, has this share of the other's strength, and at most this share of its depth: one sees through a face."""
NEAR_M = 1.5
"""Planes are sought by what is so far above and below the path, and as far as they are away."""
ASCENTS, ROUNDS, WORTH = (1.0, 0.5), 3, 1.0005
"""Of the search for the best shape: shares of the first steps, how often these are halved, the gain that a step needs.
"""
SIGMAS, PRIOR = np.array([0.01, 0.01, 0.02, 0.02]), 0.05
"""Of slope, lean, and, in depths, bend and twist; and the share of its strength that a plane loses by one sigma."""
GOES_ON, MIDDLE = 0.4, 0.6
"""A face ends where its pairs have less than this share of the edges that they have so many depths around the path."""
POSTS_M, ALIKE_M, APART_M, MOST_POSTS = (0.03, 0.16), 0.017, 0.2, 40
"""Widths of posts, how much those of a face differ, the least distance of candidates, and how many there may be."""
SAME_M, BEYOND_M = 0.1, 0.3
"""What is so near belongs to one post; and how far beyond the ends of the way candidates may be."""
DEPTHS = (1.0, 0.98, 0.99, 1.01, 1.02)
"""Of a post, in that of the face."""
POST, OTHER, BOUND = (0.97, 0.72), (-2.08, 0.52), 6.0
"""Log odds of the scores of 107 posts and 680 other pairs of 20 faces, mean and sigma; and where their log-likelihood
ratio is cut, for the tails are not known."""
BESIDE, STANDS = (0.9, 0.93, 1.07, 1.1), 1.5
"""Depths of other planes, in that of the best one, whose scores the one of a face exceeds by this factor: 18 true faces
did by 1.9 or more, and 18 best planes along wrong paths by 1.3 or less."""

LINEAR = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
ROWS, REACH = HEIGHT // JOINED, WIDTH * CELLS // (2 * FOCAL)
"""Of averaged edges: the rows, and the columns that a camera sees to either side."""
CAMERA: Floats = np.array([[FOCAL, 0, WIDTH / 2 - 0.5], [0, FOCAL / JOINED, ROWS / 2 - 0.5], [0, 0, 1]])
"""Calibration matrix (3, 3) of the view with its rows joined."""
DOWN: Floats = (np.arange(ROWS) + 0.5 - ROWS / 2) * JOINED / FOCAL
"""Of the rows below the path's middle, in depths."""
WEIGHTS: Singles = np.asarray(
    (1 + ((np.arange(2 * REACH) - REACH) / CELLS) ** 2 + DOWN[:, None] ** 2) ** -1.5, np.float32
)
"""Of the cells that a camera sees: the solid angle, up to a factor."""
Post = tuple[float, float, float]
"""Score, centre, width."""
Rows = tuple[float, float]
"""Between which rows are taken, in depths below the path's middle."""
ALL_ROWS: Rows = (-9.0, 9.0)


@dataclass(frozen=True, eq=False)
@array_record
class FacePlane:
    """The best plane on one side of a drive, in the frame `path_from_face` (3, 3).

    `shape` (5,): the depth from the path's `middle` (3,), how it changes along x (slope) and y (lean), and what a
    drifting path adds to it along the way, quadratic and cubic; `half`: of the way's length along x. `heights`: above
    the middle, between which the face is seen. `score`: the mean of its best pairs over these; `beside`: the same of
    planes a little nearer and farther.
    """

    path_from_face: Floats
    middle: Floats
    half: float
    shape: Floats
    heights: tuple[float, float]
    score: float
    rivals: float

    @property
    def depth(self) -> float:
        """From the path's middle."""
        return float(self.shape[0])

    @property
    def slope(self) -> float:
        """Of the depth, along x."""
        return float(self.shape[1])

    @property
    def lean(self) -> float:
        """Of the depth, along y."""
        return float(self.shape[2])

    @property
    def stands(self) -> bool:
        """Whether a face stands on this side."""
        return self.score > STANDS * self.rivals

    def points(self, x: Floats, height: float = 0.0) -> Floats:
        """Points (n, 3) of the face, in the path's frame, at places x (n,) in the face frame and a height."""
        depth, _ = bent(self.shape, self.half, (x - self.middle[0]) / self.half)
        y = np.full_like(x, self.middle[1] - height)
        z = depth - self.shape[2] * height + self.middle[2]
        return np.asarray(np.stack([x, y, z], axis=1) @ self.path_from_face.T)


@dataclass(frozen=True, eq=False)
@array_record
class FacePosts:
    """Candidates for the posts of a face (n,), best first: their scores, their centres (x in the face frame), their
    widths, and the log-likelihood ratios of a post to another pair, which hold where the plane is right."""

    scores: Floats
    centres: Floats
    widths: Floats
    ratios: Floats


def bent(shape: Floats, half: float, t: Floats) -> tuple[Floats, Floats]:
    """Depths and slopes (n,) of a face's shape (5,) at places t (n,) along the way, from -1 to 1."""
    depth, slope, _, bend, twist = shape.tolist()
    depths = depth + slope * half * t + bend * (t**2 - 1 / 3) + twist * (t**3 - 0.6 * t)
    return depths, slope + (2 * bend * t + twist * (3 * t**2 - 0.6)) / half


def building_axes(path: WalkedPath, segments: Mapping[int, tuple[Floats, Floats]]) -> Floats:
    """The building's axes (3, 3) in the path's frame, the second one up, by straight segments that some frames show, as
    `view_planning.segments` gives them. Raises StructureError where none stand out."""
    placed = [(path.world_from_rig[frame, :3, :3], ends) for frame, ends in segments.items() if path.part[frame] >= 0]
    rays = [np.concatenate([ends[k] @ turn.T for turn, ends in placed]) for k in (0, 1)] if placed else []
    axes = manhattan_from_segments(rays[0], rays[1]) if rays else None
    if axes is None or axes.support < LEAST_SUPPORT:
        raise StructureError(
            "no building directions stand out in the pictures; give the views' angles in the site file"
        )
    return axes.rig_from_manhattan


def faces_beside(axes: Floats, way: Floats) -> Mapping[Side, Floats]:
    """The face frames (3, 3) of both sides, by the building's axes (3, 3), the second one up, and the direction of the
    way (3,), in one frame: the rig's, or the path's."""
    level = axes[:, [0, 2]]
    along = way @ level
    nearest = int(np.abs(along).argmax())
    right, down = np.sign(along[nearest]) * level[:, nearest], -axes[:, 1]
    left: Floats = np.column_stack([right, down, np.cross(right, down)])
    return {"left": left, "right": left * [-1.0, 1.0, -1.0]}


class FaceEdges:
    """The upright edges on one side of a drive, as cameras square to the face see them: 100 kB a frame."""

    def __init__(self) -> None:
        self._frames = list[int]()
        self._rig_from_view = list[Floats]()
        self._packed = list[Bytes]()

    def add(self, frame: int, panorama: Panorama, rig_from_face: Floats) -> None:
        """Take a frame of the drive. `rig_from_face` (3, 3): the face frame as the rig stands, to a few degrees."""
        edges = np.rint(UNIT * upright_edges(square_view(seen(panorama), rig_from_face))) + 128
        self._frames.append(frame)
        self._rig_from_view.append(rig_from_face)
        self._packed.append(np.clip(edges, 0, 255).astype(np.uint8))

    def along(self, path: WalkedPath, metres: float, path_from_face: Floats | None = None) -> "FaceSweep | None":
        """The sweep along the longest part of a path whose unit is roughly so many metres; None where it has too few of
        the frames, or is no longer than a bay. `path_from_face` (3, 3): the face frame; None: the middle of the frames'
        own."""
        kept = [k for k, frame in enumerate(self._frames) if path.part[frame] == path.longest]
        if len(kept) < LEAST_FRAMES:
            return None
        poses = path.world_from_rig[[self._frames[k] for k in kept]]
        path_from_view = poses[:, :3, :3] @ np.array([self._rig_from_view[k] for k in kept])
        face = middle_rotation(path_from_view) if path_from_face is None else path_from_face
        edges = [(self._packed[k].astype(np.float32) - 128) / np.float32(UNIT) for k in kept]
        sweep = FaceSweep(metres, face, poses[:, :3, 3] @ face, path_from_view.transpose(0, 2, 1) @ face, edges)
        return sweep if 2 * sweep.half * metres > BAY_M else None


def square_view(grey: Bytes, rig_from_face: Floats) -> Singles:
    """A panorama as a camera square to the face sees it (HEIGHT, WIDTH)."""
    u, v = ((np.arange(SPARSE / 2, n, SPARSE) - n / 2) / FOCAL for n in (WIDTH, HEIGHT))
    rays = np.stack([*np.meshgrid(u, v), np.ones((len(v), len(u)))], axis=-1) @ rig_from_face.T
    columns, rows = sphere.columns_and_rows(rays[..., 0], rays[..., 1], rays[..., 2], len(grey))
    first = columns[len(v) // 2, len(u) // 2] - len(grey)
    maps = [
        cv2.resize(table.astype(np.float32), (WIDTH, HEIGHT))
        for table in ((columns - first) % (2 * len(grey)) + first, rows)
    ]
    return np.asarray(cv2.remap(grey, maps[0], maps[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP), np.float32)


def upright_edges(view: Singles) -> Singles:
    """Upright edges (ROWS, WIDTH) of a view, signed, in terms of the contrast around them."""
    rises = cv2.Sobel(view, cv2.CV_32F, 1, 0, scale=1 / 8)
    edges, energy = (cv2.resize(x, (WIDTH, ROWS), interpolation=cv2.INTER_AREA) for x in (rises, rises * rises))
    contrast = cv2.sqrt(cv2.GaussianBlur(energy, (0, 0), sigmaX=WINDOW_PX, sigmaY=WINDOW_PX / JOINED))
    return np.asarray(edges / (contrast + NOISE), np.float32)


@dataclass(frozen=True, eq=False)
@array_record
class Average:
    """Edges averaged on a plane (rows, columns), and the places `x` of the columns in the face frame."""

    edges: Singles
    x: Floats

    @property
    def cell(self) -> float:
        """The width of a column."""
        return float(self.x[1] - self.x[0])

    @cached_property
    def roots(self) -> Singles:
        """The square roots of the edges' sizes, at most 1."""
        return np.asarray(cv2.sqrt(np.minimum(np.abs(self.edges), 1)), np.float32)


@dataclass(frozen=True, eq=False)
@array_record
class Pairs:
    """The scores (widths, columns) of pairs of columns on a plane, by their widths (in columns) and left columns."""

    average: Average
    widths: Ints
    scores: Singles

    def best(self, spacing: float, most: int) -> list[tuple[float, int, int]]:
        """Scores, left and right columns of the best pairs whose centres are so far apart, best first."""
        scores, chosen = self.scores.copy(), list[tuple[float, int, int]]()
        centres = self.average.x + self.widths[:, None] * self.average.cell / 2
        while len(chosen) < most and scores.max() > 0.01:
            width, left = (int(k) for k in np.unravel_index(scores.argmax(), scores.shape))
            chosen.append((float(scores[width, left]), left, left + int(self.widths[width])))
            scores[np.abs(centres - centres[width, left]) < spacing] = 0
        return chosen


@dataclass(frozen=True, eq=False)
@array_record
class FaceSweep:
    """The sweep for the face on one side of a drive: `metres` in the path's unit; where n cameras are (n, 3) in the
    face frame, how they are turned (n, 3, 3), and the upright edges that each sees (ROWS, WIDTH)."""

    metres: float
    path_from_face: Floats
    places: Floats
    view_from_face: Floats
    edges: Sequence[Singles]

    @cached_property
    def ends(self) -> tuple[float, float]:
        """Of the way along the face."""
        return float(self.places[:, 0].min()), float(self.places[:, 0].max())

    @cached_property
    def half(self) -> float:
        """Half of the way along the face."""
        return (self.ends[1] - self.ends[0]) / 2

    @property
    def _apart(self) -> float:
        """From a frame to the next."""
        return 2 * self.half / len(self.edges)

    @cached_property
    def middle(self) -> Floats:
        """Of the path (3,)."""
        return np.array([sum(self.ends) / 2, *self.places[:, 1:].mean(axis=0)])

    def plane(self) -> FacePlane | None:
        """The nearest plane that stands out; None where no depth is seen by enough frames."""
        depths = self._depths()
        if not len(depths):
            return None
        depth, slope, usual = self._start(depths)
        shape, rows = np.array([depth, slope, 0, 0, 0]), self._before(depth)
        for part in ASCENTS:
            steps = part * np.array([0.01 * depth, 0.004, 0.004, 0.01 * depth, 0.01 * depth])
            shape = ascended(partial(self._strength, rows=rows, usual=usual), shape, steps)
            rows = self._seen_rows(shape, rows)
        score, *rivals = (self._score(shape * [share, 1, 1, 1, 1], rows) for share in (1.0, *BESIDE))
        heights = (-rows[1] * float(shape[0]), -rows[0] * float(shape[0]))
        return FacePlane(self.path_from_face, self.middle, self.half, shape, heights, score, float(np.median(rivals)))

    def posts(self, plane: FacePlane) -> FacePosts:
        """The candidates for posts on a plane: each at the depth, near the plane's, where it scores most."""
        rows = (-plane.heights[1] / plane.depth, -plane.heights[0] / plane.depth)
        averages = [self.average(plane.shape * [share, 1, 1, 1, 1], rows) for share in DEPTHS]
        width, posts, kept = self._width(self.pairs(averages[0])), list[Post](), list[Post]()
        for average in averages:
            pairs = self.pairs(average)
            alike = np.abs(pairs.widths * average.cell - width) <= ALIKE_M / self.metres
            best = replace(pairs, scores=np.where(alike[:, None], pairs.scores, 0)).best(
                APART_M / self.metres, MOST_POSTS
            )
            posts += [(score, *edges_at(average, left, right)) for score, left, right in best]
        for post in sorted(posts, reverse=True):
            if len(kept) < MOST_POSTS and all(abs(post[1] - other[1]) > APART_M / self.metres for other in kept):
                kept.append(post)
        scores, centres, widths = np.array(kept).reshape(-1, 3).T
        return FacePosts(scores, centres, widths, ratios(scores))

    def average(self, shape: Floats, rows: Rows = ALL_ROWS, most: float = math.inf) -> Average:
        """The edges averaged on a plane of this shape (5,); of about so many frames a cell."""
        depth, lean, within = float(shape[0]), float(shape[2]), between(rows)
        cell, tall, margin = depth / CELLS, depth * JOINED / FOCAL, (BEYOND_M + POSTS_M[1]) / self.metres
        x, weights = np.arange(self.ends[0] - margin, self.ends[1] + margin, cell), WEIGHTS[within]
        depths, slopes = bent(shape, self.half, (self.places[:, 0] - self.middle[0]) / self.half)
        total, weight = np.zeros((2, len(weights), len(x)), np.float32)
        for k in range(0, len(self.edges), max(1, int(WIDTH / FOCAL * depth / self._apart / most))):
            camera = round((self.places[k, 0] - x[0]) / cell)
            first, last = max(camera - REACH, 0), min(camera + REACH, len(x))
            seen_from, size = slice(first - camera + REACH, last - camera + REACH), (last - first, len(weights))
            right, below, off = x[first] - self.places[k, 0], DOWN[within][0] * depth, self.middle - self.places[k]
            ahead = depths[k] + slopes[k] * right + lean * below + off[2]
            cells = np.array([[cell, 0, right], [0, tall, below + off[1]], [slopes[k] * cell, lean * tall, ahead]])
            laid = cv2.warpPerspective(self.edges[k], CAMERA @ self.view_from_face[k] @ cells, size, flags=LINEAR)
            cv2.accumulateProduct(weights[:, seen_from], laid, total[:, first:last])
            weight[:, first:last] += weights[:, seen_from]
        return Average(np.asarray(total / (weight + 1e-6), np.float32), x)

    def pairs(self, average: Average) -> Pairs:
        """The pairs of an average that are as wide as posts."""
        least, most = (round(width / self.metres / average.cell) for width in POSTS_M)
        widths, roots, beyond = np.arange(max(2, least), most + 1), average.roots, BEYOND_M / self.metres
        scores = np.zeros((len(widths), len(average.x)), np.float32)
        for line, width in zip(scores, widths.tolist(), strict=True):
            np.einsum("yx,yx->x", roots[:, :-width], roots[:, width:], out=line[:-width])
        scores /= len(roots)
        scores[:, (average.x < self.ends[0] - beyond) | (average.x > self.ends[1] + beyond)] = 0
        return Pairs(average, widths, scores)

    @property
    def _few(self) -> int:
        """The number of pairs that tell of a face: it has more posts."""
        return max(3, round(2 * self.half * self.metres / PAIR_M))

    @cached_property
    def _bays(self) -> Floats:
        """The sides of equal stretches of the way (k + 1,), from its middle."""
        return np.linspace(-self.half, self.half, max(7, round(2 * self.half * self.metres / BAY_M)) + 1)

    def _before(self, depth: float) -> Rows:
        """The rows before the camera."""
        most = max(1.0, NEAR_M / self.metres / depth)
        return -most, most

    def _depths(self) -> Floats:
        """The depths of the sweep (n,): where enough frames see a cell."""
        first = max(NEAREST_M / self.metres, LEAST_FRAMES * self._apart * FOCAL / WIDTH)
        count = math.log(max(FARTHEST_M / self.metres / first, 1.0)) / math.log(STEP)
        return np.asarray(first * STEP ** np.arange(int(count)))

    def _start(self, depths: Floats) -> tuple[float, float, float]:
        """Depth and slope of the nearest plane that stands out, and what a bay usually scores there. Along a slope,
        each bay has the score that it has at its depth."""
        shapes = [np.array([depth, 0, 0, 0, 0]) for depth in depths.tolist()]
        scores = np.array([self._by_bay(shape, self._before(float(shape[0])), ENOUGH) for shape in shapes])
        usual = ndimage.median_filter(np.median(scores, axis=1), USUAL, mode="nearest")
        lines = depths[:, None, None] + SLOPES[:, None] * (self._bays[1:] + self._bays[:-1]) / 2
        steps = np.rint(np.log(np.maximum(lines / depths[0], 1.0)) / math.log(STEP)).astype(int)
        steps = np.minimum(steps, len(depths) - 1)
        table = excess(scores[steps, np.arange(scores.shape[1])], usual[steps])
        strength = table.max(axis=1)
        best = int(strength.argmax())
        peaks = (strength == ndimage.maximum_filter1d(strength, PEAK)) & (strength > SHARE * strength[best])
        nearer = np.flatnonzero(peaks & (depths < NEARER * depths[best]))
        k = int(nearer[0]) if len(nearer) else best
        return float(depths[k]), float(SLOPES[table[k].argmax()]), float(usual[k])

    def _by_bay(self, shape: Floats, rows: Rows, most: float = math.inf) -> Floats:
        """The best score of a pair on a plane in each bay (k,)."""
        pairs = self.pairs(self.average(shape, rows, most))
        first = np.searchsorted(pairs.average.x - self.middle[0], self._bays[:-1])
        first[0] = 0
        return np.asarray(np.maximum.reduceat(pairs.scores.max(axis=0), first), np.float64)

    def _strength(self, shape: Floats, rows: Rows, usual: float) -> float:
        """How much a plane stands out."""
        unlikely = np.square(shape[1:] / SIGMAS / [1, 1, shape[0], shape[0]]).sum()
        return float(excess(self._by_bay(shape, rows), usual)) * math.exp(-PRIOR * float(unlikely))

    def _score(self, shape: Floats, rows: Rows) -> float:
        """The mean score of the best pairs on a plane."""
        return float(np.sort(self._by_bay(shape, rows))[-self._few :].mean())

    def _seen_rows(self, shape: Floats, rows: Rows) -> Rows:
        """The rows over which the best pairs of these rows go on."""
        whole = self.average(shape)
        best = self.pairs(Average(whole.edges[between(rows)], whole.x)).best(BAY_M / self.metres, self._few)
        lines = [whole.roots[:, left] * whole.roots[:, right] for _, left, right in best]
        line = np.mean(lines or [np.zeros(ROWS)], axis=0)
        sums = np.append(0.0, np.cumsum(line - GOES_ON * np.median(line[np.abs(DOWN) < MIDDLE])))
        gains = np.triu(sums[1:] - sums[:-1, None])
        first, last = np.unravel_index(gains.argmax(), gains.shape)
        return float(DOWN[first]) - 0.01, float(DOWN[last]) + 0.01

    def _width(self, pairs: Pairs) -> float:
        """The width that the best pairs have in common."""
        x, best = pairs.average.x, pairs.best(BAY_M / self.metres, self._few)
        near = [np.abs(x - (x[left] + x[right]) / 2) < SAME_M / self.metres for _, left, right in best]
        scores = [pairs.scores[:, columns].max(axis=1) for columns in near]
        return float(pairs.widths[np.argmax(np.sum(scores, axis=0))]) * pairs.average.cell


def between(rows: Rows) -> Ints:
    """The numbers of rows of averaged edges."""
    return np.flatnonzero((rows[0] < DOWN) & (rows[1] > DOWN))


def excess(scores: Floats, usual: Floats | float) -> Floats:
    """The sum over bays, the last axis, of the squares by which scores (..., k) exceed what is usual."""
    return np.asarray(np.square(np.maximum(scores - usual - MARGIN, 0.0)).sum(axis=-1))


def ascended(measure: Callable[[Floats], float], at: Floats, steps: Floats) -> Floats:
    """Where a measure is greatest near a place (k,), axis by axis, by steps that are halved from round to round."""
    best = measure(at)
    for halved in 0.5 ** np.arange(ROUNDS):
        for step in halved * np.concatenate([np.diag(steps), -np.diag(steps)]):
            while (value := measure(at + step)) > WORTH * best:
                at, best = at + step, value
    return at


def edges_at(average: Average, left: int, right: int) -> tuple[float, float]:
    """Centre and width of a pair, by where the columns' mean edges peak beside it, to a fraction of a column."""
    line = np.minimum(np.abs(average.edges), 1.5).mean(axis=0)
    reach = min(2, (right - left - 1) // 2)
    places = []
    for column in np.clip([left, right], 3, len(line) - 4).tolist():
        peak = column - reach + int(line[column - reach : column + reach + 1].argmax())
        before, here, after = line[peak - 1 : peak + 2].tolist()
        bend = min(before - 2 * here + after, -1e-6)
        places.append(peak + min(max(0.5 * (before - after) / bend, -0.5), 0.5))
    return float(average.x[0]) + sum(places) / 2 * average.cell, (places[1] - places[0]) * average.cell


def ratios(scores: Floats) -> Floats:
    """The log-likelihood ratios (n,) of a post to another pair, by their scores (n,)."""
    odds = np.log(np.maximum(scores, 1e-3) / np.maximum(1 - scores, 1e-3))
    post, other = (-0.5 * ((odds - mean) / sigma) ** 2 - math.log(sigma) for mean, sigma in (POST, OTHER))
    return np.asarray(np.clip(post - other, -BOUND, BOUND))
