"""The beams' faces: as far from posts, edges and connectors as what shows on them is surely theirs."""

from collections.abc import Iterator, Mapping
from itertools import pairwise

import numpy as np

from savmap.types import FlatParts, Floats, PlanePatch
from savmap_shelves.evidence.face_grid import Grid, tracked_grid

END_WIDTHS = 0.75
"""A beam's ends, in widths of a post: connectors stand out from its face."""
TRIM = 0.12
"""Of a beam's height, at its edges: goods, decks and their shadows begin there."""
LABEL_M, LABEL_SIGMA_M = 0.001, 0.001
"""How far what shows on a beam stands out from it: scratches, holes and paint not at all, magnetic labels 1 mm, holders of labels 2 to 3 mm."""

RIGHT, UP = np.eye(3)[0], np.eye(3)[1]


def beam_faces(points: Mapping[str, Floats]) -> list[FlatParts]:
    """The faces of all beams, which lie in one plane; none where no beam was tracked whole."""
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
                yield PlanePatch(f"section {section} / beam {number}", corner, RIGHT, UP, size, float(size.min()))
