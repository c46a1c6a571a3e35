"""How deep flat parts lie (`savmap.vision.evidence.depth`), as relations of the plugins' landmarks, once the path is in
metres."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from savmap.graph.constraints import TIGHT_M, Constraints, Relation, fixed_coordinate
from savmap.types import FlatDepth, Trajectory

LIKELY = 3.0
"""Standard deviations within which what a plugin knows of a coordinate agrees with what was measured: beyond, something
else was."""


@dataclass(frozen=True)
class ToldDepth:
    """What flat parts told: the plugin, the coordinate of its landmark as a relation, and by how many sections;
    `likely`: whether it agrees with what the plugin knows of it."""

    plugin: str
    landmark: str
    relation: Relation
    sections: int
    likely: bool


def told_depths(
    depths: Sequence[FlatDepth], constraints: Mapping[str, Constraints], path: Trajectory
) -> Iterator[ToldDepth]:
    """The depths that flat parts told of landmarks that there still are, where the path in metres has their frames."""
    for depth in depths:
        part = constraints.get(depth.plugin)
        of_frames = np.isin(path.frames, depth.frames)
        if part is None or depth.landmark not in part.keys or not of_frames.any():
            continue
        column = ("x", "y", "z").index(depth.axis)
        value, sigma = depth.metres(float(path.world_from_rig[of_frames, column, 3].mean()))
        relation = fixed_coordinate(depth.axis, part.keys[depth.landmark], value, sigma)
        likely = all(abs(one.value - value) <= LIKELY * np.hypot(one.sigma, sigma) for one in _known(part, relation))
        yield ToldDepth(depth.plugin, depth.landmark, relation, depth.sections, likely)


def _known(part: Constraints, relation: Relation) -> Iterator[Relation]:
    """What a plugin says of a coordinate itself, or of one that it sets equal to it."""
    along = [one for one in part.relations if one.axis == relation.axis]
    equal = [set(one.keys) for one in along if one.b is not None and one.value == 0 and one.sigma <= TIGHT_M]
    group, grown = set[int](), {relation.a}
    while grown != group:
        group, grown = grown, grown.union(*(pair for pair in equal if pair & grown))
    return (one for one in along if one.b is None and one.a in group)


def with_depths(constraints: Mapping[str, Constraints], told: Sequence[ToldDepth]) -> dict[str, Constraints]:
    """The plugins' constraints with the depths that are likely."""
    new = {name: tuple(one.relation for one in told if one.plugin == name and one.likely) for name in constraints}
    return {name: replace(part, relations=(*part.relations, *new[name])) for name, part in constraints.items()}
