"""The solved grid as structures: uprights and beams with their vertices, widths and standard deviations, and what is
read off them."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from savmap.errors import OutputError
from savmap.graph import Landmark, Solution
from savmap.types import Attribute, CrossRowLandmark, Floats, Solid, Structure, Track
from savmap_shelves.constraints.track_grid import TrackGrid, corner_column, grid_of

FLOOR_SIGMA_M, TOP_SIGMA_M = 0.05, 0.6
DEEPEST_RACK_M = 1.6
FRAME_SIGMA_M = 0.005
RING = np.array([[0, 1], [1, 3], [3, 2], [2, 0]])
AROUND = [0, 1, 3, 2]  # the corners in order
UNMEASURED_M = 0.15
"""An edge that is unsure by more was measured nowhere: what was taken for it in single pictures is at no one place."""
ALIKE, FEW_ALIKE, LEAST_PROFILES = 0.05, 0.25, 3
"""Such an edge is where beams of the usual height have it, of so many at least: to `ALIKE` of the height, or as far as
their heights scatter."""
NOT_SEEN, NEITHER = "edges", "neither edge seen"
USUAL_RACK_DEPTH_M, USUAL_BEAM_DEPTH_M = 1.1, 0.05  # for pallets of 1.2 m, which stand out by 5 cm on either side
EDGES = ("lower", "upper")
UNKNOWN_M = 10.0
BEAM_CORNERS = ("lower left", "lower right", "upper left", "upper right")
UPRIGHT_CORNERS = ("left / bottom", "right / bottom", "left / top", "right / top")


def describe(
    tracks: Sequence[Track], solution: Solution, plugin: str = "shelves", depth_m: float | None = None
) -> list[Structure]:
    """Uprights, then beams, from left to right and from the bottom up.

    An upright reaches from the floor to the highest edge beside it. Its sigmas say that neither end was measured, and
    the attribute `ends` that the top is assumed: uprights end a metre above their highest beam as often as at it. As a
    solid it is its whole frame, from the rack's front to its back, `depth_m` apart (None: assumed to be the usual). Of
    a beam of which one edge was measured nowhere, that is where a beam as high as most has it, and the attribute
    `edges` says so.
    """
    grid = grid_of(tracks)
    landmarks = solution.landmarks_of(plugin)
    beams = with_usual_height([*_beams(grid, landmarks, solution, plugin)])
    structures = [*_uprights(grid, landmarks, solution, plugin, beams), *beams]
    return [replace(structure, solid=_solid(structure, depth_m)) for structure in structures]


def _solid(structure: Structure, depth_m: float | None) -> Solid:
    frame = structure.label == "upright"
    depth = (depth_m or USUAL_RACK_DEPTH_M) if frame else USUAL_BEAM_DEPTH_M
    outline, back = structure.vertices[AROUND], np.array([0.0, 0.0, -depth])
    return Solid(outline, back, assumed=not frame or depth_m is None, ifc_class="IfcColumn" if frame else "IfcBeam")


def _uprights(
    grid: TrackGrid, landmarks: Mapping[str, Landmark], solution: Solution, plugin: str, beams: Sequence[Structure]
) -> Iterator[Structure]:
    """The uprights of which both edges were tracked."""
    for upright in sorted({number for number, _ in grid.columns}):
        if (upright, "left") not in grid.columns or (upright, "right") not in grid.columns:
            continue
        left, right = grid.columns[upright, "left"][0], grid.columns[upright, "right"][0]
        heights = ((0.0, FLOOR_SIGMA_M), (_top(upright, beams), TOP_SIGMA_M))
        ends = [_at_height(landmarks[name], y, sigma) for y, sigma in heights for name in (left, right)]
        attributes: dict[str, Attribute] = {
            "upright": upright,
            "ends": "top assumed",
            "width_m": float(landmarks[right].position[0] - landmarks[left].position[0]),
            "width_sigma_m": solution.difference_sigma(plugin, left, right, 0),
        }
        yield _structure(f"upright {upright}", "upright", UPRIGHT_CORNERS, ends, attributes)


def _structure(
    name: str,
    label: str,
    corners: Sequence[str],
    vertices: Sequence[tuple[Floats, Floats]],
    attributes: Mapping[str, Attribute],
) -> Structure:
    """The structure whose corners have these positions and covariances."""
    positions, covariances = (np.array(part) for part in zip(*vertices, strict=True))
    labels = tuple(f"{name} / {corner}" for corner in corners)
    return Structure(name, label, positions, covariances, labels, RING, attributes)


def _top(upright: int, beams: Sequence[Structure]) -> float:
    """The highest edge beside an upright, or of all where no beam is beside it."""
    adjacent = [beam for beam in beams if beam.attributes["bay"] in (upright - 1, upright)]
    return max((float(beam.vertices[:, 1].max()) for beam in adjacent or beams), default=0.0)


def _at_height(landmark: Landmark, y: float, sigma: float) -> tuple[Floats, Floats]:
    """The landmark moved along its upright to y: position and covariance, x and z as they were."""
    covariance = landmark.covariance.copy()
    covariance[1, :] = covariance[:, 1] = 0.0
    covariance[1, 1] = sigma**2
    return np.array([landmark.position[0], y, landmark.position[2]]), covariance


def _beams(grid: TrackGrid, landmarks: Mapping[str, Landmark], solution: Solution, plugin: str) -> Iterator[Structure]:
    """The beams, those of which one edge was not tracked with that edge at the other one's height, and unsure."""
    for section, beam in sorted({(section, beam) for section, beam, _ in grid.rows}):
        tracked = [edge for edge in EDGES if (section, beam, edge) in grid.rows]
        corners = [_corner(grid, landmarks, section, beam, corner) for corner in BEAM_CORNERS]
        attributes: dict[str, Attribute] = {
            "bay": section,
            "beam": beam,
            "height_m": 0.0,
            "height_sigma_m": UNKNOWN_M,
        }
        if len(tracked) == len(EDGES):
            lower, upper = (grid.rows[section, beam, edge][0] for edge in EDGES)
            attributes["height_m"] = float(landmarks[upper].position[1] - landmarks[lower].position[1])
            attributes["height_sigma_m"] = solution.difference_sigma(plugin, lower, upper, 1)
        yield _structure(f"bay {section} / beam {beam}", "beam", BEAM_CORNERS, corners, attributes)


def with_usual_height(beams: Sequence[Structure]) -> list[Structure]:
    """Beams, those of which one edge was measured nowhere, or less well than the usual height tells it, with that edge
    where most have it. Where no beam has both, those of which one was not even tracked are left out."""
    unmeasured = [_unmeasured(beam) for beam in beams]
    measured = [beam for beam, edges in zip(beams, unmeasured, strict=True) if not any(edges)]
    if not measured:
        return [beam for beam in beams if beam.attributes.get("height_sigma_m") != UNKNOWN_M]
    usual = [_usual_height(beam, measured) for beam in beams]
    unmeasured = [_worse_than(beam, size[1]) for beam, size in zip(beams, usual, strict=True)]
    return [
        _as_high(beam, *size, edges) if any(edges) else beam
        for beam, size, edges in zip(beams, usual, unmeasured, strict=True)
    ]


def _usual_height(beam: Structure, measured: Sequence[Structure]) -> tuple[float, float]:
    """The usual height of the beams of a beam's bay, or of the row's where these are too few, and how much they
    scatter, m; where the row's are too few, too, that is a guess."""
    section = [other for other in measured if other.attributes["bay"] == beam.attributes["bay"]]
    heights = np.array([_height(other) for other in (section if len(section) >= LEAST_PROFILES else measured)])
    usual = float(np.median(heights))
    scatter = ALIKE if len(heights) >= LEAST_PROFILES else FEW_ALIKE
    return usual, max(scatter * usual, float(np.std(heights)))


def _height(beam: Structure) -> float:
    return float(beam.vertices[2:, 1].mean() - beam.vertices[:2, 1].mean())


def _unmeasured(beam: Structure, limit_m: float = UNMEASURED_M) -> tuple[bool, bool]:
    """Whether a beam's lower and upper edge were measured nowhere, or worse than to a limit."""
    unsure = beam.covariances[:, 1, 1] > limit_m**2
    return bool(unsure[:2].all()), bool(unsure[2:].all())


def _worse_than(beam: Structure, sigma: float) -> tuple[bool, bool]:
    """Which of a beam's edges was measured nowhere, or less well than the other and the usual height tell it."""
    worse = _unmeasured(beam, min(UNMEASURED_M, sigma))
    return _unmeasured(beam) if all(worse) else worse


def _as_high(beam: Structure, height: float, sigma: float, unmeasured: tuple[bool, bool]) -> Structure:
    """A beam of a height with a standard deviation, m, which was measured nowhere at one edge or at both."""
    if all(unmeasured):
        return replace(beam, attributes={**beam.attributes, NOT_SEEN: NEITHER})
    vertices, covariances = beam.vertices.copy(), beam.covariances.copy()
    free, held = (slice(2), slice(2, None)) if unmeasured[0] else (slice(2, None), slice(2))
    vertices[free, 1] = vertices[held, 1] + (-height if unmeasured[0] else height)
    covariances[free, 1, :] = covariances[free, :, 1] = 0.0
    covariances[free, 1, 1] = covariances[held, 1, 1] + sigma**2
    sizes: dict[str, Attribute] = {
        "height_m": height,
        "height_sigma_m": sigma,
        NOT_SEEN: f"{'lower' if unmeasured[0] else 'upper'} edge not seen",
    }
    return replace(beam, vertices=vertices, covariances=covariances, attributes={**beam.attributes, **sizes})


def _corner(
    grid: TrackGrid, landmarks: Mapping[str, Landmark], section: int, beam: int, corner: str
) -> tuple[Floats, Floats]:
    """Position and covariance of a corner. If it was not tracked, it is where its row and its column meet; if its edge
    was not, that of the other edge."""
    name = f"bay {section} / beam {beam} / {corner}"
    if name in landmarks:
        return landmarks[name].position, landmarks[name].covariance
    edge, side = corner.split()
    if (section, beam, edge) not in grid.rows:
        other = next(other for other in EDGES if other != edge)
        position, covariance = _corner(grid, landmarks, section, beam, f"{other} {side}")
        return position, covariance + UNKNOWN_M**2 * np.diag([0.0, 1.0, 0.0])
    column = corner_column(section, side)
    row = landmarks[grid.rows[section, beam, edge][0]]
    if column not in grid.columns:
        return row.position, row.covariance
    across = landmarks[grid.columns[column][0]]
    covariance = row.covariance.copy()
    covariance[0, :] = covariance[:, 0] = 0.0
    covariance[0, 0] = across.covariance[0, 0]
    return np.array([across.position[0], row.position[1], row.position[2]]), covariance


def cross_row_landmarks(structures: Sequence[Structure]) -> list[CrossRowLandmark]:
    """The uprights' centre lines, which the row on the rack's other face sees too: a frame crosses the rack from front
    to back.

    A frame's two uprights are at the same x to `FRAME_SIGMA_M`. The errors of an upright's edges are taken for common
    to both.
    """
    return [
        CrossRowLandmark(
            upright.id,
            upright.label,
            upright.vertices.mean(axis=0),
            upright.covariances.mean(axis=0) + FRAME_SIGMA_M**2 * np.diag([1.0, 0.0, 0.0]),
            axes=("x",),
            behind_m=DEEPEST_RACK_M,
        )
        for upright in structures
        if upright.label == "upright"
    ]


@dataclass(frozen=True, eq=False)
class Elements:
    """Mapped elements sorted by centre: ids (n) and intervals (n, 2) m, x for uprights, y for beams."""

    ids: tuple[str, ...]
    intervals: Floats


@dataclass(frozen=True, eq=False)
class MappedSection:
    """A mapped bay: x from its beams' left to right ends (2,), and its beams."""

    extent: Floats
    beams: Elements


def uprights_of(structures: Sequence[Structure]) -> Elements:
    """The uprights, x of their left and right edges."""
    return _elements([upright for upright in structures if upright.label == "upright"], 0, ("left", "right"))


def sections_of(structures: Sequence[Structure]) -> list[MappedSection]:
    """The bays that have beams, from left to right, with y of the beams' lower and upper edges."""
    grouped: dict[int, list[Structure]] = {}
    for beam in structures:
        if beam.label == "beam":
            grouped.setdefault(number_of(beam, "bay"), []).append(beam)
    sections = [MappedSection(_extent(beams), _elements(beams, 1, ("lower", "upper"))) for beams in grouped.values()]
    return sorted(sections, key=lambda section: float(section.extent.mean()))


def number_of(structure: Structure, attribute: str) -> int:
    """A structure's number, such as its bay's. Raises OutputError where it has none."""
    number = structure.attributes.get(attribute)
    if not isinstance(number, int | np.integer):
        what = f"attribute '{attribute}' should be a whole number, not {number!r}"
        raise OutputError(f"map: {structure.id}: {what}; a map of an earlier savmap is to be made again")
    return int(number)


def _elements(structures: list[Structure], axis: int, sides: tuple[str, str]) -> Elements:
    intervals = np.array([_span(structure, axis, sides) for structure in structures], dtype=np.float64).reshape(-1, 2)
    order = np.argsort(intervals.mean(axis=1), kind="stable")
    return Elements(tuple(structures[k].id for k in order), intervals[order])


def _span(structure: Structure, axis: int, sides: tuple[str, str]) -> tuple[float, float]:
    """Mean coordinate of the vertices on either side, smaller first."""
    first, second = sorted(mean_of(structure, axis, side) for side in sides)
    return first, second


def mean_of(structure: Structure, axis: int, side: str) -> float:
    """Mean coordinate of the vertices on a side, "left" or "upper". Raises OutputError where there are none."""
    chosen = [side in label.split() for label in structure.vertex_labels]
    if not any(chosen):
        raise OutputError(f"map: {structure.id}: no vertex is labelled {side!r}")
    return float(structure.vertices[chosen, axis].mean())


def _extent(beams: list[Structure]) -> Floats:
    return np.median([_span(beam, 0, ("left", "right")) for beam in beams], axis=0)
