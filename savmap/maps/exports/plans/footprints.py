"""What stands on the floor: the outlines of solids as seen from above."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from savmap.errors import visible
from savmap.maps.exports.frames import Element, elements
from savmap.maps.exports.hull import hull
from savmap.maps.exports.marks import IN_BRACKETS, assumed_depths, unique
from savmap.types import Floats, SiteMap, array_record

CLEARANCE_M = 2.5
"""What hangs higher above the floor is in no vehicle's way."""
LEAST_SIDE_M = 1e-4
"""Corners nearer to one another are one."""


@dataclass(frozen=True, eq=False)
@array_record
class Footprint:
    """A solid from above: its convex outline (n, 2) m, counter-clockwise, from `bottom_m` to `top_m` in the world.
    No other has its `name`. `assumed`: its depth, `depth_m`, was neither measured nor given."""

    name: str
    row: str
    plugin: str
    id: str
    label: str
    outline: Floats
    bottom_m: float
    top_m: float
    depth_m: float
    assumed: bool

    @property
    def axis(self) -> Floats:
        """The line (2, 2) along its middle, from one short side to the other: of the rectangle around it along its
        longest side."""
        sides = np.roll(self.outline, -1, axis=0) - self.outline
        along = sides[int(np.argmax(np.linalg.norm(sides, axis=1)))]
        along = along / np.linalg.norm(along)
        across = np.array([-along[1], along[0]])
        reach, breadth = self.outline @ along, self.outline @ across
        middle = (breadth.min() + breadth.max()) / 2 * across
        ends: Floats = np.array([reach.min() * along + middle, reach.max() * along + middle])
        return ends


def footprints(structures: Sequence[Element]) -> list[Footprint]:
    """The footprints of all elements that have a solid, in their order. Texts are on one line and show what they do."""
    solids = [(element, element.structure.solid) for element in structures if element.structure.solid is not None]
    names = unique([visible(f"{element.row} / {element.structure.id}") for element, _ in solids], form=IN_BRACKETS)
    shapes = []
    for name, (element, solid) in zip(names, solids, strict=True):
        corners = np.vstack([solid.outline, solid.outline + solid.depth])
        structure = element.structure
        row, plugin, structure_id, label = map(visible, (element.row, element.plugin, structure.id, structure.label))
        low, high = float(corners[:, 2].min()), float(corners[:, 2].max())
        depth_m, outline = float(np.linalg.norm(solid.depth)), _thick(hull(corners[:, :2]))
        shapes.append(Footprint(name, row, plugin, structure_id, label, outline, low, high, depth_m, solid.assumed))
    return shapes


def obstacles(site: SiteMap) -> list[Footprint]:
    """The footprints of what begins lower than `CLEARANCE_M` above the floor. Raises OutputError where rows have no
    common frame."""
    floor_m = site.alignment.z_m if site.alignment else 0.0
    return [footprint for footprint in footprints(elements(site)) if footprint.bottom_m < floor_m + CLEARANCE_M]


def depth_note(shown: Iterable[Footprint]) -> str:
    """What to say of their depths that were neither measured nor given; nothing where there is none."""
    return assumed_depths((footprint.label, footprint.depth_m) for footprint in shown if footprint.assumed)


def _thick(outline: Floats) -> Floats:
    """An outline that is a line or a point, such as that of a plate that lies askew, as a strip of the least width."""
    spread = outline - outline.mean(axis=0)
    if len(outline) > 2 and np.linalg.svd(spread, compute_uv=False)[-1] > LEAST_SIDE_M / 2:
        return outline
    return hull(outline, LEAST_SIDE_M / 2)
