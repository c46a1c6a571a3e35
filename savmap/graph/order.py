"""In which order variables are eliminated: as one passes them along the aisle, so that only neighbours meet.

What is seen from one place is a band then, and costs about half of what a minimum degree order (GTSAM's COLAMD) does on a long row.
Variables that those of the whole row are bound to, such as the beam that all others share a plane with, come last.
"""

from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence

import gtsam
import numpy as np

from savmap.graph.carry import carried_key
from savmap.graph.constraints import each
from savmap.graph.keys import ORIGIN, centre_key, frame_key, mast_key
from savmap.graph.problem import Problem
from savmap.graph.start import Estimate

MANY = 30
Place = tuple[float, int]


def along_aisle(problem: Problem, estimate: Estimate) -> gtsam.Ordering:
    """The variables of one row."""
    return ordered(places(problem, estimate, gtsam.Pose3(), 0), hubs(problem, 0))


def ordered(places: Sequence[Place], last: Sequence[int]) -> gtsam.Ordering:
    """Variables by their place, but for those that come last."""
    ordering, late = gtsam.Ordering(), set(last)
    for key in (*(key for _, key in sorted(places) if key not in late), *last):
        ordering.push_back(key)
    return ordering


def places(problem: Problem, estimate: Estimate, aisle_from_row: gtsam.Pose3, row: int) -> list[Place]:
    """Where along the aisle frames and points of a row are, m, with their carried keys."""
    cameras = aisle_from_row.transformFrom(estimate.poses[:, :3, 3].T)[0].tolist()
    points = aisle_from_row.transformFrom(estimate.points.T)[0].tolist()
    frames = list(zip(cameras, problem.used.tolist(), strict=True))
    keys = [
        *((x, key) for x, frame in frames for key in (frame_key(frame), centre_key(frame))),
        *zip(points, problem.keys.tolist(), strict=True),
    ]
    own = _own_places(problem, {key: x for x, key in keys})
    return [(x, carried_key(key, row)) for x, key in (*keys, *own)]


def _own_places(problem: Problem, x: Mapping[int, float]) -> Iterator[Place]:
    """Variables of the plugins' own: in the middle of what their factors bind them to."""
    near = defaultdict[int, list[float]](list)
    for room in problem.rooms:
        for factor in each(room.factors) if room.own else ():
            keys = factor.keys()
            for key in (key for key in keys if key in room.own):
                near[key] += [x[other] for other in keys if other in x]
    for room in problem.rooms:
        yield from ((float(np.mean(near[key] or [0.0])), key) for key in room.own)


def hubs(problem: Problem, row: int) -> list[int]:
    """Carried keys of what binds many variables of a row."""
    return [carried_key(key, row) for key in _hubs(problem)]


def _hubs(problem: Problem) -> Iterator[int]:
    bound = Counter(key for relation in problem.relations for key in (relation.a, relation.b) if key is not None)
    yield from (key for key, count in bound.items() if count > MANY)
    if problem.frames.fixed is None:
        yield from (mast_key(number) for number in range(len(problem.frames.references.camera_heights)))
    yield ORIGIN
