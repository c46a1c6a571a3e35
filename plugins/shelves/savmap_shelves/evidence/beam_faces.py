"""The beams' faces, with margins to posts, edges and connectors, so that all marks on them are the beam's."""

from collections.abc import Iterator, Mapping
from itertools import pairwise

import numpy as np

from savmap.types import FlatParts, Floats, PlanePatch
from savmap_shelves.evidence.face_grid import Grid, tracked_grid

END_WIDTHS = 0.75
"""The margin at a beam's ends, in widths of a post: connectors stand out from its face."""
TRIM = 0.12
"""The margin at a beam's edges, in heights of the beam: goods, decks and their shadows begin there."""
LABEL_M, LABEL_SIGMA_M = 0.001, 0.001
"""The depth of marks in front of the beam's face: scratches, holes and paint 0, magnetic labels 1 mm, label holders 2
to 3 mm."""

RIGHT, UP = np.eye(3)[0], np.eye(3)[1]


def beam_faces(points: Mapping[str, Floats]) -> list[FlatParts]:
    """The faces of all beams, in one plane. None where no beam was tracked with both edges."""
    beams = {name: position for name, position in points.items() if " / beam " in name}
    grid = tracked_grid(points)
    if grid is None or not beams:
        return []
    depth = float(np.median([position[2] for position in beams.values()]))
    faces = tuple(_faces(grid, depth))
    return [FlatParts(next(iter(beams)), "z", faces, LABEL_M, LABEL_SIGMA_M)] if faces else []


def _faces(grid: Grid, depth: float) -> Iterator[PlanePatch]:
    margin = END_WIDTHS * grid.width
    for section, ((_, left), (right, _)) in enumerate(pairwise(grid.posts), 1):
        for number, (low, high) in enumerate(grid.sections[section - 1], 1):
            trim = TRIM * (high - low)
            size = np.array([right - left - 2 * margin, high - low - 2 * trim])
            if size.min() > 0:
                corner = np.array([left + margin, low + trim, depth])
                yield PlanePatch(f"bay {section} / beam {number}", corner, RIGHT, UP, size, float(size.min()))
