"""Simulated masks' edges of racks, and their features as boundary detection would give them from pictures: for tests
without pixels.

What is not in a picture is not redone here: masks become strips, and from there on the rules and the intersections are
those of `boundaries/`.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from savmap.geometry.lines import Lines
from savmap.geometry.pinhole import project
from savmap.lab.scenes import validated
from savmap.lab.sim.drive.cart import Drive
from savmap.lab.sim.drive.optics import Optics
from savmap.lab.sim.observations import MaskErrors, ObservedEdge, Side, Strip, edge_offsets, observe_strips
from savmap.lab.sim.scene.build import Built
from savmap.types import Bools, Feature, Floats, Ints, View, ViewSpec
from savmap_shelves.boundaries.features import (
    Extraction,
    Separators,
    beam_features,
    sorted_beams,
    sorted_separators,
    upright_edges,
)
from savmap_shelves.boundaries.measuring import LYING_PARTS, STANDING_PARTS
from savmap_shelves.boundaries.settings import BoundarySettings
from savmap_shelves.boundaries.strips import Strips
from savmap_shelves.lab.rack import Curve, Rack, beam_curve, upright_curve, upright_starts

SIGMA_PX = 0.7
UPRIGHT_SIDES: tuple[Side, Side] = ("left", "right")
BEAM_SIDES: tuple[Side, Side] = ("lower", "upper")
OUTWARDS = np.array([-1.0, 1.0]), np.array([1.0, -1.0])
"""The direction in pictures, across, from the middle of a member to its edges, of uprights and of beams."""
REACH = 3.0
"""What is further ahead or behind, in distances from the face, is not measured."""


@dataclass(frozen=True)
class Truth:
    """Which structure: its `label`, and its number, or its section and level in that; both count from 0."""

    label: str
    section: int
    level: int = -1

    @property
    def object(self) -> str:
        """Its id in the map."""
        if self.label == "upright":
            return f"upright {self.section + 1}"
        return f"bay {self.section + 1} / beam {self.level + 1}"


@dataclass(frozen=True, eq=False)
class BuiltMember:
    """A member of a rack: which, where its two edges would be across it, m, if it did not bend, how it bends, and z, m,
    of its front."""

    truth: Truth
    edges: tuple[float, float]
    curve: Curve
    depth: float

    def points(self, along: Floats) -> Floats:
        """The places (2, n, 3) m on both edges that are so far (n,) m along it."""
        across = np.array(self.edges)[:, None] + self.curve.at(along)
        places = [across, np.broadcast_to(along, across.shape), np.full(across.shape, self.depth)]
        order = (0, 1, 2) if self.truth.label == "upright" else (1, 0, 2)
        return np.stack([places[k] for k in order], axis=-1)

    @property
    def strip(self) -> Strip:
        """Its edges as straight lines: those of least squares."""
        ends = np.array([self.curve.start, self.curve.start + self.curve.length])
        straight = replace(self, curve=replace(self.curve, bow=0.0)).points(ends)
        across = 0 if self.truth.label == "upright" else 1
        straight[..., across] += 2 / 3 * self.curve.bow
        sides = UPRIGHT_SIDES if self.truth.label == "upright" else BEAM_SIDES
        return Strip(self.truth.label, self.truth, sides, straight)


def members(built: Built, row: str) -> list[BuiltMember]:
    """A row's uprights, left to right, then its beams, by section from the bottom up."""
    rack = validated(Rack, built.scene.structures["shelves"]["rows"][row], "structures.shelves.rows")
    standing = [
        BuiltMember(Truth("upright", number), (x, x + rack.upright_width), upright_curve(rack, number), 0.0)
        for number, x in enumerate(upright_starts(rack))
    ]
    lying = [
        BuiltMember(
            Truth("beam", number, level),
            (y, y + (bay.beam_height or rack.beam_height)),
            beam_curve(rack, number, level),
            -rack.setback,
        )
        for number, bay in enumerate(rack.bays)
        for level, y in enumerate(bay.beams)
    ]
    return standing + lying


def strips(built: Built, row: str) -> list[Strip]:
    """The straight edges of `members`."""
    return [member.strip for member in members(built, row)]


def observe(
    built: Built,
    row: str,
    path: Drive,
    spec: ViewSpec,
    errors: MaskErrors,
    seed: int,
    optics: Optics | None = None,
) -> Iterator[list[ObservedEdge]]:
    """The edges of a row's uprights and beams in every frame of a drive; see
    `savmap.lab.sim.observations.observe_strips`."""
    return observe_strips(strips(built, row), built.frames[row], path, spec, errors, seed, optics)


def observed_parts(
    built: Built, row: str, path: Drive, spec: ViewSpec, errors: MaskErrors, seed: int, features: Sequence[Feature]
) -> Iterator[Feature]:
    """Parts of the edges of the uprights and beams that `features` show, as they are measured in panoramas: off by
    `sigma_px`, and by what `errors` says of edges, each part by itself; the picture is warped by waves about as long as
    it is wide and high."""
    instances = {(feature.frame, feature.object): feature.instance for feature in features if feature.object}
    frame, rng = built.frames[row], np.random.default_rng([seed, 1 << 21])
    covariance = np.diag([errors.sigma_px**2] * 2)[None]
    of_row = [(member.truth, places) for member in members(built, row) for places in _parts_of(member)]
    offsets = edge_offsets(len(of_row), len(path.origins), errors, rng)
    waves, phases = rng.uniform(0.5, 1.5, 2) / [spec.height, spec.width], rng.uniform(0.0, 1.0, 2)
    for index, (origin, turn) in enumerate(zip(path.origins, path.world_from_rig, strict=True)):
        view_from_row = (turn @ spec.rig_from_view).T @ frame.world_from_row
        camera = frame.to_row(origin)
        for (truth, places), off in zip(of_row, offsets[index], strict=True):
            near = abs(places[0, 0] - camera[0]) < REACH * abs(places[0, 2] - camera[2])
            instance = instances.get((index, truth.object))
            if not near or instance is None:
                continue
            axis = 0 if truth.label == "upright" else 1
            pixels = project((places - camera) @ view_from_row.T, spec.camera) + rng.normal(0, errors.sigma_px, (2, 2))
            warp = np.sqrt(2.0) * errors.warped_px * np.sin(2 * np.pi * (waves * pixels[:, ::-1] + phases))
            pixels += warp
            pixels[:, axis] += off * OUTWARDS[axis]
            for side, pixel in zip((UPRIGHT_SIDES, BEAM_SIDES)[axis], pixels, strict=True):
                if (pixel > 0).all() and (pixel < [spec.width - 1, spec.height - 1]).all():
                    name = truth.label, f"{side} part", instance
                    yield Feature(index, spec.name, *name, pixel[None], covariance, score=0.0, object=truth.object)


def _parts_of(member: BuiltMember) -> Iterator[Floats]:
    """The middle (2, 3) m, on both edges, of each part that a member's edges are measured in."""
    count = STANDING_PARTS if member.truth.label == "upright" else LYING_PARTS
    along = member.curve.start + member.curve.length * (np.arange(count) + 0.5) / count
    yield from np.swapaxes(member.points(along), 0, 1)


def observed_features(
    edges: Sequence[ObservedEdge], spec: ViewSpec, sigma_px: float = SIGMA_PX, settings: BoundarySettings | None = None
) -> list[Feature]:
    """The features of one frame, each with the object that it is of, empty for an outlier's; `sigma_px` is what an
    edge's end is taken to be off by."""
    if not edges:
        return []
    number = edges[0].frame
    settings = settings or BoundarySettings()
    frame = Extraction(_blank(spec, number), settings, settings.least_sigma_px)
    standing, lying = _strips(edges, "upright", sigma_px), _strips(edges, "beam", sigma_px)
    uprights_of, beams_of = _truths(edges, "upright"), _truths(edges, "beam")
    separators = sorted_separators(frame, standing[_longest(standing, uprights_of)], spec.height)
    strips = _in_cells(lying[_longest(lying, beams_of)], separators)
    beams = sorted_beams(frame, strips[strips.two_edged])
    objects = {
        "upright": _objects(separators.strips[separators.kept], standing, uprights_of),
        "beam": _objects(beams, lying, beams_of),
    }
    features = [*upright_edges(frame, separators), *beam_features(frame, beams, separators)]
    return [replace(feature, object=objects[feature.label][feature.instance]) for feature in features]


def _truths(edges: Sequence[ObservedEdge], label: str) -> list[str]:
    """The object of each mask of a class, in the order of `_strips`."""
    truths: Mapping[int, object] = {edge.instance: edge.truth for edge in edges if edge.label == label}
    return [truth.object if isinstance(truth, Truth) else "" for truth in truths.values()]


def _longest(strips: Strips, objects: Sequence[str]) -> Ints:
    """Numbers of the strips without duplicates: of each object's the longest, and all that are of none."""
    best: dict[str, int] = {}
    for number in np.argsort(strips.length, kind="stable").tolist():
        best[objects[number] or f"none {number}"] = number
    return np.array(sorted(best.values()), np.int64)


def _objects(kept: Strips, masks: Strips, objects: Sequence[str]) -> list[str]:
    """The objects of the strips that are left of all masks."""
    object_at = dict(zip(_middles(masks), objects, strict=True))
    return [object_at[middles] for middles in _middles(kept)]


def _middles(strips: Strips) -> list[tuple[float, float]]:
    """Where the middles of a mask's edges are, which no rule moves."""
    return list(zip(strips.upper.offset.tolist(), strips.lower.offset.tolist(), strict=True))


def _blank(spec: ViewSpec, number: int) -> View:
    picture = np.broadcast_to(np.zeros(1, dtype=np.uint8), (spec.height, spec.width, 3))
    return View(spec, number, 0.0, picture)


def _in_cells(beams: Strips, separators: Separators) -> Strips:
    """Beams in the gap between separators that their middle lies in; without those whose middle is on a separator."""
    column = (beams.first + beams.last) / 2
    row = beams.upper.at(column)[:, None]
    left, right = separators.strips.upper.at(row), separators.strips.lower.at(row)
    covered = ((column[:, None] > left) & (column[:, None] < right)).any(axis=1)
    cell: Ints = (column[:, None] > (left + right) / 2).sum(axis=1)
    inside: Bools = np.logical_not(covered)
    parts = list(vars(beams).values())
    return Strips(parts[0], parts[1], cell, *parts[3:])[inside]


def _strips(edges: Sequence[ObservedEdge], label: str, sigma_px: float) -> Strips:
    """The masks of a class as strips: u along them, v across."""
    masks: dict[int, dict[str, Floats]] = {}
    for edge in edges:
        if edge.label == label:
            masks.setdefault(edge.instance, {})[edge.side] = edge.pixels
    sides = ("left", "right") if label == "upright" else ("upper", "lower")
    ends = np.array([[mask[side] for side in sides] for mask in masks.values()]).reshape(-1, 2, 2, 2)
    ends = ends[..., ::-1] if label == "upright" else ends
    upper, lower = (_lines(ends[:, side], sigma_px) for side in (0, 1))
    first, last = np.fmin(upper.first, lower.first), np.fmax(upper.last, lower.last)
    count = np.zeros(len(ends), dtype=np.int64)
    return Strips(upper, lower, count, first, last, last - first, np.ones(len(ends)))


def _lines(ends: Floats, sigma_px: float) -> Lines:
    """Lines through pairs of points (n, 2, 2), u and v, of which each v is off by `sigma_px`."""
    middle, run = ends.mean(axis=1), ends[:, 1] - ends[:, 0]
    length = np.where(np.abs(run[:, 0]) > 1.0, run[:, 0], 1.0)
    half = np.full(len(ends), sigma_px**2 / 2)
    return Lines(
        middle[:, 0],
        run[:, 1] / length,
        middle[:, 1],
        4 * half / length**2,
        half,
        ends[:, :, 0].min(axis=1),
        ends[:, :, 0].max(axis=1),
        np.abs(length),
    )
