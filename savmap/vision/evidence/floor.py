"""Where the floor is, by what shows on it: a level plane is swept through heights until all frames agree.

What stands on a floor may hide where it meets it: guards, plinths, goods. The floor itself moves through the pictures as no other height
does: stains, joints, scratches and markings fall on themselves in all frames where a plane is laid at the floor's own height, by the camera's
path as the structures give it. The sweep is that of flat parts (`savmap.vision.evidence.depth`), at first a coarse one in small pictures,
for nothing is known of the height but that it is some share of the distance to the face.

Concrete shows little: no section of it tells anything by itself. So the sections are added up, each by how much alike the pictures
of it are, and none by its contrast: what stands out most (a beam's label, a shadow's edge) is often not of the floor. What the sum tells is believed
where it stays, with any stretch of the row or any strip of the floor left out (jackknife). Reflections lie at many depths.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import pairwise

import cv2
import numpy as np

from savmap.types import Floats, PlanePatch, Track, Trajectory, ViewSpec, array_record
from savmap.vision.evidence.depth import MOST_SHOTS, Shot, Singles, Sweep, near_cameras
from savmap.vision.evidence.planes import PackedView

LABEL = "floor"
HEIGHTS = np.geomspace(0.35, 3.0, 9).tolist()
"""Of the camera over the floor, about which the coarse sweep looks: shares of its distance from the face."""
DETAIL_PX = 12.0
"""What is coarser than that in a view does not count: brightness falls off, and gloss goes with the camera."""
STRIPS, BEFORE, BESIDE = 6, 0.25, 0.25
"""So many strips of floor along the face, from so far before it, as a share of the distance, to so far beside the camera, as a share of the
height: beams and goods stand out over the one, and the cart is seen at the other."""
PIECE, MOST_PIECES = 5.0, 6
"""How long pieces of a strip are, in heights of the camera, and how many are looked at."""
OTHER, LEAST_RATIO = 0.08, 1.3
"""At heights that differ by more than this share the pictures are less alike, by this factor."""
LEAST_RISE = 0.01
"""By how much more alike they are at the height than at most about it: a plain floor's noise stays below."""
LEAST_GROUPS, MOST_SIGMA = 3, 0.015
"""So many stretches, each as long as the camera is high, and strips; and how sure the height must be, as a share."""
FLATNESS = 0.003
"""By how much the floor before the face may lie higher or lower than that under the camera: 6 mm at 2 m."""
POINTS, SIGMA_PX = 12, 2.0
"""Points of the floor that are told, and the standard deviation of their pixels, which follow from this path: another, of rows solved together, may turn by a
fraction of a degree."""
LEAST_TANGENT = 0.5


@dataclass(frozen=True)
class Fineness:
    """How far and in what steps planes are swept, as shares of the height, in pictures so many times smaller; `every`: 2 for every other strip."""

    reach: float
    step: float
    smaller: int
    strip_step: int

    @property
    def shares(self) -> Floats:
        """The heights (n,) that are tried, as shares of that about which."""
        return 1 + np.arange(-self.reach, self.reach + self.step / 2, self.step)


COARSE, FINE = Fineness(0.16, 0.012, 4, 2), Fineness(0.048, 0.004, 2, 1)


@dataclass(frozen=True, eq=False)
@array_record
class FloorTracks:
    """Tracks of points of the floor, each in a few frames, and the views of their pixels by name. `sigma`: how sure their common depth below the
    camera is, as a share of it."""

    tracks: tuple[Track, ...] = ()
    views: Mapping[str, ViewSpec] = field(default_factory=dict)
    sigma: float = FLATNESS


@dataclass(frozen=True, eq=False)
@array_record
class FloorShot(Shot):
    """A look at the floor, with whose height nothing else goes."""

    def pixels_from(self, depth: float, distance: float, height: float) -> Floats:
        """The homography (3, 3) from a plane `depth` above the part."""
        right, up, before = self.place
        nearer = before / (before - depth)
        moved = np.diag([nearer, nearer, 1.0])
        moved[:2, 2] = right * (1 - nearer), up * (1 - nearer)
        return np.asarray(self.pixels_from_part @ moved)


def floor_tracks(
    face: PlanePatch, packed_views: Sequence[PackedView], views: Mapping[str, ViewSpec], path: Trajectory
) -> FloorTracks:
    """Points of the floor before a face; none where the pictures do not tell where it is.

    face: a plane that stands upright in the row's frame (y up). looks: pictures of the floor, in `views`. path: where the camera was, in any
    unit.
    """
    poses = dict(zip(path.frames.tolist(), path.world_from_rig, strict=True))
    known = [packed_view for packed_view in packed_views if packed_view.frame in poses]
    if not known:
        return FloorTracks()
    floor = Floor(face, known, views, poses)
    rough = floor.rough_height() if floor.away > 0 else None
    measured = None if rough is None else floor.height(rough)
    if measured is None or measured[1] > MOST_SIGMA:
        return FloorTracks()
    return FloorTracks(tuple(floor.tracks(measured[0])), dict(views), float(np.hypot(measured[1], FLATNESS)))


class Floor:
    """The floor before a face, and pictures of it. `away`: the camera's usual distance from the face, in which heights are counted here."""

    def __init__(
        self,
        face: PlanePatch,
        packed_views: Sequence[PackedView],
        views: Mapping[str, ViewSpec],
        poses: Mapping[int, Floats],
    ) -> None:
        self.face, self.packed_views, self.views, self.poses = face, packed_views, views, poses
        self.places = np.array([poses[packed_view.frame][:3, 3] for packed_view in packed_views])
        self.forward = np.cross(face.right, face.up)
        self.away = float(np.median((self.places - face.origin) @ self.forward))
        self.level = float(np.median(self.places[:, 1]))
        self._detail = lru_cache(4 * MOST_SHOTS)(_detail)

    def rough_height(self) -> float | None:
        """The height of the camera over the floor, to a step of the coarse sweep; None where no height stands out."""
        curves = {height: _mean(groups) for height in HEIGHTS if (groups := self.correlations(height, COARSE))}
        if not curves:
            return None
        tried = np.concatenate([height * COARSE.shares for height in curves])
        correlation = np.concatenate([*curves.values()])
        best = int(correlation.argmax())
        others = correlation[np.abs(np.log(tried / tried[best])) > OTHER]
        return float(tried[best]) if len(others) and correlation[best] > LEAST_RATIO * others.max() else None

    def height(self, rough: float) -> tuple[float, float] | None:
        """The height of the camera over the floor, and its sigma as a share of it; None where parts of the floor do not agree."""
        groups = self.correlations(rough, FINE)
        total = sum((curve for curve, _ in groups.values()), np.zeros(len(FINE.shares)))
        peak = _peak(total)
        sigmas = [_jackknife(groups, which, total) for which in (0, 1)]
        known = [sigma for sigma in sigmas if sigma is not None]
        count = sum(count for _, count in groups.values())
        if peak is None or len(known) < len(sigmas) or total.max() - np.median(total) < LEAST_RISE * count:
            return None
        return rough * peak, max(known)

    def correlations(self, height: float, fineness: Fineness) -> dict[tuple[int, int], tuple[Floats, int]]:
        """By stretch of the row and strip of the floor: how much alike (n,) the pictures are at heights about `height`, the sum over the sections, and
        the number of these."""
        groups: dict[tuple[int, int], tuple[Floats, int]] = {}
        for strip, part in self._pieces(height, fineness.strip_step):
            shots = [self._shot(self.packed_views[k], part, fineness) for k in near_cameras(part, self.places)]
            sweep = Sweep.over(part, shots, fineness.reach)
            if sweep is None:
                continue
            pictures = [self._detail(shot.packed_view, fineness.smaller) for shot in sweep.shots]
            depths = (1 - fineness.shares) * height * self.away
            correlation = np.array([sweep.correlation(depth, pictures)[0] for depth in depths.tolist()])
            start = float(part.origin @ part.right)
            for section in sweep.informative.tolist():
                along = start + (section + 0.5) * sweep.columns * sweep.cell
                group = int(np.floor(along / (height * self.away))), strip
                curve, count = groups.get(group, (np.zeros(len(depths)), 0))
                groups[group] = curve + correlation[:, section], count + 1
        return groups

    def tracks(self, height: float) -> Iterator[Track]:
        """Points of the floor all along the row, each as it is seen from before it, from where it is nearest, and from behind it."""
        first, last = self._reach(height)
        along = self.places @ self.face.right
        for number, place in enumerate(np.linspace(along.min(), along.max(), POINTS).tolist(), 1):
            far = first + (last - first) * (number % 3 + 1) / 4
            track = self._track(number, self._point(height, place, far))
            if track is not None:
                yield track

    def _point(self, height: float, along: float, before: float) -> Floats:
        """The point (3,) so far below the camera, along the face, and before it."""
        level = np.array([0.0, self.level - height * self.away, 0.0])
        return np.asarray(level + along * self.face.right + (self.face.origin @ self.forward + before) * self.forward)

    def _reach(self, height: float) -> tuple[float, float]:
        """How far before the face the strips begin and end."""
        return BEFORE * self.away, max(1 - BESIDE * height, 2 * BEFORE) * self.away

    def _pieces(self, height: float, strip_step: int) -> Iterator[tuple[int, PlanePatch]]:
        """Strips of the floor, so far below the camera, all or every other one, cut into pieces, with the strips' numbers."""
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

    def _shot(self, packed_view: PackedView, part: PlanePatch, fineness: Fineness) -> FloorShot:
        spec = self.views[packed_view.view]
        smaller = replace(spec, width=spec.width // fineness.smaller, height=spec.height // fineness.smaller)
        return FloorShot.of(packed_view, smaller, self.poses[packed_view.frame], part)

    def _track(self, number: int, point: Floats) -> Track | None:
        """A point's pixels in three looks; None where it is not seen from directions that differ enough."""
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
        """The tangent of the direction, along the face, in which a look shows a point, and where, px; None where it does not."""
        pose, spec = self.poses[packed_view.frame], self.views[packed_view.view]
        x, y, depth = spec.camera @ (pose[:3, :3] @ spec.rig_from_view).T @ (point - pose[:3, 3])
        if depth <= 0 or not (0 < x / depth < spec.width - 1 and 0 < y / depth < spec.height - 1):
            return None
        tangent = float((point - pose[:3, 3]) @ self.face.right) / float(pose[1, 3] - point[1])
        return packed_view, tangent, np.array([x, y]) / depth


def _detail(packed_view: PackedView, smaller: int) -> Singles:
    """The fine detail of a picture, so many times smaller."""
    grey = packed_view.grey().astype(np.float32)
    size = grey.shape[1] // smaller, grey.shape[0] // smaller
    small = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
    return np.asarray(small - cv2.GaussianBlur(small, (0, 0), DETAIL_PX / smaller), np.float32)


def _mean(groups: Mapping[tuple[int, int], tuple[Floats, int]]) -> Floats:
    """How much alike (n,) the pictures of a section are, on average over all groups."""
    curves, counts = zip(*groups.values(), strict=True)
    return np.asarray(np.sum(curves, axis=0) / sum(counts))


def _peak(curve: Floats) -> float | None:
    """Where a curve (n,) over the fine sweep's shares has its maximum, between samples; None at its ends, or where it has none."""
    best = int(curve.argmax())
    if not 0 < best < len(curve) - 1:
        return None
    before, top, after = curve[best - 1 : best + 2].tolist()
    bend = 2 * top - before - after
    return float(FINE.shares[best] + 0.5 * FINE.step * (after - before) / bend) if bend > 0 else None


def _jackknife(groups: Mapping[tuple[int, int], tuple[Floats, int]], which: int, total: Floats) -> float | None:
    """The sigma of the peak of a sum (n,) by leaving out, one after the other, the groups with one stretch (0) or strip (1); None where they are
    too few, or the peak does not stay."""
    parts = {group[which] for group in groups}
    if len(parts) < LEAST_GROUPS:
        return None
    rests = [total - sum(curve for group, (curve, _) in groups.items() if group[which] == part) for part in parts]
    peaks = [peak for peak in map(_peak, rests) if peak is not None]
    if len(peaks) < len(parts):
        return None
    return float(np.sqrt((len(peaks) - 1) * np.var(peaks)))
