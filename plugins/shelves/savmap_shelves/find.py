"""Uprights and beams that the evidence of all frames shows, as objects to be measured in the pictures."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from itertools import pairwise

import numpy as np

from savmap.errors import StructureError
from savmap.types import FoundObject, PlaneEvidence, PlanePatch, RowFacts, Trajectory
from savmap.vision.evidence.planes import upright_patch
from savmap_shelves.evidence import tracked_grid
from savmap_shelves.face_model import Face, FaceReader, Member
from savmap_shelves.likelihood import fitted

CELL = 0.0125
"""The side of a cell, as a share of the camera's distance."""
POST_SEEN = 0.5
"""Of a post's height, where the camera sees in part: what it did not look at is no post."""
LIKELY = 0.5
"""Members that are more likely than this are numbered and mapped."""


def find(
    gather: Callable[[PlanePatch], PlaneEvidence],
    path: Trajectory,
    points: Mapping[str, np.ndarray],
    facts: RowFacts,
    floor: float | None,
) -> list[FoundObject]:
    """Uprights "upright 1" ... and beams "bay 1 / beam 1" ..., and what may exist beside them. Raises StructureError
    where no bay shows."""
    reader = face_reader(gather, path, points, facts, floor)
    face = reader.read()
    if face is None:
        raise StructureError(f"row {facts.name}: fewer than two uprights show in all frames together, so no bay does")
    if not any(face.sections):
        raise StructureError(f"row {facts.name}: {len(face.posts)} uprights but no beam between them were found")
    return [*_objects(face, reader.uprights.patch, beam_depth(points))]


def face_reader(
    gather: Callable[[PlanePatch], PlaneEvidence],
    path: Trajectory,
    points: Mapping[str, np.ndarray],
    facts: RowFacts,
    floor: float | None,
) -> FaceReader:
    """The reader of the face that a path goes past; arguments are those of `find`."""
    places = path.world_from_rig[:, :3, 3]
    distance = float(np.median(places[:, 2]))
    patch = upright_patch(path, facts, CELL)
    uprights, depth = gather(patch), beam_depth(points)
    beams = gather(replace(patch, origin=patch.origin + np.array([0.0, 0.0, depth]))) if depth else uprights
    below = None if floor is None else floor - float(patch.origin[1])
    grid = tracked_grid(points)
    sizes = (grid.width, grid.thickness) if grid else (None, None)
    return FaceReader(uprights, beams, distance, below, fitted(), sizes, POST_SEEN if facts.sees_in_part else 0.0)


def beam_depth(points: Mapping[str, np.ndarray]) -> float:
    """Where the beams' plane is, z, by the points that were solved; the uprights' plane without any."""
    depths = [float(point[2]) for name, point in points.items() if " / beam " in name]
    return float(np.median(depths)) if depths else 0.0


def _objects(face: Face, patch: PlanePatch, depth: float) -> Iterator[FoundObject]:
    for number, post in enumerate(face.posts, 1):
        yield _object(
            f"upright {number}", "upright", (post.low, post.high), (face.bottom, face.top), patch, 0.0, post.probability
        )
    bays = zip(pairwise(face.posts), face.sections, face.possible, strict=True)
    for bay, ((left, right), beams, possible) in enumerate(bays, 1):
        mapped = [beam for beam in beams if beam.probability >= LIKELY]
        names = [f"bay {bay} / beam {number}" for number in range(1, len(mapped) + 1)]
        others = [beam for beam in (*beams, *possible) if beam.probability < LIKELY]
        places = [_where(beam, mapped) for beam in others]
        names += [f"bay {bay} / {place}, {places[: k + 1].count(place)}" for k, place in enumerate(places)]
        for name, beam in zip(names, (*mapped, *others), strict=True):
            yield _object(name, "beam", (left.high, right.low), (beam.low, beam.high), patch, depth, beam.probability)


def _where(beam: Member, mapped: list[Member]) -> str:
    """Where a beam that is not mapped would be among those of its bay."""
    below = sum(other.low < beam.low for other in mapped)
    return f"above beam {below}" if below else "below beam 1"


def _object(
    name: str,
    label: str,
    x: tuple[float, float],
    y: tuple[float, float],
    patch: PlanePatch,
    depth: float,
    probability: float,
) -> FoundObject:
    corners = np.array([[x[0], y[0], depth], [x[1], y[0], depth], [x[1], y[1], depth], [x[0], y[1], depth]])
    return FoundObject(name, label, corners + np.array([patch.origin[0], patch.origin[1], 0.0]), probability)
