"""Edges and corners of uprights and beams in one view, measured in the panorama along the outlines of what was found.

Where the model has an edge, straight pieces of the panorama are searched for the line that most of them agree on
(savmap.vision.subpixel). What is hidden there agrees on none, and is left out of this frame. Corners are where the
edges of a beam cross those of the uprights that it ends at (paper, section III.C).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.geometry.lines import Lines, crossing, crossing_covariance
from savmap.geometry.pinhole import project
from savmap.types import Axis, Bools, Feature, Floats, FoundObject, Ints, Panorama, ViewSpec
from savmap.vision.subpixel import Edges, Subpixel, measured

OUTLINED = Subpixel(prior_px=0.8, flanked_bias_px=0.0, inner=(0.5, 0.15))
"""Edges of what was found are where the evidence of all frames has them, to a part of a pixel."""
POINTS, NEAR = np.linspace(0.0, 1.0, 65)[:, None, None], 1e-3
"""Of an edge, which a view may show; and the least depth of these, in the camera's distance from the face."""
SHORTEST_PX, LEAST_ASPECT = 20.0, 1.5
"""What a view shows shorter of an edge, or shorter beside the member's thickness, is not measured."""
ACROSS, MIDDLE = np.linspace(-0.5, 1.5, 33), slice(13, 20)
"""Across a member, from one outline to the other: where scores are taken, and which of these are amid it."""
SEEN_QUANTILE, FAINTEST, BAND = 80.0, 0.06, 0.15
"""A member is seen where this percentile of the scores along it is no fainter; and how far from its outline, as a share
of its thickness, a network may see its edge."""
SAME = 0.4
"""Edges that are nearer to each other than this share of the member's thickness are one line."""
LEAST_SIGMA_PX, ALONG_SIGMA_PX, UNMEASURED_PX = 0.02, 200.0, 0.8
"""No edge is better known; an edge's ends, along it; and an edge that was not measured, across it."""
FOOT_PX, FOOT_MARGIN_PX = (2.0, 3.0), 6.0
"""Standard deviations of a foot, across the upright and along it, and how far from the picture's border one shows."""
STANDING_PARTS, LYING_PARTS, LEAST_PART_PX = 8, 4, 10.0
"""Of an upright's and of a beam's edge, each measured by itself."""
SIDES = {"upright": ("left", "right"), "beam": ("upper", "lower")}
Parts = list[tuple[Lines, Floats, Bools]]
"""Of each part: lines (2 g,) of the one, then the other edges of g members, the middle u (2 g,) of the part, and which
could be measured."""


@dataclass(frozen=True, eq=False)
class Members:
    """What a view shows of g members of one class: edges as lines v(u), those at smaller v first, with u along members:
    rows of uprights, columns of beams. `scored` (2 g,): edges that count where scores have them if the panorama
    does not show them, and `guessed` (2 g,) those of which scores say only that they are not at the outline."""

    objects: Sequence[FoundObject]
    edges: Edges
    scores: Floats
    scored: Bools
    guessed: Bools

    @property
    def label(self) -> str:
        """Their class."""
        return "upright" if self.edges.stands else "beam"

    def measured(self, lines: Lines, seen: Bools) -> "MeasuredMembers":
        """With lines as the panorama shows them, and which it shows. Of two that are one line that is left out which is
        farther from where it should be."""
        count, middle = len(self.objects), self.edges.middle
        off = np.abs(lines.at(middle) - self.edges.lines.at(middle))
        spacing = np.abs(lines.at(middle)[:count] - lines.at(middle)[count:])
        same = (spacing < SAME * self.edges.thickness[:count]) & seen[:count] & seen[count:]
        guessed = self.guessed & ~seen
        seen = seen | self.scored
        farther = np.concatenate([same & (off[:count] > off[count:]), same & (off[:count] <= off[count:])])
        return MeasuredMembers(self, lines, seen & ~farther, guessed)


@dataclass(frozen=True, eq=False)
class MeasuredMembers:
    """Members with their edges' `lines` (2 g,), which of them were measured (2 g,), and which only guessed."""

    members: Members
    lines: Lines
    seen: Bools
    guessed: Bools


def measure(
    objects: Sequence[FoundObject],
    spec: ViewSpec,
    frame: int,
    world_from_rig: Floats,
    scores: NDArray[np.float32],
    panorama: Panorama,
    parts: bool = False,
) -> list[Feature]:
    """Features of found uprights and beams in a view of a frame; `scores` (2, h, w) of both classes, of the view at any
    size.

    Per upright: edges "left" and "right", extended to the view's borders, top end first, and a point "foot" where it
    ends inside the view. Per beam: edges "upper" and "lower", left end first, and corners "upper left" ... with the
    uprights that it ends at. If asked for, `parts` of each edge by themselves: points "left part", "upper part" ...
    Covariances px^2. An edge with a score of 0 is guessed, and counts only where nothing else was measured of it.
    """
    camera = world_from_rig[:3, 3], world_from_rig[:3, :3] @ spec.rig_from_view
    both = [
        _members([item for item in objects if item.label == label], spec, camera, score)
        for label, score in zip(SIDES, scores, strict=True)
    ]
    lines = measured(panorama, spec, [members.edges for members in both], OUTLINED)
    uprights, beams = (members.measured(*line) for members, line in zip(both, lines, strict=True))
    view = ViewFeatures(spec, frame)
    features = [*view.edges_of(uprights), *view.feet(uprights, camera), *view.edges_of(beams)]
    features += view.corners(uprights, beams)
    if parts:
        features += view.parts_of(panorama, uprights, STANDING_PARTS)
        features += view.parts_of(panorama, beams, LYING_PARTS)
    return features


def _members(
    objects: Sequence[FoundObject], spec: ViewSpec, camera: tuple[Floats, Floats], score: NDArray[np.float32]
) -> Members:
    """The members of one class that a view shows, from a camera (3,) that is turned (3, 3)."""
    stands = bool(objects) and objects[0].label == "upright"
    outlines = np.array([item.outline for item in objects]).reshape(-1, 4, 3)
    # corners: lower left, lower right, upper right, upper left
    first_side, second_side = ((3, 0), (2, 1)) if stands else ((3, 2), (0, 1))
    seen, score_of, inwards = _scored(outlines, stands, spec, camera, score)
    inwards = inwards if stands else inwards[:, ::-1]
    ends = np.concatenate([outlines[:, first_side], outlines[:, second_side]])
    across = np.roll(ends, len(outlines), axis=0) - ends
    ends = ends + inwards.T.reshape(-1, 1, 1) * across
    lines, first, last, at = _seen(ends, spec, camera, stands)
    counterpart, _ = _projected(at + across[:, 0], spec, camera, stands)
    thickness = np.abs(counterpart[:, 1] - lines.at((first + last) / 2))
    long = last - first >= np.maximum(SHORTEST_PX, LEAST_ASPECT * thickness)
    wanted = (lines.inliers > 0) & long & np.tile(seen, 2)
    shown = wanted[: len(objects)] | wanted[len(objects) :]
    both = np.tile(shown, 2)
    ray = at - camera[0]
    obliquely = (ray[:, 0] if stands else -ray[:, 1]) / np.maximum(-ray[:, 2], 1e-9)
    inside = np.repeat([1.0, -1.0], len(objects))
    flank = np.maximum(inside * obliquely, 0.0)
    spans = first[both], last[both], inside[both], thickness[both], flank[both]
    kept = [item for item, is_shown in zip(objects, shown.tolist(), strict=True) if is_shown]
    guessed = np.abs(inwards.T.ravel()) >= BAND
    lines = replace(lines, offset_var=np.where(guessed, np.square(BAND * thickness), 0.0))
    edges = Edges(lines[both], *spans, stands=stands, patterned=stands, wanted=wanted[both])
    return Members(kept, edges, score_of[shown], (wanted & stands)[both], guessed[both])


def _projected(points: Floats, spec: ViewSpec, camera: tuple[Floats, Floats], stands: bool) -> tuple[Floats, Bools]:
    """u and v (..., 2) of points (..., 3), and which are in the picture."""
    local = (points - camera[0]) @ camera[1]
    pixels = project(local, spec.camera)
    near = local[..., 2] > NEAR * max(abs(float(camera[0][2])), 1e-9)
    inside = near & (pixels >= 0).all(axis=-1) & (pixels <= [spec.width - 1, spec.height - 1]).all(axis=-1)
    return np.where(near[..., None], pixels[..., ::-1] if stands else pixels, 0.0), np.asarray(inside)


def _seen(
    ends: Floats, spec: ViewSpec, camera: tuple[Floats, Floats], stands: bool
) -> tuple[Lines, Floats, Floats, Floats]:
    """The part that a view shows of straight edges with these ends (n, 2, 3): as lines, none with inliers where there
    is none, the first and the last u, and the middle (n, 3) of the part."""
    points = ends[:, 0] + POINTS * (ends[:, 1] - ends[:, 0])
    pixels, inside = _projected(points, spec, camera, stands)
    numbers = np.arange(len(ends))
    low, high = inside.argmax(axis=0), len(POINTS) - 1 - inside[::-1].argmax(axis=0)
    a, b = pixels[low, numbers], pixels[high, numbers]
    run = b - a
    fine = inside.any(axis=0) & (np.abs(run[:, 0]) > np.abs(run[:, 1]))
    slope = np.where(fine, run[:, 1] / np.where(fine, run[:, 0], 1.0), 0.0)
    middle = (a + b) / 2
    first, last = np.minimum(a[:, 0], b[:, 0]), np.maximum(a[:, 0], b[:, 0])
    nothing = np.zeros(len(ends))
    lines = Lines(middle[:, 0], slope, middle[:, 1], nothing, nothing, first, last, fine.astype(np.float64))
    # the middle of the picture's part, not of the edge's
    depth = ((points - camera[0]) @ camera[1])[..., 2]
    weight = depth[low, numbers], depth[high, numbers]
    share = (weight[0] / np.maximum(weight[0] + weight[1], 1e-9))[:, None]
    return lines, first, last, points[low, numbers] * (1 - share) + points[high, numbers] * share


def _scored(
    outlines: Floats, stands: bool, spec: ViewSpec, camera: tuple[Floats, Floats], score: NDArray[np.float32]
) -> tuple[Bools, Floats, Floats]:
    """Which members (g,) the network sees in a view, how much, and how far (g, 2) inside of both outlines, as shares of
    the member's thickness, its scores fall to half: `BAND` at most, for what is beyond it is something else."""
    if not len(outlines):
        return np.zeros(0, np.bool_), np.zeros(0), np.zeros((0, 2))
    right, up = outlines[:, 1] - outlines[:, 0], outlines[:, 3] - outlines[:, 0]
    along, across = (up, right) if stands else (right, up)
    points = outlines[:, 0] + ACROSS[:, None, None, None] * across + POINTS[::2] * along
    pixels, inside = _projected(points, spec, camera, False)
    at = np.asarray((pixels + 0.5) * (np.array(score.shape[::-1]) / [spec.width, spec.height]) - 0.5, np.float32)
    flat = at.reshape(len(ACROSS), -1, 2)
    shown = cv2.remap(score, flat[..., 0], flat[..., 1], cv2.INTER_LINEAR).reshape(inside.shape)
    core = np.where(inside, shown, np.nan)[MIDDLE].mean(axis=0)
    core[:, np.isnan(core).all(axis=0)] = 0.0
    usual = np.nanpercentile(core, SEEN_QUANTILE, axis=0)
    visible = np.nan_to_num(core) > usual / 2
    profile = (shown * visible).sum(axis=1) / np.maximum(visible.sum(axis=0), 1)
    half = np.maximum(usual, FAINTEST) / 2
    inwards = np.stack([_half_at(profile[::turn], half) for turn in (1, -1)], axis=1)
    return usual > FAINTEST, np.nanmean(core, axis=0), np.clip(inwards, -BAND, BAND)


def _half_at(profile: Floats, half: Floats) -> Floats:
    """How far (g,) inside of the first outline profiles (n, g) across members, from outside of it on, rise to a half
    (g,) for the last time before the middle."""
    middle, numbers = len(ACROSS) // 2, np.arange(len(half))
    below = profile[: middle + 1] < half
    last = middle - below[::-1].argmax(axis=0)
    before, after = profile[last, numbers], profile[np.minimum(last + 1, middle), numbers]
    share = np.clip((half - before) / np.maximum(after - before, 1e-9), 0.0, 1.0)
    return np.where(below.any(axis=0), ACROSS[last] + share * (ACROSS[1] - ACROSS[0]), -BAND)


@dataclass(frozen=True)
class ViewFeatures:
    """A view of a frame, and the features of what it shows."""

    spec: ViewSpec
    frame: int

    def feature(
        self, item: FoundObject, part: str, pixels: Floats, covariance: Floats, axis: Axis | None, score: float
    ) -> Feature:
        """A feature of an object; its instance is the object's number."""
        return Feature(
            self.frame, self.spec.name, item.label, part, 0, pixels, covariance, axis, min(score, 1.0), object=item.id
        )

    def edges_of(self, shown: MeasuredMembers) -> Iterator[Feature]:
        """The edges that were measured: an upright's from border to border, a beam's as far as it goes."""
        edges, count = shown.members.edges, len(shown.members.objects)
        ends = np.stack([edges.first, edges.last], axis=1)
        if edges.stands:
            ends = np.broadcast_to([-0.5, self.spec.height - 0.5], (2 * count, 2))
        across, covariances = _line_ends(shown.lines, ends)
        pixels = np.stack([ends, across], axis=-1)
        axis: Axis = "y" if edges.stands else "x"
        if edges.stands:
            pixels, covariances = pixels[..., ::-1], covariances[..., ::-1, ::-1]
        for index in np.flatnonzero(shown.seen).tolist():
            number, score = index % count, float(shown.members.scores[index % count])
            score, known_axis = (0.0, None) if shown.guessed[index] else (score, axis)
            item, part = shown.members.objects[number], SIDES[shown.members.label][index // count]
            yield self.feature(item, part, pixels[index], covariances[index], known_axis, score)

    def feet(self, shown: MeasuredMembers, camera: tuple[Floats, Floats]) -> Iterator[Feature]:
        """Where uprights end, inside the view."""
        covariance = np.diag(np.square(FOOT_PX))[None]
        for item, score in zip(shown.members.objects, shown.members.scores.tolist(), strict=True):
            (pixel,), (inside,) = _projected(item.outline[:2].mean(axis=0)[None], self.spec, camera, False)
            if inside and pixel[1] < self.spec.height - FOOT_MARGIN_PX:
                yield self.feature(item, "foot", pixel[None], covariance, None, score)

    def corners(self, uprights: MeasuredMembers, beams: MeasuredMembers) -> Iterator[Feature]:
        """Where edges of beams cross those of the uprights that they end at; these are where they were found where
        they were not measured."""
        count = len(uprights.members.objects)
        standing = {item.id: number for number, item in enumerate(uprights.members.objects)}
        drawn = uprights.lines
        drawn = replace(
            drawn, offset_var=np.where(uprights.seen, drawn.offset_var, drawn.offset_var + UNMEASURED_PX**2)
        )
        shown = uprights.members.edges.lines.inliers > 0
        size = len(beams.members.objects)
        for index in np.flatnonzero(beams.seen).tolist():
            item, score = beams.members.objects[index % size], float(beams.members.scores[index % size])
            bay = int(item.id.split()[1])
            for side, post, edge in (("left", bay, 1), ("right", bay + 1, 0)):
                number = standing.get(f"upright {post}")
                if number is None or not shown[number + edge * count]:
                    continue
                at: Ints = np.array([number + edge * count])
                level, upright = beams.lines[np.array([index])], drawn[at]
                point = crossing(level, upright)
                covariance = crossing_covariance(level, upright, point, LEAST_SIGMA_PX)
                part = f"{SIDES['beam'][index // size]} {side}"
                yield self.feature(item, part, point, covariance, None, score)

    def parts_of(self, panorama: Panorama, shown: MeasuredMembers, parts: int) -> Iterator[Feature]:
        """A point in the middle of each part of an edge that was measured; edges may lean or be bent."""
        edges, count = replace(shown.members.edges, lines=shown.lines), len(shown.members.objects)
        for lines, middle, seen in _followed(panorama, self.spec, edges, parts):
            across, covariances = _line_ends(lines, middle[:, None])
            pixels = np.stack([middle, across[:, 0]], axis=-1)
            if edges.stands:
                pixels, covariances = pixels[:, ::-1], covariances[..., ::-1, ::-1]
            for index in np.flatnonzero(seen).tolist():
                part = f"{SIDES[shown.members.label][index // count]} part"
                yield self.feature(
                    shown.members.objects[index % count], part, pixels[index][None], covariances[index], None, 0.0
                )


def _followed(panorama: Panorama, spec: ViewSpec, edges: Edges, parts: int) -> Iterator[tuple[Lines, Floats, Bools]]:
    """Each part of edges, outwards from the middle, where the part before it leads to."""
    size = (edges.last - edges.first) / parts
    for step in (range(parts // 2 - 1, -1, -1), range(parts // 2, parts)):
        lines = edges.lines
        for number in step:
            first = edges.first + number * size
            part = replace(edges, lines=lines, first=first, last=first + size, wanted=size >= LEAST_PART_PX)
            ((lines, seen),) = measured(panorama, spec, [part], OUTLINED)
            yield lines, part.middle, seen


def _line_ends(lines: Lines, u: Floats) -> tuple[Floats, Floats]:
    """v (n, k) of lines at `u` (n, k), and the covariance (n, k, 2, 2) px^2 of (u, v) there: long along the line."""
    column = lines.column
    along = np.concatenate([np.ones_like(column.slope), column.slope], axis=1)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    across = np.stack([-along[:, 1], along[:, 0]], axis=-1)
    variance = np.maximum(column.variance_at(u) * along[:, :1] ** 2, LEAST_SIGMA_PX**2)
    stretch = ALONG_SIGMA_PX**2 * along[:, :, None] * along[:, None, :]
    squeeze = across[:, :, None] * across[:, None, :]
    return column.at(u), stretch[:, None] + variance[..., None, None] * squeeze[:, None]
