"""A rack as constraints: columns, rows, the lowest edges' heights and the face plane (paper, section III.E).

World frame of the row; x = 0 at the left edge of the first upright.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from savmap.errors import StructureError
from savmap.graph import (
    TIGHT_M,
    Constraints,
    KeySpace,
    Relation,
    equal_coordinate,
    fixed_coordinate,
    image_measurements,
    known_coordinate,
    known_length,
)
from savmap.types import Axis, Floats, RowFacts, Track, Trajectory
from savmap_shelves.bias import NO_BIAS, BiasSettings, mask_biases
from savmap_shelves.heights import Values, assignments
from savmap_shelves.places import Column, Row, column_of, is_foot, row_of
from savmap_shelves.sharing import share_edges

TOP_M = 6.0
FLOOR_SIGMA_M = 0.05


@dataclass(frozen=True)
class GridSettings:
    """What is known of a rack: height of the lowest beam's bottom edge (h_ref) of every section, or one for all, with its
    sigma; the pitch of the bays, from an upright's edge to the same one of the next, likewise; how far beams' faces stand
    back behind the uprights', with its sigma.

    The paper puts beams and uprights on one plane: sigma 0. One pass hardly shows the setback: 5 mm too little make a rack seen from
    1.5 m 0.3 % too low. A vertical length ends it.

    `bias`: how far masks may be too wide or too narrow. `corners`: each with the
    covariance of its two lines, or, as published, as points of 1 px, the uprights' own edges then serving only where
    no beam ends.
    """

    lowest_beam_bottom_height_m: Values | None = None
    sigma_m: float = 0.002
    beam_setback_m: float = 0.005
    beam_setback_sigma_m: float = 0.01
    bay_pitch_m: Values | None = None
    bay_pitch_sigma_m: float = 0.003
    bias: BiasSettings = NO_BIAS
    corners: Literal["lines", "points"] = "lines"


def published(lowest_m: float | Sequence[float] | None, sigma_m: float = 0.002) -> GridSettings:
    """The paper's: corners as points of 1 px, beams on the uprights' plane, masks believed."""
    return GridSettings(lowest_m, sigma_m, beam_setback_sigma_m=0.0, bias=NO_BIAS, corners="points")


@dataclass(frozen=True)
class Grid:
    """Names of the tracks in each column (upright, side) and row (section, beam, edge)."""

    columns: Mapping[Column, tuple[str, ...]]
    rows: Mapping[Row, tuple[str, ...]]

    @property
    def sections(self) -> tuple[int, ...]:
        """Sections that have beams, in order."""
        return tuple(sorted({section for section, _, _ in self.rows}))


def constrain(
    tracks: Sequence[Track],
    facts: RowFacts,
    start: Trajectory,
    room: str = "shelves",
    settings: GridSettings | None = None,
) -> Constraints:
    """The rack's part of the graph. Raises StructureError if there is no grid, SiteError if fewer heights or
    pitches are given than sections were found."""
    chosen = settings or GridSettings()
    feet = [track for track in tracks if is_foot(track)] if chosen.lowest_beam_bottom_height_m is None else []
    tracks = [track for track in tracks if not is_foot(track)]
    grid = grid_of(tracks)
    if not grid.columns or not grid.rows:
        raise StructureError(f"row {facts.name}: no uprights with beams between them were tracked")
    shared, dof = _weighed(tracks, grid, facts, start, chosen)
    keys = KeySpace(room).keys(track.name for track in (*tracks, *feet))
    initial = published_grid(tracks, grid, start, chosen)
    ways = _given(grid, keys, chosen, facts.name)
    return Constraints(
        room,
        keys,
        image_measurements(
            (*shared, *feet),
            keys,
            facts.views,
            dof=dof,
            biases=mask_biases((*shared, *feet), facts.views, start, chosen.bias),
        ),
        (
            *_grid_lines(grid, keys),
            *_plane(tracks, keys, chosen),
            *(next(iter(ways.values())) if len(ways) == 1 else ()),
            *_floor(feet, keys),
        ),
        initial | {track.name: _below(track, grid, initial) for track in feet},
        dict(_places(grid, keys)),
        alternatives=ways if len(ways) > 1 else {},
        height_reference="lowest_beam_bottom_height_m",
    )


def _weighed(
    tracks: Sequence[Track], grid: Grid, facts: RowFacts, start: Trajectory, settings: GridSettings
) -> tuple[list[Track], dict[str, Floats]]:
    """Tracks with the covariances that the solve is to believe, and what each observation is worth where that is not plain."""
    if settings.corners == "lines":
        apart = settings.beam_setback_m != 0 or settings.beam_setback_sigma_m > 0
        return share_edges(tracks, facts.views, start, apart=apart)
    points = [replace(t, covariances=np.tile(np.eye(2), (len(t.frames), 1, 1))) for t in tracks if t.label == "beam"]
    bare = {column for column, names in grid.columns.items() if not any(n.startswith("section") for n in names)}
    return [*points, *(t for t in tracks if t.label != "beam" and column_of(t) in bare)], {}


def grid_of(tracks: Sequence[Track]) -> Grid:
    """Sort tracks into columns and rows by their place."""
    columns: dict[Column, list[str]] = {}
    rows: dict[Row, list[str]] = {}
    for track in (one for one in tracks if not is_foot(one)):
        columns.setdefault(column_of(track), []).append(track.name)
        if track.label == "beam":
            rows.setdefault(row_of(track), []).append(track.name)
    return Grid({key: tuple(columns[key]) for key in sorted(columns)}, {key: tuple(rows[key]) for key in sorted(rows)})


def _grid_lines(grid: Grid, keys: Mapping[str, int]) -> Iterator[Relation]:
    lines: tuple[tuple[Axis, Mapping[Column, tuple[str, ...]] | Mapping[Row, tuple[str, ...]]], ...]
    lines = (("x", grid.columns), ("y", grid.rows))
    for axis, groups in lines:
        for first, *others in groups.values():
            yield from (equal_coordinate(axis, keys[first], keys[other]) for other in others)


def _plane(tracks: Sequence[Track], keys: Mapping[str, int], settings: GridSettings) -> Iterator[Relation]:
    """The face is z = 0; the row begins at the left edge of its first upright."""
    beams = [keys[track.name] for track in tracks if track.label == "beam"]
    yield from (fixed_coordinate("z", keys[track.name]) for track in tracks if track.label != "beam")
    yield fixed_coordinate("z", beams[0], -settings.beam_setback_m, max(TIGHT_M, settings.beam_setback_sigma_m))
    yield from (equal_coordinate("z", beams[0], other) for other in beams[1:])
    first = min(column_of(track) for track in tracks)
    yield fixed_coordinate("x", keys[next(track.name for track in tracks if column_of(track) == first)], 0.0)


def _given(grid: Grid, keys: Mapping[str, int], settings: GridSettings, row: str) -> dict[str, tuple[Relation, ...]]:
    """What was measured of sections: h_ref and pitch; several ways, where the row has more sections than found."""
    figures = {
        "lowest_beam_bottom_height_m": settings.lowest_beam_bottom_height_m,
        "bay_pitch_m": settings.bay_pitch_m,
    }
    given = {setting: values for setting, values in figures.items() if values is not None}

    def relations(way: Mapping[str, Mapping[int, float]]) -> Iterator[Relation]:
        for section, value in way.get("lowest_beam_bottom_height_m", {}).items():
            yield _height(grid, keys, section, value, settings)
        for section, value in way.get("bay_pitch_m", {}).items():
            yield from _pitch(grid, keys, section, value, settings)

    ways = assignments(given, grid.sections, row)
    return {name: tuple(relations(way)) for name, way in ways.items()}


def _pitch(
    grid: Grid, keys: Mapping[str, int], section: int, value: float, settings: GridSettings
) -> Iterator[Relation]:
    """From an upright's edge to the same edge of the next: left ones, or right ones where a left one was not seen."""
    for side in ("left", "right"):
        if (section, side) in grid.columns and (section + 1, side) in grid.columns:
            first, second = (keys[grid.columns[upright, side][0]] for upright in (section, section + 1))
            yield known_length("x", first, second, value, settings.bay_pitch_sigma_m, f"bay pitch of section {section}")
            return


def _height(grid: Grid, keys: Mapping[str, int], section: int, value: float, settings: GridSettings) -> Relation:
    lowest = min(beam for found, beam, edge in grid.rows if found == section and edge == "lower")
    name = f"height of the lowest edge of section {section}"
    doubt = f"section {section}: the lowest beam at {value:.3f} m was not seen; its height is not used"
    return known_coordinate("y", keys[grid.rows[section, lowest, "lower"][0]], value, settings.sigma_m, name, doubt)


def _floor(feet: Sequence[Track], keys: Mapping[str, int]) -> Iterator[Relation]:
    """Uprights stand on the floor, y = 0: a reference like any other, for maps without a known height."""
    for track in feet:
        yield fixed_coordinate("z", keys[track.name])
        yield known_coordinate(
            "y", keys[track.name], 0.0, FLOOR_SIGMA_M, f"floor under upright {track.place['upright']}"
        )


def _below(foot: Track, grid: Grid, initial: Mapping[str, Floats]) -> Floats:
    x = [initial[grid.columns[column][0]][0] for column in grid.columns if column[0] == foot.place["upright"]]
    return np.array([np.mean(x) if x else 0.0, 0.0, 0.0])


def _places(grid: Grid, keys: Mapping[str, int]) -> Iterator[tuple[str, tuple[Axis, int]]]:
    """Names of whole edges, for measured lengths."""
    for (upright, side), (first, *_) in grid.columns.items():
        yield f"upright {upright} / {side}", ("x", keys[first])
    for (section, beam, edge), (first, *_) in grid.rows.items():
        yield f"section {section} / beam {beam} / {edge}", ("y", keys[first])


def published_grid(tracks: Sequence[Track], grid: Grid, start: Trajectory, settings: GridSettings) -> dict[str, Floats]:
    """The paper's start: an equally spaced grid on the face as long as the camera's path."""
    reach = start.world_from_rig[:, 0, 3]
    uprights = sorted({upright for upright, _ in grid.columns})
    along = dict(zip(uprights, np.linspace(0.0, float(np.ptp(reach)), len(uprights)).tolist(), strict=True))
    levels = {section: 1 + max(beam for found, beam, _ in grid.rows if found == section) for section in grid.sections}
    placed = {}
    for track in tracks:
        upright, side = column_of(track)
        depth, height = 0.0, TOP_M if track.place.get("end") == "top" else 0.0
        if track.label == "beam":
            section, beam, edge = row_of(track)
            depth, height = -settings.beam_setback_m, TOP_M * beam / levels[section] + 0.1 * (edge == "upper")
        placed[track.name] = np.array([along[upright] + 0.1 * (side == "right"), height, depth])
    return placed
