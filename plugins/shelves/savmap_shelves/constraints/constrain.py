"""A rack as constraints: columns, rows, the lowest edges' heights and the face plane (paper, section III.E).

World frame of the row; x = 0 at the left edge of the first upright.

The masks' biases are unknowns of the solve: their edges lie outside their structure, or inside it, by much the same
everywhere. A bias of b px makes every width too large by 2 b px and every gap too small by as much (paper, section
IV.B). What a pixel is worth in metres changes with the camera's distance and, in a wide view, with its attitude; widths
do not: so the bias shows, if faintly; a single known width shows it well. The bias of a single edge does not show at
all, but counts in its sigma.
"""

import logging
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from savmap.errors import SiteError, StructureError
from savmap.graph import (
    TIGHT_M,
    Biases,
    Constraints,
    KeySpace,
    Relation,
    equal_coordinate,
    fixed_coordinate,
    image_measurements,
    known_coordinate,
    known_length,
)
from savmap.types import Axis, Bools, Floats, Ints, RowFacts, Track, Trajectory, ViewSpec
from savmap_shelves.constraints.sharing import directions, share_edges
from savmap_shelves.constraints.track_grid import Column, Row, TrackGrid, column_of, grid_of, is_foot, is_part, row_of
from savmap_shelves.settings import ShelvesSettings

CLASSES = ("all", "upright", "beam")
LEAST_SINE = 0.1


@dataclass(frozen=True)
class BiasSettings:
    """Standard deviations, px, of the bias of all edges, of the further bias of each class's edges, and of each edge's;
    `upright_px`: of an upright's edge, where it is another.

    `common`: whether the first two are estimated, or only allowed for in sigmas. `relative`: they are multiples of each
    measurement's standard deviation instead, as the residuals show it: what is seen badly is likely to be off by more,
    all along.
    """

    all_px: float = 0.0
    class_px: float = 0.0
    edge_px: float = 0.0
    common: Literal["estimated", "considered"] = "considered"
    relative: bool = False
    upright_px: float | None = None


NO_BIAS = BiasSettings()
PICTURES = BiasSettings(0.2, 0.3, 1.2, relative=True, upright_px=0.4)
"""Of edges measured in pictures: what makes normalised errors of widths and heights of maps of simulated footage about
unit-sized."""


def mask_biases(
    tracks: Sequence[Track], views: Mapping[str, ViewSpec], start: Trajectory, settings: BiasSettings
) -> Biases | None:
    """How pixels move with each bias: an edge outwards, across itself. None if all sigmas are 0."""
    if not max(settings.all_px, settings.class_px, settings.edge_px, settings.upright_px or 0.0) > 0:
        return None
    standing = [track for track in tracks if not is_foot(track)]
    edges: list[Column | Row] = [*sorted({column_of(t) for t in standing})]
    edges += sorted({row_of(t) for t in standing if t.label == "beam"})
    number = {edge: index for index, edge in enumerate(edges, len(CLASSES))}
    moves = [_moves(track, directions(track, views, start), settings.relative) for track in tracks]
    which = [np.tile(_which(track, number), (len(track.frames), 1)) for track in tracks]
    common = [settings.all_px, settings.class_px, settings.class_px]
    upright_px = settings.edge_px if settings.upright_px is None else settings.upright_px
    prior = np.array([*common, *(upright_px if len(edge) == 2 else settings.edge_px for edge in edges)])
    free = (np.arange(len(prior)) < len(CLASSES)) & (settings.common == "estimated")
    return _without_empty(np.concatenate(which), np.concatenate(moves), prior, free & (prior > 0), settings.relative)


def _which(track: Track, number: Mapping[Column | Row, int]) -> Ints:
    """Numbers (5,) of the biases that move a track's observations."""
    if is_foot(track):
        return np.zeros(5, np.int64)
    level = number[row_of(track)] if track.label == "beam" else 0
    return np.array([0, 1, 2, number[column_of(track)], level])


def _moves(track: Track, axes: Floats, relative: bool) -> Floats:
    """What each of five biases, in px or `relative` to standard deviations, adds to the pixels (n, 2, 5): a corner
    slides along an edge if the other moves.

    axes (n, 2, 2): image directions of x and y, as columns.
    """
    if is_foot(track):
        return np.zeros((len(axes), 2, 5))
    x, y = axes[:, :, 0], axes[:, :, 1]
    per_px = 1 / np.maximum(np.abs(x[:, 0] * y[:, 1] - x[:, 1] * y[:, 0]), LEAST_SINE)
    beam = track.label == "beam"
    right = (track.place["side"] == "left") == beam
    across_upright, across_beam = _sigmas(track, axes) if relative else np.ones((2, len(axes)))
    upright = (1.0 if right else -1.0) * (per_px * across_upright)[:, None] * x
    up = 1.0 if track.place.get("edge") == "upper" else -1.0
    level = up * (per_px * across_beam)[:, None] * y if beam else np.zeros_like(y)
    return np.stack([upright + level, upright, level, upright, level], axis=-1)


def _sigmas(track: Track, axes: Floats) -> tuple[Floats, Floats]:
    """Standard deviations (n,) px across the upright's and across the beam's edge that observations lie on."""
    if track.label != "beam":
        return np.sqrt(np.linalg.eigvalsh(track.covariances)[:, 0]), np.zeros(len(axes))
    normals = np.stack([axes[:, 1], -axes[:, 0]], axis=1)[:, :, ::-1]
    upright, level = np.sqrt(np.einsum("nik,nij,njk->kn", normals, track.covariances, normals))
    return np.asarray(upright), np.asarray(level)


def _without_empty(which: Ints, moves: Floats, prior: Floats, free: Bools, relative: bool) -> Biases:
    """The biases whose sigma is not 0."""
    real = prior > 0
    number = np.cumsum(real) - 1
    kept = real[which]
    return Biases(
        np.where(kept, number[which], 0),
        moves * kept[:, None, :],
        prior[real],
        free[real],
        np.full(int(real.sum()), relative),
    )


_log = logging.getLogger(__name__)
Values = float | Sequence[float | None]
TOP_M = 6.0
FLOOR_SIGMA_M = 0.03
ONE_SIGMA = 0.001
"""Of where all feet together put the floor: what hides one or lifts it, such as a plate or a guard, does so to all of a
row."""
HIDDEN_FEET = (
    "by what was measured, the uprights' feet are not on the floor: either guards or goods hide them, and they are not "
    "used, or a reference is wrong; measure the camera's height and a length again, or give the height of a lowest beam"
)


@dataclass(frozen=True)
class GridSettings:
    """What is known of a rack, metres.

    Height of the lowest beam's bottom edge (h_ref), one for all bays or one a bay, with its sigma; the pitch of
    the bays, from an upright's edge to the same one of the next, likewise; how far beams' faces stand back behind the
    uprights', with its sigma. The paper puts beams and uprights on one plane: sigma 0. One pass hardly shows the
    setback: 5 mm too little make a rack seen from 1.5 m 0.3 % too low. A vertical length ends it.

    `bias`: how far masks may be too wide or too narrow.
    """

    lowest_beam_bottom_height_m: Values | None = None
    sigma_m: float = 0.002
    beam_setback_m: float = 0.005
    beam_setback_sigma_m: float = 0.01
    bay_pitch_m: Values | None = None
    bay_pitch_sigma_m: float = 0.003
    bias: BiasSettings = NO_BIAS


def grid_settings(config: ShelvesSettings) -> GridSettings:
    """What a site file says of a rack seen by the plugin's network."""
    settings = GridSettings(beam_setback_m=config.beam_setback_m, bias=PICTURES)
    if height := config.lowest_beam_bottom_height_m:
        settings = replace(settings, lowest_beam_bottom_height_m=height.values, sigma_m=height.sigma)
    if pitch := config.bay_pitch_m:
        settings = replace(settings, bay_pitch_m=pitch.value, bay_pitch_sigma_m=pitch.sigma)
    return settings


def constrain(
    tracks: Sequence[Track],
    facts: RowFacts,
    start: Trajectory,
    plugin: str = "shelves",
    settings: GridSettings | None = None,
) -> Constraints:
    """The rack's part of the graph.

    Raises StructureError if there is no grid, SiteError if fewer heights or pitches are given than bays were found.
    """
    settings = settings or GridSettings()
    feet = _feet(tracks, facts)
    if facts.sees_in_part and not feet and settings.lowest_beam_bottom_height_m is not None:
        line = "row %s: the camera does not see where the uprights stand: the lowest beam's height is not used"
        _log.warning(line, facts.name)
        settings = replace(settings, lowest_beam_bottom_height_m=None)
    feet = feet if settings.lowest_beam_bottom_height_m is None else []
    tracks = [track for track in tracks if not is_foot(track) and not is_part(track)]
    grid = grid_of(tracks)
    if not grid.columns or not grid.rows:
        raise StructureError(f"row {facts.name}: no uprights with beams between them were tracked")
    weighted, dof = share_edges(tracks, facts.views, start)
    observed = (*weighted, *feet)
    keys = KeySpace(plugin).keys(track.name for track in (*tracks, *feet))
    initial = _initial_grid(tracks, grid, start, settings)
    alternatives = section_references(grid, keys, settings, facts.name)
    biases = mask_biases(observed, facts.views, start, settings.bias)
    certain = next(iter(alternatives.values())) if len(alternatives) == 1 else ()
    return Constraints(
        plugin,
        keys,
        image_measurements(observed, keys, facts.views, dof=dof, biases=biases),
        (*_grid_lines(grid, keys), *_plane(tracks, keys, settings), *certain, *_floor(feet, keys)),
        initial | {track.name: _initial_foot(track, grid, initial) for track in feet},
        dict(_edge_names(grid, keys)),
        alternatives=alternatives if len(alternatives) > 1 else {},
        unit=_one_bay(grid, keys),
    )


def _feet(tracks: Sequence[Track], facts: RowFacts) -> list[Track]:
    """Where uprights stand on the floor; nowhere where a camera that sees in part shows that of few uprights alone:
    goods hide what is below."""
    feet = [track for track in tracks if is_foot(track)]
    uprights = {track.place["upright"] for track in tracks if track.label == "upright"}
    return [] if facts.sees_in_part and 2 * len(feet) < len(uprights) else feet


def _grid_lines(grid: TrackGrid, keys: Mapping[str, int]) -> Iterator[Relation]:
    """Tracks of a column have the same x, tracks of a row the same y."""
    lines: tuple[tuple[Axis, list[tuple[str, ...]]], ...]
    lines = (("x", list(grid.columns.values())), ("y", list(grid.rows.values())))
    for axis, groups in lines:
        for first, *others in groups:
            yield from (equal_coordinate(axis, keys[first], keys[other]) for other in others)


def _plane(tracks: Sequence[Track], keys: Mapping[str, int], settings: GridSettings) -> Iterator[Relation]:
    """The face is z = 0; the row begins at the left edge of its first upright."""
    beams = [keys[track.name] for track in tracks if track.label == "beam"]
    yield from (fixed_coordinate("z", keys[track.name]) for track in tracks if track.label != "beam")
    yield fixed_coordinate("z", beams[0], -settings.beam_setback_m, max(TIGHT_M, settings.beam_setback_sigma_m))
    yield from (equal_coordinate("z", beams[0], other) for other in beams[1:])
    first = min(tracks, key=column_of)
    yield fixed_coordinate("x", keys[first.name], 0.0)


def section_references(
    grid: TrackGrid, keys: Mapping[str, int], settings: GridSettings, row: str
) -> dict[str, tuple[Relation, ...]]:
    """What was measured of bays, h_ref and pitch, by name; several alternatives where values are given for more bays
    than were found. Where the map counts a bay otherwise than the user's list, both numbers are told."""
    figures = {
        "lowest_beam_bottom_height_m": settings.lowest_beam_bottom_height_m,
        "bay_pitch_m": settings.bay_pitch_m,
    }

    def relations(first: int, values: Mapping[str, Mapping[int, float]]) -> Iterator[Relation]:
        numbers = dict(zip(grid.sections, (first + place + 1 for place in places), strict=True))
        bays = {
            section: f"bay {section}" + (f" (value {number} of {count})" if count and number != section else "")
            for section, number in numbers.items()
        }
        for section, value in values.get("lowest_beam_bottom_height_m", {}).items():
            if (lowest := _lowest_edge(grid, section)) is None:
                line = "row %s: %s: the lowest beam's lower edge was not seen; its height is not used"
                _log.warning(line, row, bays[section])
            else:
                yield _height(keys[lowest], bays[section], value, settings)
        for section, value in values.get("bay_pitch_m", {}).items():
            yield from _pitch(grid, keys, section, bays[section], value, settings)

    given = {setting: values for setting, values in figures.items() if values is not None}
    count = next((len(values) for values in given.values() if not isinstance(values, int | float)), None)
    places = _places(grid.sections, count)
    ways = assignments(given, grid.sections, row).items()
    return {name: tuple(relations(first, values)) for first, (name, values) in enumerate(ways)}


def assignments(
    given: Mapping[str, Values], sections: Sequence[int], row: str
) -> dict[str, dict[str, dict[int, float]]]:
    """The given figures of the bays found, by setting: the same for all, or one a bay of the row, left to right.

    There is one assignment where all bays were found. Where the row has more, each run of neighbours makes one, by
    name. A bay without beams, such as a passage, counts as the others do, and its value is None; a list without it is
    taken, too, where no other bay is missing. Raises SiteError where the row has fewer.
    """
    counts = {setting: len(values) for setting, values in given.items() if not isinstance(values, int | float)}
    places = _places(sections, next(iter(counts.values()), None))
    for setting, count in counts.items():
        if count <= places[-1]:
            what = f"row {row}: {setting} gives {count} values, but {_found(sections)}"
            raise SiteError(
                f"{what}; give one for each, or, if `side` asks for the other face, change it; the row mapped without "
                f"{setting} shows what is taken for a bay"
            )
    whole = max(counts.values(), default=places[-1] + 1)
    lists = {
        setting: [float(values)] * whole if isinstance(values, int | float) else values
        for setting, values in given.items()
    }
    return {
        f"bays {first + 1} to {first + places[-1] + 1} of {whole}": {
            setting: _of_sections(values, sections, [first + place for place in places])
            for setting, values in lists.items()
        }
        for first in range(whole - places[-1])
    }


def _places(sections: Sequence[int], count: int | None) -> list[int]:
    """Where the values of bays with beams are in a list, counted from that of the first."""
    if count == len(sections):
        return list(range(count))
    return [section - sections[0] for section in sections]


def _of_sections(values: Sequence[float | None], sections: Sequence[int], places: Sequence[int]) -> dict[int, float]:
    pairs = ((section, values[place]) for section, place in zip(sections, places, strict=True))
    return {section: value for section, value in pairs if value is not None}


def _found(sections: Sequence[int]) -> str:
    span = sections[-1] - sections[0] + 1
    without = (
        f", {span - len(sections)} of them without beams (write `null` for such a one)" if span > len(sections) else ""
    )
    return f"{span} bays were found{without}"


def _pitch(
    grid: TrackGrid, keys: Mapping[str, int], section: int, bay: str, value: float, settings: GridSettings
) -> Iterator[Relation]:
    """From an upright's edge to the same edge of the next: left ones, or right ones where a left one was not seen."""
    for side in ("left", "right"):
        if (section, side) in grid.columns and (section + 1, side) in grid.columns:
            first, second = (keys[grid.columns[upright, side][0]] for upright in (section, section + 1))
            yield known_length("x", first, second, value, settings.bay_pitch_sigma_m, f"bay pitch of {bay}")
            return


def _one_bay(grid: TrackGrid, keys: Mapping[str, int]) -> tuple[Relation, ...]:
    """The pitch of the middle one of the bays as 1: those at the ends may be seen in part."""
    section = grid.sections[len(grid.sections) // 2]
    unit = _pitch(grid, keys, section, "", 1.0, GridSettings(bay_pitch_sigma_m=ONE_SIGMA))
    return tuple(replace(relation, name="bay pitch taken for 1", is_given=False) for relation in unit)


def _lowest_edge(grid: TrackGrid, section: int) -> str | None:
    """A track on the lower edge of a bay's lowest beam; None where that edge was not seen."""
    lowest = min(beam for number, beam, _ in grid.rows if number == section)
    return next(iter(grid.rows.get((section, lowest, "lower"), ())), None)


def _height(edge: int, bay: str, value: float, settings: GridSettings) -> Relation:
    """The height that was given for the lowest edge (its key) of a bay."""
    name = f"height of the lowest edge of {bay}"
    warning = f"{bay}: the lowest beam at {value:.3f} m was not seen; its height is not used"
    common = isinstance(settings.lowest_beam_bottom_height_m, int | float)
    return replace(known_coordinate("y", edge, value, settings.sigma_m, name, warning), may_be_missing=common)


def _floor(feet: Sequence[Track], keys: Mapping[str, int]) -> Iterator[Relation]:
    """Uprights stand on the floor, y = 0: one reference for maps without a known height."""
    sigma = FLOOR_SIGMA_M * float(np.sqrt(len(feet)))
    for track in feet:
        yield fixed_coordinate("z", keys[track.name])
        floor = known_coordinate("y", keys[track.name], 0.0, sigma, "floor under the uprights")
        yield replace(floor, presumed=HIDDEN_FEET, is_given=False)


def _edge_names(grid: TrackGrid, keys: Mapping[str, int]) -> Iterator[tuple[str, tuple[Axis, int]]]:
    """Names of whole edges, for measured lengths."""
    for (upright, side), (first, *_) in grid.columns.items():
        yield f"upright {upright} / {side}", ("x", keys[first])
    for (section, beam, edge), (first, *_) in grid.rows.items():
        yield f"bay {section} / beam {beam} / {edge}", ("y", keys[first])


def _initial_grid(
    tracks: Sequence[Track], grid: TrackGrid, start: Trajectory, settings: GridSettings
) -> dict[str, Floats]:
    """The paper's start: an equally spaced grid on the face as long as the camera's path."""
    length = float(np.ptp(start.world_from_rig[:, 0, 3]))
    uprights = sorted({upright for upright, _ in grid.columns})
    along = dict(zip(uprights, np.linspace(0.0, length, len(uprights)).tolist(), strict=True))
    levels = {section: 1 + max(beam for number, beam, _ in grid.rows if number == section) for section in grid.sections}
    initial = {}
    for track in tracks:
        upright, side = column_of(track)
        depth, height = 0.0, TOP_M if track.place.get("end") == "top" else 0.0
        if track.label == "beam":
            section, beam, edge = row_of(track)
            depth, height = -settings.beam_setback_m, TOP_M * beam / levels[section] + 0.1 * (edge == "upper")
        initial[track.name] = np.array([along[upright] + 0.1 * (side == "right"), height, depth])
    return initial


def _initial_foot(foot: Track, grid: TrackGrid, initial: Mapping[str, Floats]) -> Floats:
    x = [initial[names[0]][0] for (upright, _), names in grid.columns.items() if upright == foot.place["upright"]]
    return np.array([np.mean(x) if x else 0.0, 0.0, 0.0])
