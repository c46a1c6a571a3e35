"""The solved grid as structures: uprights and beams with their vertices, widths and standard deviations."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from savmap.graph import Landmark, Solution
from savmap.types import Floats, Structure, Track
from savmap_shelves.constraints import Grid, grid_of

FLOOR_SIGMA_M, TOP_SIGMA_M = 0.05, 0.3
RING = np.array([[0, 1], [1, 3], [3, 2], [2, 0]])
BEAM_CORNERS = ("lower left", "lower right", "upper left", "upper right")
UPRIGHT_CORNERS = ("left / bottom", "right / bottom", "left / top", "right / top")


def describe(tracks: Sequence[Track], solution: Solution, room: str = "shelves") -> list[Structure]:
    """Uprights, then beams, from left to right and from the bottom up.

    An upright whose mask's ends were not seen reaches from the floor to the highest edge beside it, which its sigmas say.
    """
    grid = grid_of(tracks)
    found = solution.landmarks_of(room)
    return [*_uprights(grid, found, solution, room), *_beams(grid, found, solution, room)]


def _uprights(grid: Grid, found: Mapping[str, Landmark], solution: Solution, room: str) -> Iterator[Structure]:
    for upright in sorted({number for number, side in grid.columns if (number, other(side)) in grid.columns}):
        left, right = grid.columns[upright, "left"][0], grid.columns[upright, "right"][0]
        top = _top(upright, grid, found)
        ends = [
            _at_height(found[name], y, sigma)
            for y, sigma in ((0.0, FLOOR_SIGMA_M), (top, TOP_SIGMA_M))
            for name in (left, right)
        ]
        yield Structure(
            f"upright {upright}",
            "upright",
            np.array([end[0] for end in ends]),
            np.array([end[1] for end in ends]),
            tuple(f"upright {upright} / {corner}" for corner in UPRIGHT_CORNERS),
            RING,
            {
                "upright": upright,
                "width_m": float(found[right].position[0] - found[left].position[0]),
                "width_sigma_m": solution.difference_sigma(room, left, right, 0),
            },
        )


def other(side: str) -> str:
    """The opposite side."""
    return "right" if side == "left" else "left"


def _top(upright: int, grid: Grid, found: Mapping[str, Landmark]) -> float:
    beside = [names[0] for (section, _, _), names in grid.rows.items() if section in (upright - 1, upright)]
    return max(float(found[name].position[1]) for name in beside or [names[0] for names in grid.rows.values()])


def _at_height(landmark: Landmark, y: float, sigma: float) -> tuple[Floats, Floats]:
    """The landmark moved along its upright to y: its own x and z, and their covariance."""
    covariance = landmark.covariance.copy()
    covariance[1, :] = covariance[:, 1] = 0.0
    covariance[1, 1] = sigma**2
    return np.array([landmark.position[0], y, landmark.position[2]]), covariance


def _beams(grid: Grid, found: Mapping[str, Landmark], solution: Solution, room: str) -> Iterator[Structure]:
    for section, beam in sorted({(section, beam) for section, beam, _ in grid.rows}):
        if not all((section, beam, edge) in grid.rows for edge in ("lower", "upper")):
            continue
        corners = [_corner(grid, found, section, beam, corner) for corner in BEAM_CORNERS]
        lower, upper = (grid.rows[section, beam, edge][0] for edge in ("lower", "upper"))
        yield Structure(
            f"section {section} / beam {beam}",
            "beam",
            np.array([position for position, _ in corners]),
            np.array([covariance for _, covariance in corners]),
            tuple(f"section {section} / beam {beam} / {corner}" for corner in BEAM_CORNERS),
            RING,
            {
                "section": section,
                "beam": beam,
                "height_m": float(found[upper].position[1] - found[lower].position[1]),
                "height_sigma_m": solution.difference_sigma(room, lower, upper, 1),
            },
        )


def _corner(grid: Grid, found: Mapping[str, Landmark], section: int, beam: int, corner: str) -> tuple[Floats, Floats]:
    """A corner that was never seen is where its row and its column meet."""
    name = f"section {section} / beam {beam} / {corner}"
    if name in found:
        return found[name].position, found[name].covariance
    edge, side = corner.split()
    column = (section, "right") if side == "left" else (section + 1, "left")
    row = found[grid.rows[section, beam, edge][0]]
    if column not in grid.columns:
        return row.position, row.covariance
    across = found[grid.columns[column][0]]
    covariance = row.covariance.copy()
    covariance[0, :] = covariance[:, 0] = 0.0
    covariance[0, 0] = across.covariance[0, 0]
    return np.array([across.position[0], row.position[1], row.position[2]]), covariance
