"""The height of the floor, by a plane sweep: a level plane is moved through heights until the pictures of all frames
correlate on it.

Guards, plinths and goods may hide where a structure meets the floor. The floor itself shows stains, joints, scratches
and markings. On a plane at the floor's own height, each of these has the same place in all frames. The camera's path is
that which the structures give. The sweep is that of flat parts (`savmap.vision.evidence.depth`). A coarse sweep in
small pictures comes first: of the height only the range is known, as a share of the distance to the face.

Concrete has little texture: no single section has a clear peak. So the correlations of all sections are added up. They
are not weighted by contrast: what has most contrast (a beam's label, a shadow's edge) is often not of the floor. The
height is accepted if the peak stays where it is when any stretch of the row or any strip of the floor is left out
(jackknife). Reflections lie at many depths.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import pairwise

import cv2
import numpy as np

from savmap.types import Floats, PlanePatch, Track, Trajectory, ViewSpec, array_record
from savmap.vision.evidence.depth import Shot, Singles, Sweep, near_cameras, summit
from savmap.vision.evidence.planes import PackedView

LABEL = "floor"
HEIGHTS = np.geomspace(0.35, 3.0, 9).tolist()
"""Heights of the camera over the floor, at the centres of the coarse sweeps, as shares of its distance from the face.
"""
DETAIL_PX = 12.0
"""Coarser structure of a view is removed: brightness falls off, and gloss moves with the camera."""
STRIPS, BEFORE, BESIDE = 6, 0.25, 0.25
"""The number of strips of floor along the face; their margin to the face, as a share of the distance (beams and goods
hide the floor there); and their margin to the camera, as a share of the height (the cart hides it there)."""
PIECE, MOST_PIECES = 5.0, 6
"""The length of a piece of a strip, in heights of the camera, and the most pieces that are evaluated."""
OTHER, LEAST_RATIO = 0.08, 1.3
"""The correlation at the height must exceed that at heights that differ by more than this share, by this factor."""
LEAST_RISE = 0.01
"""The least excess of the peak over the median, per section: the noise of a plain floor stays below."""
LEAST_GROUPS, MOST_SIGMA = 3, 0.015
"""The least number of stretches (each as long as the camera is high) and of strips; the greatest sigma of the height,
as a share of it."""
FLATNESS = 0.003
"""The sigma of the height difference between the floor in front of the face and under the camera, as a share: 6 mm at 2
m."""
POINTS, SIGMA_PX = 12, 2.0
"""The number of floor points, and the standard deviation of their pixels. The pixels follow from this path. The path of
rows that are solved together may be rotated from it by a fraction of a degree."""
LEAST_TANGENT = 0.5


BELOW_FLOOR = 0.4
"""The floor is never higher than this share of the tracked points. Some true points lie below it: uprights' edges are
extended to the picture's border. These are a third of all points at most."""


@dataclass(frozen=True)
class Fineness:
    """A sweep: range and step as shares of the height; by what factor the pictures are reduced; `strip_step`: 2 for
    every other strip."""

    reach: float
    step: float
    smaller: int
    strip_step: int

    @property
    def shares(self) -> Floats:
        """The heights (n,) that are tried, as shares of the central one."""
        return 1 + np.arange(-self.reach, self.reach + self.step / 2, self.step)


COARSE, FINE = Fineness(0.16, 0.024, 4, 2), Fineness(0.06, 0.004, 2, 1)
MOST_KEPT = 160
"""Pictures that are kept unpacked: 50 MB of the fine sweep's."""


@dataclass(frozen=True, eq=False)
@array_record
class FloorTracks:
    """Tracks of points of the floor, each in a few frames, and the views of their pixels by name. `sigma`: the standard
    deviation of their common depth below the camera, as a share of it."""

    tracks: tuple[Track, ...] = ()
    views: Mapping[str, ViewSpec] = field(default_factory=dict)
    sigma: float = FLATNESS


@dataclass(frozen=True, eq=False)
@array_record
class FloorShot(Shot):
    """A view of the floor. No edge of it was measured in the pictures, so the plane is not scaled with its depth."""

    def pixels_from(self, depths: Floats, distance: float, height: float) -> Floats:
        """The homographies (n, 3, 3) to pixels from planes at depths (n,) above the part."""
        return self._pixels_from(depths, np.ones(len(depths)), height)


@dataclass(frozen=True)
class FloorHeight:
    """Where the floor is: its `y` in the path's frame and unit; `share`: how high the camera is over it, as a share of
    its distance from the face, which no path's scale changes; `sigma`: the standard deviation of that height, as a
    share of it."""

    y: float
    share: float
    sigma: float


def floor_height(
    face: PlanePatch,
    packed_views: Sequence[PackedView],
    views: Mapping[str, ViewSpec],
    path: Trajectory,
    about: float | None = None,
) -> FloorHeight | None:
    """The height of the floor in front of a face; None where the pictures do not determine it.

    face: an upright plane in the row's frame (y up). packed_views: pictures of the floor, in `views`. path: the
    camera's poses, in any unit. about: the `share` that an earlier path gave, which saves the coarse sweep.
    """
    floor = Floor.before(face, packed_views, views, path)
    return floor.measured(about) if floor else None


def floor_before(
    face: PlanePatch,
    points: Floats,
    packed_views: Sequence[PackedView],
    views: Mapping[str, ViewSpec],
    path: Trajectory,
    about: float | None,
) -> FloorHeight | None:
    """The same, but nothing that lies higher than much of what was tracked, points (n, 3): that is something else."""
    floor = floor_height(face, packed_views, views, path, about)
    return floor if floor is not None and floor.y <= np.quantile(points[:, 1], BELOW_FLOOR) else None


def floor_tracks(
    face: PlanePatch,
    packed_views: Sequence[PackedView],
    views: Mapping[str, ViewSpec],
    path: Trajectory,
    height: FloorHeight,
) -> FloorTracks:
    """Points of the floor in front of a face, at the `height` that `floor_height` gave for the same pictures."""
    floor = Floor.before(face, packed_views, views, path)
    tracks = tuple(floor.tracks(height.share)) if floor else ()
    return FloorTracks(tracks, dict(views), float(np.hypot(height.sigma, FLATNESS))) if tracks else FloorTracks()


class Floor:
    """The floor in front of a face, and pictures of it. `away`: the camera's median distance from the face, the unit of
    heights here."""

    def __init__(
        self,
        face: PlanePatch,
        packed_views: Sequence[PackedView],
        views: Mapping[str, ViewSpec],
        poses: Mapping[int, Floats],
    ) -> None:
        self.face, self.packed_views, self.views, self.poses = face, packed_views, views, poses
        self.places = np.array([poses[packed_view.frame][:3, 3] for packed_view in packed_views])
        self.forward = face.axes[:, 2]
        self.away = float(np.median((self.places - face.origin) @ self.forward))
        self.level = float(np.median(self.places[:, 1]))
        self._detail = lru_cache(MOST_KEPT)(_detail)

    @classmethod
    def before(
        cls, face: PlanePatch, packed_views: Sequence[PackedView], views: Mapping[str, ViewSpec], path: Trajectory
    ) -> "Floor | None":
        """The floor before a face, in pictures whose pose is known; None where there are none, or where they are of the
        other side."""
        poses = dict(zip(path.frames.tolist(), path.world_from_rig, strict=True))
        located = [packed_view for packed_view in packed_views if packed_view.frame in poses]
        floor = cls(face, located, views, poses) if located else None
        return floor if floor and floor.away > 0 else None

    def measured(self, about: float | None = None) -> FloorHeight | None:
        """Where the floor is: near a height that is given, or else wherever. None where the pictures do not tell."""
        near = None if about is None else self._near(about)
        if near is None and (rough := self.rough_height()) is not None:
            near = self._near(rough)
        return near

    def _near(self, rough: float) -> FloorHeight | None:
        height = self.height(rough)
        if height is None or height[1] > MOST_SIGMA:
            return None
        return FloorHeight(self.level - height[0] * self.away, *height)

    def rough_height(self) -> float | None:
        """The height of the camera over the floor, to a step of the coarse sweep. None without a clear peak."""
        curves = {height: _mean(groups) for height in HEIGHTS if (groups := self.correlations(height, COARSE))}
        if not curves:
            return None
        tried = np.concatenate([height * COARSE.shares for height in curves])
        correlation = np.concatenate([*curves.values()])
        best = int(correlation.argmax())
        others = correlation[np.abs(np.log(tried / tried[best])) > OTHER]
        if not len(others) or correlation[best] <= LEAST_RATIO * others.max():
            return None
        return float(tried[best])

    def height(self, rough: float) -> tuple[float, float] | None:
        """The height of the camera over the floor, and its sigma as a share of it. None where parts of the floor
        disagree."""
        groups = self.correlations(rough, FINE)
        total = sum((curve for curve, _ in groups.values()), np.zeros(len(FINE.shares)))
        peak = _peak(total)
        sigmas = [_jackknife(groups, which, total) for which in (0, 1)]
        finite = [sigma for sigma in sigmas if sigma is not None]
        count = sum(count for _, count in groups.values())
        if peak is None or len(finite) < len(sigmas) or total.max() - np.median(total) < LEAST_RISE * count:
            return None
        return rough * peak, max(finite)

    def correlations(self, height: float, fineness: Fineness) -> dict[tuple[int, int], tuple[Floats, int]]:
        """By stretch of the row and strip of the floor: the correlation (n,) at the sweep's heights about `height`,
        summed over sections, and the number of sections."""
        groups: dict[tuple[int, int], tuple[Floats, int]] = {}
        smaller = {name: _smaller(spec, fineness.smaller) for name, spec in self.views.items()}
        for strip, part in self._pieces(height, fineness.strip_step):
            near = [self.packed_views[k] for k in near_cameras(part, self.places)]
            shots = [FloorShot.of(packed, smaller[packed.view], self.poses[packed.frame], part) for packed in near]
            sweep = Sweep.over(part, shots, fineness.reach)
            if sweep is None:
                continue
            pictures = [self._detail(shot.packed_view, fineness.smaller) for shot in sweep.shots]
            depths = (1 - fineness.shares) * height * self.away
            correlation, _ = sweep.correlations(depths, pictures)
            start = float(part.origin @ part.right)
            for section in sweep.informative.tolist():
                along = start + (section + 0.5) * sweep.columns * sweep.cell
                group = int(np.floor(along / (height * self.away))), strip
                curve, count = groups.get(group, (np.zeros(len(depths)), 0))
                groups[group] = curve + correlation[:, section], count + 1
        return groups

    def tracks(self, height: float) -> Iterator[Track]:
        """Points of the floor all along the row, each in three frames: before the camera passes it, when it is nearest,
        and after."""
        first, last = self._reach(height)
        along = self.places @ self.face.right
        for number, place in enumerate(np.linspace(along.min(), along.max(), POINTS).tolist(), 1):
            far = first + (last - first) * (number % 3 + 1) / 4
            track = self._track(number, self._point(height, place, far))
            if track is not None:
                yield track

    def _point(self, height: float, along: float, before: float) -> Floats:
        """The point (3,) at `height` below the camera, `along` the face, and `before` it."""
        level = np.array([0.0, self.level - height * self.away, 0.0])
        return np.asarray(level + along * self.face.right + (self.face.origin @ self.forward + before) * self.forward)

    def _reach(self, height: float) -> tuple[float, float]:
        """The distances from the face at which the strips begin and end."""
        return BEFORE * self.away, max(1 - BESIDE * height, 2 * BEFORE) * self.away

    def _pieces(self, height: float, strip_step: int) -> Iterator[tuple[int, PlanePatch]]:
        """Pieces of the strips of floor at `height` below the camera, of every `strip_step`-th strip, with the strip's
        number."""
        edges = np.linspace(*self._reach(height), STRIPS + 1).tolist()
        length = height * self.away
        along = self.places @ self.face.right
        low, high = float(along.min()) - length / 2, float(along.max()) + length / 2
        count = max(round((high - low) / (PIECE * length)), 1)
        starts = np.linspace(low, high, count + 1)
        for k in np.unique(np.linspace(0, count - 1, min(count, MOST_PIECES)).astype(int)).tolist():
            for strip, (near, far) in [*enumerate(pairwise(edges))][::strip_step]:
                size = np.array([starts[k + 1] - starts[k], far - near])
                corner = self._point(height, float(starts[k]), far)
                yield strip, PlanePatch(LABEL, corner, self.face.right, -self.forward, size, float(size[1]))

    def _track(self, number: int, point: Floats) -> Track | None:
        """A point's pixels in three views. None where it is not seen from directions that differ enough."""
        sightings = [
            sighting
            for packed_view in self.packed_views
            if (sighting := self._sighting(packed_view, point)) is not None
        ]
        tangents = np.array([tangent for _, tangent, _ in sightings])
        if not len(tangents) or np.ptp(tangents) < LEAST_TANGENT:
            return None
        chosen = {int(tangents.argmin()), int(np.abs(tangents).argmin()), int(tangents.argmax())}
        shown = sorted((sightings[k] for k in chosen), key=lambda sighting: sighting[0].frame)
        return Track(
            f"{LABEL} {number}",
            LABEL,
            {LABEL: number},
            np.array([packed_view.frame for packed_view, _, _ in shown], np.int64),
            tuple(packed_view.view for packed_view, _, _ in shown),
            np.array([pixel for _, _, pixel in shown]),
            np.tile(SIGMA_PX**2 * np.eye(2), (len(shown), 1, 1)),
        )

    def _sighting(self, packed_view: PackedView, point: Floats) -> tuple[PackedView, float, Floats] | None:
        """The tangent of the direction, along the face, in which a view shows a point, and the point's pixel (2,). None
        outside the view."""
        pose, spec = self.poses[packed_view.frame], self.views[packed_view.view]
        x, y, depth = spec.camera @ (pose[:3, :3] @ spec.rig_from_view).T @ (point - pose[:3, 3])
        if depth <= 0 or not (0 < x / depth < spec.width - 1 and 0 < y / depth < spec.height - 1):
            return None
        tangent = float((point - pose[:3, 3]) @ self.face.right) / float(pose[1, 3] - point[1])
        return packed_view, tangent, np.array([x, y]) / depth


def _smaller(spec: ViewSpec, factor: int) -> ViewSpec:
    return replace(spec, width=spec.width // factor, height=spec.height // factor)


def _detail(packed_view: PackedView, smaller: int) -> Singles:
    """The fine detail of a picture, reduced by the factor `smaller`."""
    grey = packed_view.grey().astype(np.float32)
    size = grey.shape[1] // smaller, grey.shape[0] // smaller
    small = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
    return np.asarray(small - cv2.GaussianBlur(small, (0, 0), DETAIL_PX / smaller), np.float32)


def _mean(groups: Mapping[tuple[int, int], tuple[Floats, int]]) -> Floats:
    """The mean correlation (n,) of a section, over all groups."""
    curves, counts = zip(*groups.values(), strict=True)
    return np.asarray(np.sum(curves, axis=0) / sum(counts))


def _peak(curve: Floats) -> float | None:
    """The share at which a curve (n,) over the fine sweep has its maximum. None without one."""
    peak = summit(curve)
    return None if peak is None else float(FINE.shares[0] + FINE.step * peak[0])


def _jackknife(groups: Mapping[tuple[int, int], tuple[Floats, int]], which: int, total: Floats) -> float | None:
    """The jackknife sigma of the peak of a sum (n,): the groups of each stretch (`which` 0) or of each strip (1) are
    left out in turn. None where there are too few, or where a sum has no peak."""
    parts = {group[which] for group in groups}
    if len(parts) < LEAST_GROUPS:
        return None
    rests = [total - sum(curve for group, (curve, _) in groups.items() if group[which] == part) for part in parts]
    peaks = [peak for peak in map(_peak, rests) if peak is not None]
    if len(peaks) < len(parts):
        return None
    return float(np.sqrt((len(peaks) - 1) * np.var(peaks)))
