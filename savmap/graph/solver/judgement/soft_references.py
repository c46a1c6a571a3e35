"""Problems with their references softened, widened or left out."""

from collections.abc import Iterable, Mapping
from dataclasses import replace

from savmap.graph.initial.observability import extent
from savmap.graph.problem import Problem
from savmap.types import Floats

SOFT_M, SOFT_PART = 0.1, 0.02
"""Far more than pictures leave open of a row's shape, and little enough to keep its scale and place near what is given.
"""
AWAY = 3.0
HELD_PART = 1e-3
"""How firmly a scene with soft references keeps its scale: no error of what is known in metres bends it by as much."""


def holding_scale(problem: Problem, cameras: Floats, points: Floats) -> Problem:
    """The problem with the extent of a scene, cameras (f, 3) and points (m, 3), held.

    Soft references hold the scale so loosely that outliers shrink the scene: what is straight to a millimetre hinders
    them less, the smaller it is. Of how references agree a scale that is held says nothing. Where the camera's path is
    given, the scene has its scale.
    """
    if problem.camera.fixed is not None:
        return problem
    return replace(problem, relations=(*problem.relations, *extent(problem, cameras, points, HELD_PART)))


def softened(problem: Problem, misfits: Mapping[str, float]) -> Problem:
    """The problem with references that give scale and place, but no more. `misfits`: by how much each is off a first
    fit to all, m."""
    sizes = {item.name: SOFT_M for item in problem.camera.references.camera_heights}
    for item in problem.relations:
        if item.name:
            sizes[item.name] = SOFT_M if item.b is None else SOFT_PART * abs(item.value)
    return with_sigmas(problem, {name: max(size, AWAY * misfits.get(name, 0.0)) for name, size in sizes.items()})


def with_sigmas(problem: Problem, at_least: Mapping[str, float]) -> Problem:
    """The problem with references whose standard deviations, m, are no smaller than these by name."""
    references = problem.camera.references
    heights = tuple(
        replace(item, sigma_m=max(item.sigma_m, at_least.get(item.name, 0.0))) for item in references.camera_heights
    )
    relations = tuple(
        replace(item, sigma=max(item.sigma, at_least.get(item.name, 0.0))) if item.name else item
        for item in problem.relations
    )
    camera = replace(problem.camera, references=replace(references, camera_heights=heights))
    return replace(problem, camera=camera, relations=relations)


def without(problem: Problem, out: Iterable[str]) -> Problem:
    """The problem without some references, by name."""
    names, references = set(out), problem.camera.references
    heights = tuple(item for item in references.camera_heights if item.name not in names)
    relations = tuple(item for item in problem.relations if not item.name or item.name not in names)
    camera = replace(problem.camera, references=replace(references, camera_heights=heights))
    return replace(problem, camera=camera, relations=relations)
