"""The verdict on a row's map: all that speaks against it, from every stage of its making."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from savmap.graph.solver.halves import HalfDifference
from savmap.pipeline.records import DescribedRow
from savmap.pipeline.support import Support, supports
from savmap.types import Doubt, Structure, Verdict

LEAST_SUPPORT, LEAST_OF_USUAL, LEAST_EXPECTED = 0.2, 0.35, 5
DISAGREE_SIGMA, DISAGREE_M = 4.0, 0.005
AXES = "xyz"


def judge(row: DescribedRow) -> tuple[Mapping[str, tuple[Structure, ...]], Verdict]:
    """The row's structures by plugin, each with its `support`, and the verdict."""
    found: dict[str, tuple[Structure, ...]] = {}
    doubts = [*row.measurements.doubts, *row.solution.doubts]
    for plugin in row.request.plugins:
        structures = row.structures.get(plugin.name, ())
        support = supports(structures, row.tracks.get(plugin.name, ()), row.solution.trajectory, row.measurements.facts)
        found[plugin.name] = tuple(_with_support(structure, support[structure.id]) for structure in structures)
        halves = [half for half in row.solution.halves if half.plugin == plugin.name]
        doubts += [*plugin.doubt(structures), *_weak(structures, support), *_unrepeatable(structures, halves)]
    return found, Verdict(tuple(doubts))


def _with_support(structure: Structure, support: Support) -> Structure:
    return replace(structure, attributes={**structure.attributes, "support": round(support.share, 3)})


def _weak(structures: Sequence[Structure], support: Mapping[str, Support]) -> Iterator[Doubt]:
    """A doubt about each structure that far fewer frames measured than should have, and than is usual for its label."""
    for structure in structures:
        alike = [support[other.id].share for other in structures if other.label == structure.label]
        own = support[structure.id]
        limit = min(LEAST_SUPPORT, LEAST_OF_USUAL * float(np.median(alike)))
        if own.expected >= LEAST_EXPECTED and own.share < limit:
            counts = f"{own.seen} of the {own.expected} frames that should show it"
            what = f"{structure.id} was measured in {counts}: it may not be there, or be something else"
            yield Doubt("support", what, (structure.id,), place_of(structure))


def _unrepeatable(structures: Sequence[Structure], halves: Sequence[HalfDifference]) -> Iterator[Doubt]:
    """A doubt about each structure with a corner at which odd and even frames disagree by more than its uncertainty.

    Two halves of equal weight, independent of one another, have twice the standard deviation of the whole between them at most: what they
    share does not differ.
    """
    by_name = {half.name: half.difference for half in halves}
    for structure in structures:
        worst = max(_disagreements(structure, by_name), default=(0.0, 0.0, ""))
        if worst[0] > DISAGREE_SIGMA:
            what = f"odd and even frames put {worst[2]} {100 * worst[1]:.1f} cm apart, {worst[0]:.0f} times its standard deviation"
            yield Doubt("repeatability", what, (structure.id,), place_of(structure))


def _disagreements(structure: Structure, differences: Mapping[str, np.ndarray]) -> Iterator[tuple[float, float, str]]:
    """For each corner and axis that halves differ in by more than `DISAGREE_M`: standard deviations, m, and what it is called."""
    for label, covariance in zip(structure.vertex_labels, structure.covariances, strict=True):
        if label not in differences:
            continue
        sigmas = 2 * np.sqrt(np.maximum(np.diag(covariance), 1e-12))
        for axis, apart, sigma in zip(AXES, np.abs(differences[label]), sigmas, strict=True):
            if apart > DISAGREE_M:
                yield float(apart / sigma), float(apart), f"{label} ({axis})"


def place_of(structure: Structure) -> tuple[float, float, float]:
    """A structure's middle, m."""
    x, y, z = structure.vertices.mean(axis=0).tolist()
    return x, y, z
