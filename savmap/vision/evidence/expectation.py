"""What a plugin expects by the evidence of all frames, against what was tracked: what is missing, and what is not there."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from savmap.types import Expected, Floats, MapWarning, PlanePatch, Trajectory, ViewSpec
from savmap.vision.evidence.behind import inner_part, lies_behind
from savmap.vision.evidence.planes import PackedView

LEAST_LANDMARKS = 2
BEYOND = 0.1
"""By so large a share of their extent may landmarks differ from look to look: the path's scale is an assumed one."""


@dataclass(frozen=True, eq=False)
class Expectation:
    """The objects that a plugin expects, those that are absent too, and the path of the camera, both in the unit of that path; the first positions (3,) of the
    landmarks that were tracked instead, and the planes that the objects lie in."""

    objects: Sequence[Expected]
    path: Trajectory
    points: Mapping[str, Floats] = field(default_factory=dict)
    planes: Sequence[PlanePatch] = ()

    @property
    def there(self) -> list[Expected]:
        """The objects without those that are absent."""
        return [thing for thing in self.objects if not thing.absent]

    @property
    def amiss(self) -> int:
        """How many objects were not tracked though they are there, or tracked though they are absent."""
        return sum(1 for _ in self.untracked()) + len(self.objects) - len(self.there)

    def untracked(self) -> Iterator[tuple[Expected, MapWarning]]:
        """Each object at whose outline nothing was tracked, and a warning about it."""
        for thing in self.there if self.points else ():
            if len(self._tracked_at(thing)) < LEAST_LANDMARKS:
                yield thing, MapWarning("uncertain-element", (f"{thing.label} near {self._nearest(thing)}",))

    def unseen(self) -> Iterator[MapWarning]:
        """A warning about each object that is absent, and was tracked all the same."""
        for thing in self.objects:
            names = self._tracked_at(thing) if thing.absent else []
            if len(names) >= LEAST_LANDMARKS:
                yield MapWarning("uncertain-element", (max(names, key=names.count),))

    def reaches_beyond(self, points: Mapping[str, Floats]) -> bool:
        """Whether an object that is there and was tracked lies beyond landmarks (3,) that are tracked later, by more than `BEYOND` of their extent."""
        if not points:
            return False
        places = np.array([*points.values()])
        low, high = places.min(axis=0), places.max(axis=0)
        room = BEYOND * float((high - low).max())
        return any(
            bool((thing.outline.min(axis=0) > high + room).any() or (thing.outline.max(axis=0) < low - room).any())
            for thing in self.there
            if len(self._tracked_at(thing)) >= LEAST_LANDMARKS
        )

    def _tracked_at(self, thing: Expected) -> list[str]:
        """The structure of each landmark that was tracked at an object's outline."""
        low, high = thing.outline.min(axis=0), thing.outline.max(axis=0)
        room = np.sort(high - low)[1] / 2
        return [
            structure_of(name)
            for name, place in self.points.items()
            if (place > low - room).all() and (place < high + room).all()
        ]

    def _nearest(self, thing: Expected) -> str:
        """The structure of the landmark that is nearest to the middle of an object."""
        middle = (thing.outline.min(axis=0) + thing.outline.max(axis=0)) / 2
        return structure_of(min(self.points, key=lambda name: float(np.linalg.norm(self.points[name] - middle))))


def structure_of(landmark: str) -> str:
    """What a landmark's name says it is of."""
    return landmark.rsplit(" / ", 1)[0]


def unexplained(
    left: Expectation, packed_views: Sequence[PackedView], views: Mapping[str, ViewSpec]
) -> Iterator[MapWarning]:
    """A warning about each object at whose outline nothing was tracked, but for what only shows through an opening of its plane: the rear of a
    structure is level, too, and goes on in the evidence of its front. What stands above or below it in the same opening is behind it as well
    where most does and nothing in it was tracked. Of what stands across the camera's way no picture tells that; where all that meets it lies
    behind, so does it."""
    behind: set[int] = set()
    across, along = list[tuple[Expected, MapWarning]](), list[tuple[Expected, MapWarning]]()
    for thing, warning in left.untracked():
        part = inner_part(thing.outline, left.planes)
        (across if part is None else along).append((thing, warning))
        if part is not None and lies_behind(part, packed_views, views, left.path):
            behind.add(id(thing))
    missing = {id(thing) for thing, _ in along}
    for thing, warning in along:
        others = [id(other) for other in left.there if other is not thing and is_over(thing, other)]
        through = missing.issuperset(others) and 2 * sum(other in behind for other in others) > len(others) + 1
        if id(thing) not in behind and not through:
            yield warning
    for thing, warning in across:
        met = [other for other in left.objects if other is not thing and meets(thing, other)]
        if not met or any(id(other) not in behind for other in met):
            yield warning


def is_over(one: Expected, other: Expected) -> bool:
    """Whether an object is above or below another, as long: their outlines' longest extents are the same to a tenth."""
    (low, high), (first, last) = ((thing.outline.min(axis=0), thing.outline.max(axis=0)) for thing in (one, other))
    axis, room = int((high - low).argmax()), 0.1 * float((high - low).max())
    return bool(abs(low[axis] - first[axis]) < room and abs(high[axis] - last[axis]) < room)


def meets(one: Expected, other: Expected) -> bool:
    """Whether two objects' outlines touch, to half of the lesser thickness of either."""
    (low, high), (first, last) = ((thing.outline.min(axis=0), thing.outline.max(axis=0)) for thing in (one, other))
    room = min(float(np.sort(size)[1]) for size in (high - low, last - first)) / 2
    return bool((low < last + room).all() and (first < high + room).all())
