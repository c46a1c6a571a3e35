"""One measurement counts once, however many rows tell of it: each row's share of it weighs that much less."""

from collections import Counter
from collections.abc import Collection, Hashable, Iterator, Sequence
from dataclasses import replace

import gtsam
import numpy as np

from savmap.graph.carry import carried_key
from savmap.graph.constraints import Relation
from savmap.graph.factors import along
from savmap.graph.keys import mast_key
from savmap.graph.problem import Problem
from savmap.graph.references import CameraHeight

LEVEL_M = 0.01
Moments = Sequence[Sequence[Hashable]]


def counted_once(problems: Sequence[Problem], moments: Moments, everywhere: Collection[str]) -> list[Problem]:
    """The problems with wider sigmas where several tell of the same: a camera height that was given alike, and, of the rooms
    whose things are seen from `everywhere`, pixels of one moment and references of one name."""
    heights = Counter(height for problem in problems for height in problem.frames.references.camera_heights)
    named = Counter(name for problem in problems for name in _names(problem, everywhere) if name)
    seen = Counter(
        sight
        for problem, own in zip(problems, moments, strict=True)
        for sight in set(_sights(problem, own, everywhere))
        if sight
    )

    def shared(problem: Problem, own: Sequence[Hashable]) -> Problem:
        references = problem.frames.references
        wider = tuple(replace(h, sigma_m=h.sigma_m * heights[h] ** 0.5) for h in references.camera_heights)
        names = _names(problem, everywhere)
        rows = np.array([seen[sight] if sight else 1 for sight in _sights(problem, own, everywhere)])
        observations = problem.observations
        return replace(
            problem,
            frames=replace(problem.frames, references=replace(references, camera_heights=wider)),
            relations=tuple(
                replace(relation, sigma=relation.sigma * named[name] ** 0.5) if name else relation
                for relation, name in zip(problem.relations, names, strict=True)
            ),
            observations=replace(observations, covariances=observations.covariances * rows[:, None, None]),
        )

    return [shared(problem, own) for problem, own in zip(problems, moments, strict=True)]


def _names(problem: Problem, everywhere: Collection[str]) -> list[Hashable]:
    """What makes each relation that of one measured figure; None for those of a single row."""

    def name(relation: Relation) -> Hashable:
        room = problem.name_of(relation.a)[0]
        return (room, relation.name, relation.value) if relation.name and room in everywhere else None

    return [name(relation) for relation in problem.relations]


def _sights(problem: Problem, moments: Sequence[Hashable], everywhere: Collection[str]) -> list[Hashable]:
    """Room and moment of each observation; None for what is seen from a single row."""
    rooms = [problem.name_of(key)[0] for key in problem.observations.keys.tolist()]
    frames = problem.observations.frames.tolist()
    return [(room, moments[frame]) if room in everywhere else None for room, frame in zip(rooms, frames, strict=True)]


def level_floor(problems: Sequence[Problem]) -> Iterator[gtsam.NonlinearFactor]:
    """One camera height given for several rows: the camera is as high above one's floor as above the other's, +- 1 cm."""
    first: dict[CameraHeight, int] = {}
    for row, problem in enumerate(problems):
        for number, height in enumerate(problem.frames.references.camera_heights):
            mast = carried_key(mast_key(number), row)
            lead = first.setdefault(height, mast)
            if lead != mast:
                yield gtsam.BetweenFactorPoint3(lead, mast, np.zeros(3), along(1, LEVEL_M))
