"""Second readings of beams' edges: where a beam is unlike the others of its picture, its edges are looked for where a beam like them has them.

What hides a beam's edge (goods that hang over it, a deck's rim, a shadow) has an edge of its own, and often a longer one. The beam's own edge still shows
between the goods. So the line where it should be is cut into short stretches, and each is measured alone. What is found stands beside the first
reading; all frames together decide between them (savmap_shelves.tracking).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from savmap.geometry.lines import Lines
from savmap.types import Bools, Floats, Ints, Panorama, ViewSpec, array_record
from savmap.vision.subpixel import Edges, Subpixel, measured
from savmap_shelves.boundaries.strips import Strips

LEAST_BEAMS, UNLIKE = 3, 0.06
"""A beam of so many is unlike the others of its picture by more than this share of their usual height."""
LEAST_AHEAD = 0.03
"""Sine of the angle between a ray and the face, or the picture, from which on it counts as going that way."""
STRETCH_PX, FEWEST, MOST = 12.0, 6, 30
"""How long stretches are, view pixels, and how many an edge has."""
WITHIN, AGREE, LEAST_WITHIN_PX = 0.06, 0.025, 0.2
"""How far an edge may be from where it should be, and stretches from their mean, as shares of the usual height and at least so many pixels."""
TILT = 0.02
LEAST_AGREEING, LEAST_SHARE = 2, 0.12
"""So many stretches agree, and so large a share of all."""
MOST_BOTH, ALL_ALONG = 0.5, 0.45
"""At most such a share of these shows the edge that was read first as well: where goods hide a beam's edge, it shows between them and theirs does not.
A line inside the first that so large a share of all stretches shows may lie beside a rim that runs all along, too."""
CLEAR, REACH_PX, COMMON_PX = 1.2, 2.0, 0.15


@dataclass(frozen=True, eq=False)
@array_record
class SecondReadings:
    """r further lines of beams' edges: the number of the beam (r,), whether it is its upper edge (r,), the line, and the share (r,) of its
    stretches that show it."""

    beam: Ints
    upper: Bools
    lines: Lines
    share: Floats


@dataclass(frozen=True, eq=False)
@array_record
class Places:
    """e edges of beams: the number of the beam (e,), whether it is the upper one (e,), the line where a beam like the others would have it, the
    line that was read first, and the usual height (e,), px."""

    beam: Ints
    upper: Bools
    like: Lines
    first: Lines
    height: Floats

    def __len__(self) -> int:
        return len(self.beam)


def places_of(beams: Strips, rays: "Rays") -> Places | None:
    """The edges of beams unlike the others of a picture; None where there are none."""
    if len(beams) < LEAST_BEAMS:
        return None
    ends = np.stack([beams.first, beams.last], axis=-1)
    upper, lower = (rays.on_face(ends, lines.column.at(ends)) for lines in (beams.upper, beams.lower))
    heights = (lower - upper)[..., 1].mean(axis=1)
    ahead = np.isfinite(heights)
    if np.count_nonzero(ahead) < LEAST_BEAMS:
        return None
    usual = float(np.median(heights[ahead]))
    down = np.array([0.0, usual])
    above, below = rays.pixels(lower - down), rays.pixels(upper + down)
    ahead &= np.isfinite(above).all(axis=(1, 2)) & np.isfinite(below).all(axis=(1, 2))
    odd = np.flatnonzero(ahead & (np.abs(heights - usual) > UNLIKE * usual))
    if not len(odd) or usual <= 0:
        return None
    both = np.concatenate([odd, odd])
    like = _through(np.concatenate([above[odd], below[odd]]))
    first = beams.upper[odd].joined(beams.lower[odd])
    middle = (beams.first[both] + beams.last[both]) / 2
    opposite = beams.lower[odd].joined(beams.upper[odd])
    return Places(both, np.arange(len(both)) < len(odd), like, first, np.abs(opposite.at(middle) - like.at(middle)))


@dataclass(frozen=True, eq=False)
class Rays:
    """From pixels of a view to the plane before the face at distance 1, and back; `axes` (3, 3): the face's, as columns."""

    spec: ViewSpec
    axes: Floats

    def on_face(self, x: Floats, y: Floats) -> Floats:
        """Coordinates (..., 2), right and down, of pixels; nan where they look along the face, or away from it."""
        camera = self.spec.camera
        rays = np.stack(
            [(x - camera[0, 2]) / camera[0, 0], (y - camera[1, 2]) / camera[1, 1], np.ones_like(x)], axis=-1
        )
        ahead = rays @ self.axes
        return _at_distance_1(ahead)

    def pixels(self, points: Floats) -> Floats:
        """Pixels (..., 2) of coordinates (..., 2); nan where they lie beside the camera, or behind it."""
        camera = self.spec.camera
        rays = np.concatenate([points, np.ones_like(points[..., :1])], axis=-1) @ self.axes.T
        ahead = _at_distance_1(rays)
        return np.asarray(ahead * [camera[0, 0], camera[1, 1]] + camera[:2, 2])


def _at_distance_1(rays: Floats) -> Floats:
    """Where rays (..., 3) meet the plane z = 1 (..., 2); nan where they go along it, or away from it."""
    z = rays[..., 2:]
    long = np.linalg.norm(rays, axis=-1, keepdims=True)
    return np.asarray(rays[..., :2] / np.where(z > LEAST_AHEAD * long, z, np.nan))


def _through(ends: Floats) -> Lines:
    """Lines through pairs of points (e, 2, 2)."""
    centre, offset = ends.mean(axis=1).T
    run = ends[:, 1] - ends[:, 0]
    none = np.zeros(len(ends))
    return Lines(centre, run[:, 1] / run[:, 0], offset, none, none, ends[:, 0, 0], ends[:, 1, 0], none)


def second_readings(panorama: Panorama, spec: ViewSpec, beams: Strips, axes: Floats) -> SecondReadings | None:
    """Second readings of the edges of beams that are unlike the others of their picture; None where there are none."""
    places = places_of(beams, Rays(spec, axes))
    if places is None:
        return None
    stretches = Stretches.of(places, beams)
    like = measured(panorama, spec, [stretches.edges(places.like, places.height)], _settings(places, WITHIN, CLEAR))[0]
    found = [*_agreeing(places, stretches, like)]
    if not found:
        return None
    kept = [one for one in found if one.inner and one.share >= ALL_ALONG]
    unsure = [one for one in found if not (one.inner and one.share >= ALL_ALONG)]
    if unsure:
        asked = np.isin(np.arange(len(stretches.edge)), np.concatenate([one.stretches for one in unsure]))
        edges = replace(stretches.edges(places.first, places.height), wanted=asked)
        first = measured(panorama, spec, [edges], _settings(places, AGREE, 1.0))[0]
        off = np.abs(first[0].at(stretches.middle) - places.first[stretches.edge].at(stretches.middle))
        shown = first[1] & (off < np.maximum(AGREE * places.height[stretches.edge], LEAST_WITHIN_PX))
        kept += [one for one in unsure if shown[one.stretches].mean() <= MOST_BOTH]
    return _joined(places, kept) if kept else None


def _settings(places: Places, within: float, clear: float) -> Subpixel:
    """How stretches are measured, near their place by a share of the usual height."""
    height = float(np.median(places.height))
    return Subpixel(prior_px=max(within * height, LEAST_WITHIN_PX), reach_px=REACH_PX, end_trim_px=0.0, clear=clear)


@dataclass(frozen=True, eq=False)
class Agreement:
    """What stretches agree on: the number of the place, which stretches (n,), the share of the place's, the line, and whether it lies inside of the
    line that was read first."""

    place: int
    stretches: Ints
    share: float
    line: Lines
    inner: bool


def _joined(places: Places, kept: Sequence[Agreement]) -> SecondReadings:
    number = np.array([one.place for one in kept])
    lines = Lines(*(np.concatenate(values) for values in zip(*(vars(one.line).values() for one in kept), strict=True)))
    return SecondReadings(places.beam[number], places.upper[number], lines, np.array([one.share for one in kept]))


@dataclass(frozen=True, eq=False)
@array_record
class Stretches:
    """s stretches of edges: the number of the edge (s,), first and last u (s,); +1 for upper edges, -1 for lower ones (s,)."""

    edge: Ints
    first: Floats
    last: Floats
    inside: Floats

    @classmethod
    def of(cls, places: Places, beams: Strips) -> "Stretches":
        """The stretches of the edges of some beams."""
        first, last = beams.first[places.beam], beams.last[places.beam]
        count = np.clip((last - first) / STRETCH_PX, FEWEST, MOST).astype(np.int64)
        edge = np.repeat(np.arange(len(places)), count)
        number = np.arange(len(edge)) - np.repeat(np.cumsum(count) - count, count)
        long = ((last - first) / count)[edge]
        return cls(
            edge,
            first[edge] + number * long,
            first[edge] + (number + 1) * long,
            np.where(places.upper, 1.0, -1.0)[edge],
        )

    @property
    def middle(self) -> Floats:
        """u (s,) half way."""
        return (self.first + self.last) / 2

    def edges(self, lines: Lines, thickness: Floats) -> Edges:
        """The stretches along lines (e,)."""
        none = np.zeros(len(self.edge))
        return Edges(lines[self.edge], self.first, self.last, self.inside, thickness[self.edge], none, False)


def _agreeing(places: Places, stretches: Stretches, like: tuple[Lines, Bools]) -> Iterator[Agreement]:
    """What stretches show near their places: the offset that most agree on, where enough do."""
    middle, own = stretches.middle, places.like[stretches.edge]
    off, told = like[0].at(middle) - own.at(middle), like[1] & (np.abs(like[0].slope - own.slope) < TILT)
    for number in range(len(places)):
        mine, height = np.flatnonzero(stretches.edge == number), float(places.height[number])
        near = mine[told[mine] & (np.abs(off[mine]) < max(WITHIN * height, LEAST_WITHIN_PX))]
        if len(near) < LEAST_AGREEING:
            continue
        alike = np.abs(off[near][:, None] - off[near]) < max(AGREE * height, LEAST_WITHIN_PX)
        same = near[alike[alike.sum(axis=1).argmax()]]
        if len(same) < max(LEAST_AGREEING, LEAST_SHARE * len(mine)):
            continue
        weight = 1 / like[0].offset_var[same]
        mean = float(np.average(off[same], weights=weight))
        variance = float(np.average(np.square(off[same] - mean), weights=weight)) / (len(same) - 1) + COMMON_PX**2
        line = places.like[np.array([number])]
        line = replace(line, offset=line.offset + mean, offset_var=np.array([variance]))
        inwards = float((line.offset - places.first.at(line.centre[0])[number])[0]) * (
            1 if places.upper[number] else -1
        )
        yield Agreement(number, same, len(same) / len(mine), line, inwards > 0)
