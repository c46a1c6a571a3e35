"""Problems with their references softened, widened or left out."""

from collections.abc import Iterable, Mapping
from dataclasses import replace

from savmap.graph.problem import Problem

SOFT_M, SOFT_PART = 0.1, 0.02
"""Far more than pictures leave open of a row's shape, and little enough to keep its scale and place near what is given."""
AWAY = 3.0


def softened(problem: Problem, misfits: Mapping[str, float]) -> Problem:
    """The problem with references that give scale and place, but no more. `misfits`: by how much each is off a first fit to all, m."""
    sizes = {one.name: SOFT_M for one in problem.camera.references.camera_heights}
    for one in problem.relations:
        if one.name:
            sizes[one.name] = SOFT_M if one.b is None else SOFT_PART * abs(one.value)
    return with_sigmas(problem, {name: max(size, AWAY * misfits.get(name, 0.0)) for name, size in sizes.items()})


def with_sigmas(problem: Problem, at_least: Mapping[str, float]) -> Problem:
    """The problem with references whose standard deviations, m, are no smaller than these by name."""
    references = problem.camera.references
    heights = tuple(
        replace(one, sigma_m=max(one.sigma_m, at_least.get(one.name, 0.0))) for one in references.camera_heights
    )
    relations = tuple(
        replace(one, sigma=max(one.sigma, at_least.get(one.name, 0.0))) if one.name else one
        for one in problem.relations
    )
    camera = replace(problem.camera, references=replace(references, camera_heights=heights))
    return replace(problem, camera=camera, relations=relations)


def without(problem: Problem, out: Iterable[str]) -> Problem:
    """The problem without some references, by name."""
    names, references = set(out), problem.camera.references
    heights = tuple(one for one in references.camera_heights if one.name not in names)
    relations = tuple(one for one in problem.relations if not one.name or one.name not in names)
    camera = replace(problem.camera, references=replace(references, camera_heights=heights))
    return replace(problem, camera=camera, relations=relations)
