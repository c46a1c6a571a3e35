"""Simulated masks' edges of racks, and their features as if they had been measured in pictures: for tests without
pixels.

What is not in a picture is not redone here: from lines on, features are those of `edges`.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from savmap.geometry.lines import Lines
from savmap.geometry.pinhole import project
from savmap.lab.scenes import validated
from savmap.lab.sim.drive.cart import Drive
from savmap.lab.sim.observations import MaskErrors, ObservedEdge, Side, Strip, edge_offsets, observe_strips
from savmap.lab.sim.scene.build import Built
from savmap.types import Feature, Floats, FoundObject, ViewSpec
from savmap.vision.subpixel import Edges
from savmap_shelves.edges import LYING_PARTS, SIDES, STANDING_PARTS, MeasuredMembers, Members, ViewFeatures
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
) -> Iterator[list[ObservedEdge]]:
    """The edges of a row's uprights and beams in every frame of a drive; see
    `savmap.lab.sim.observations.observe_strips`."""
    return observe_strips(strips(built, row), built.frames[row], path, spec, errors, seed)


def observed_parts(
    built: Built, row: str, path: Drive, spec: ViewSpec, errors: MaskErrors, seed: int, features: Sequence[Feature]
) -> Iterator[Feature]:
    """Parts of the edges of the uprights and beams that `features` show, as they are measured in panoramas: off by
    `sigma_px`, and by what `errors` says of edges, each part by itself; the picture is warped by waves about as long as
    it is wide and high."""
    shown = {(feature.frame, feature.object) for feature in features}
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
            if not near or (index, truth.object) not in shown:
                continue
            axis = 0 if truth.label == "upright" else 1
            pixels = project((places - camera) @ view_from_row.T, spec.camera) + rng.normal(0, errors.sigma_px, (2, 2))
            warp = np.sqrt(2.0) * errors.warped_px * np.sin(2 * np.pi * (waves * pixels[:, ::-1] + phases))
            pixels += warp
            pixels[:, axis] += off * OUTWARDS[axis]
            for side, pixel in zip((UPRIGHT_SIDES, BEAM_SIDES)[axis], pixels, strict=True):
                if (pixel > 0).all() and (pixel < [spec.width - 1, spec.height - 1]).all():
                    name = truth.label, f"{side} part", 0
                    yield Feature(index, spec.name, *name, pixel[None], covariance, score=0.0, object=truth.object)


def _parts_of(member: BuiltMember) -> Iterator[Floats]:
    """The middle (2, 3) m, on both edges, of each part that a member's edges are measured in."""
    count = STANDING_PARTS if member.truth.label == "upright" else LYING_PARTS
    along = member.curve.start + member.curve.length * (np.arange(count) + 0.5) / count
    yield from np.swapaxes(member.points(along), 0, 1)


def observed_features(edges: Sequence[ObservedEdge], spec: ViewSpec, sigma_px: float = SIGMA_PX) -> list[Feature]:
    """The features of one frame; `sigma_px` is what an edge's end is taken to be off by. Masks of nothing have no
    object, and of an object's the longest counts."""
    if not edges:
        return []
    view = ViewFeatures(spec, edges[0].frame)
    uprights, beams = (_measured(edges, label, sigma_px) for label in SIDES)
    return [*view.edges_of(uprights), *view.edges_of(beams), *view.corners(uprights, beams)]


def _measured(edges: Sequence[ObservedEdge], label: str, sigma_px: float) -> MeasuredMembers:
    """The members of a class that a frame's masks are of, as if they were measured."""
    masks: dict[int, dict[str, ObservedEdge]] = {}
    for edge in edges:
        if edge.label == label and isinstance(edge.truth, Truth):
            masks.setdefault(edge.instance, {})[edge.side] = edge
    stands = label == "upright"
    sides = [[mask[side].pixels for side in SIDES[label]] for mask in masks.values()]
    ends = np.array(sides).reshape(-1, 2, 2, 2)[..., :: -1 if stands else 1]
    objects = [truth.object for mask in masks.values() if isinstance(truth := next(iter(mask.values())).truth, Truth)]
    longest: dict[str, int] = {}
    for number in np.argsort(np.abs(np.diff(ends[:, 0, :, 0])).sum(axis=1), kind="stable").tolist():
        longest[objects[number]] = number
    chosen = ends[sorted(longest.values())]
    lines = _lines(np.concatenate([chosen[:, 0], chosen[:, 1]]), sigma_px)
    nothing = np.zeros(len(lines))
    spans = Edges(lines, lines.first, lines.last, nothing, nothing, nothing, stands)
    shown = [FoundObject(objects[number], label, np.zeros((4, 3)), 1.0) for number in sorted(longest.values())]
    none = np.zeros(len(lines), np.bool_)
    return MeasuredMembers(Members(shown, spans, np.ones(len(shown)), none, none), lines, ~none, none)


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
