"""A measurement that several rows share counts once: in each row it weighs that much less."""

from collections import Counter
from collections.abc import Collection, Hashable, Iterator, Sequence
from dataclasses import replace

import gtsam
import numpy as np

from savmap.graph.constraints import Relation
from savmap.graph.factors.problem_factors import along
from savmap.graph.keys import camera_height_key, rekey
from savmap.graph.problem import Problem
from savmap.graph.references import CameraHeight

LEVEL_M = 0.01
Moments = Sequence[Sequence[Hashable]]


def shared_measurements(problems: Sequence[Problem], moments: Moments, site_wide: Collection[str]) -> list[Problem]:
    """The problems with wider sigmas for what several of them share: an equal camera height and, of the plugins whose
    structures are seen from all rows (`site_wide`), pixels of one picture and references of one name."""
    heights = Counter(height for problem in problems for height in problem.camera.references.camera_heights)
    named = Counter(name for problem in problems for name in _names(problem, site_wide) if name)
    seen = Counter(
        source
        for problem, pictures in zip(problems, moments, strict=True)
        for source in set(_sources(problem, pictures, site_wide))
        if source
    )

    def widened(problem: Problem, pictures: Sequence[Hashable]) -> Problem:
        references = problem.camera.references
        wider = tuple(replace(h, sigma_m=h.sigma_m * heights[h] ** 0.5) for h in references.camera_heights)
        names = _names(problem, site_wide)
        rows = np.array([seen[source] if source else 1 for source in _sources(problem, pictures, site_wide)])
        measurements = problem.measurements
        return replace(
            problem,
            camera=replace(problem.camera, references=replace(references, camera_heights=wider)),
            relations=tuple(
                replace(relation, sigma=relation.sigma * named[name] ** 0.5) if name else relation
                for relation, name in zip(problem.relations, names, strict=True)
            ),
            measurements=replace(measurements, covariances=measurements.covariances * rows[:, None, None]),
        )

    return [widened(problem, pictures) for problem, pictures in zip(problems, moments, strict=True)]


def _names(problem: Problem, site_wide: Collection[str]) -> list[Hashable]:
    """What identifies the user's figure of each relation; None for those of a single row."""

    def name(relation: Relation) -> Hashable:
        plugin = problem.name_of(relation.a)[0]
        return (plugin, relation.name, relation.value) if relation.name and plugin in site_wide else None

    return [name(relation) for relation in problem.relations]


def _sources(problem: Problem, moments: Sequence[Hashable], site_wide: Collection[str]) -> list[Hashable]:
    """Plugin and picture of each measurement; None for what is seen from a single row."""
    plugins = [problem.name_of(key)[0] for key in problem.measurements.keys.tolist()]
    frames = problem.measurements.frames.tolist()
    return [
        (plugin, moments[frame]) if plugin in site_wide else None for plugin, frame in zip(plugins, frames, strict=True)
    ]


def equal_camera_heights(problems: Sequence[Problem]) -> Iterator[gtsam.NonlinearFactor]:
    """One camera height given for several rows: the camera is equally high above the floors of all of them, +- 1 cm."""
    first: dict[CameraHeight, int] = {}
    for row, problem in enumerate(problems):
        for number, height in enumerate(problem.camera.references.camera_heights):
            key = rekey(camera_height_key(number), row)
            lead = first.setdefault(height, key)
            if lead != key:
                yield gtsam.BetweenFactorPoint3(lead, key, np.zeros(3), along(1, LEVEL_M))
