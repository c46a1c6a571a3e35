"""Tracking: from the features of all frames to labelled tracks of uprights' edges and beams' corners (paper, III.D)."""

import logging
from collections.abc import Iterator, Sequence

import numpy as np

from savmap.errors import StructureError
from savmap.types import Feature, Floats, Ints, Place, RowFacts, Track
from savmap_shelves.tracking.adjust import LEAST_SIGMA, EdgeObservations, predicted
from savmap_shelves.tracking.grid import FaceGrid, TrackingSettings, fit_grid
from savmap_shelves.tracking.sightings import CORNER_PARTS, UPRIGHT_PARTS

LEAST_TRAVEL = 0.2
BEAMS_BEYOND = 2
TOO_WIDE = 1.8
ALONG_GATE = 2.5
ENDS = ("top", "bottom")
_log = logging.getLogger(__name__)


def track_structures(
    features: Sequence[Feature],
    facts: RowFacts,
    settings: TrackingSettings | None = None,
    attitudes: Floats | None = None,
) -> list[Track]:
    """Number uprights, bays and beams through the row and gather the observations of each point.

    features: of all frames, as `extract_features` gives them. attitudes (n, 3, 3): world_from_rig of the frames, where
    they are known to a few degrees; without them the views are taken to face the rack. Raises StructureError where the
    frames do not show a row: none or too few uprights or beams, fewer than three frames, hardly any motion.
    """
    settings = settings or TrackingSettings()
    grid = fit_grid(features, facts, settings, attitudes)
    _require_motion(grid, facts)
    _warn_of_cut_sections(grid, facts)
    _warn_of_wide_sections(grid, facts)
    agreeing = _agreeing(grid, settings.gate)
    tracks = [*_upright_tracks(grid, agreeing), *_beam_tracks(grid, agreeing)]
    feet = grid.feet.tracks(grid.fit.states, grid.uprights.x, grid.levels.y)
    return [*(track for track in tracks if len(track.frames)), *feet]


def _require_motion(grid: FaceGrid, facts: RowFacts) -> None:
    shown = np.unique(grid.observations.frame)
    along = grid.fit.states[shown, 1] / grid.fit.states[shown, 0]
    distance = float(np.median(1 / grid.fit.states[shown, 0]))
    travelled = float(np.ptp(along)) / distance
    if travelled < LEAST_TRAVEL:
        raise StructureError(
            f"row {facts.name}: too little motion: the camera moved {travelled:.2f} of its distance from the face"
            f" ({LEAST_TRAVEL} are needed) while {len(grid.uprights.x)} uprights and {len(grid.levels.y)} beams were seen"
        )


def _warn_of_cut_sections(grid: FaceGrid, facts: RowFacts) -> None:
    """Warn where several beams go on beyond the first or the last upright in most frames that show it."""
    bounds = grid.uprights.beside(grid.sightings)
    last = len(grid.uprights.x) - 1
    for side, beyond, upright in (("left", bounds[:, 1] == 0, 0), ("right", bounds[:, 0] == last, last)):
        beams = np.bincount(grid.sightings.beam_frame[beyond], minlength=1)
        if (beams >= BEAMS_BEYOND).sum() > 0.5 * (grid.uprights.which == upright).sum():
            _log.warning(
                "row %s: beams go on beyond the outermost upright on the %s, which is seen only in part and not mapped",
                facts.name,
                side,
            )


def _warn_of_wide_sections(grid: FaceGrid, facts: RowFacts) -> None:
    """Warn where a bay is so much wider than the others that an upright in it may have been missed."""
    widths = np.diff(grid.uprights.x.mean(axis=1))
    for section in range(len(widths) if len(widths) > 1 else 0):
        times = widths[section] / np.median(np.delete(widths, section))
        if times > TOO_WIDE:
            _log.warning(
                "row %s: bay %d is %.1f times as wide as the others: an upright in it may have been missed",
                facts.name,
                section + 1,
                times,
            )


def _agreeing(grid: FaceGrid, gate: float) -> Ints:
    """Observations that agree with the fitted grid: within `gate` of the sigma expected, or of the spread usual here.

    Corners must agree along the beam too, less closely: that only shows a wrong upright, for the upright's edge is
    observed better.
    """
    upright, corner = (grid.observations.row == row for row in (0, 1))
    residual = np.abs(grid.fit.residual)
    along = np.zeros(len(residual))
    along[corner] = np.abs(_along_beams(grid))
    good = np.ones(len(residual), dtype=np.bool_)
    for values, kind, share in ((residual, upright, 1.0), (residual, corner, 1.0), (along, corner, ALONG_GATE)):
        spread = 1.4826 * float(np.median(values[kind])) if kind.any() else 1.0
        good[kind] &= values[kind] <= share * gate * max(1.0, spread)
    return np.flatnonzero(good)


def _along_beams(grid: FaceGrid) -> Floats:
    """For the corners among the observations, how far they are from their upright's edge, over their sigma."""
    corner = grid.observations.row == 1
    observations, source = grid.observations, grid.source[corner]
    section = grid.levels.section[(observations.edge[corner] - 2 * len(grid.uprights.x)) // 2]
    at_upright = EdgeObservations(
        observations.frame[corner],
        2 * section + 1 + _sides(grid)[source],
        np.zeros(len(source), dtype=np.int64),
        observations.p[corner],
        observations.q[corner],
        np.hypot(grid.sightings.face.sigma_p[source], LEAST_SIGMA),
    )
    return (at_upright.p - predicted(grid.fit.states, grid.fit.edges, at_upright)) / at_upright.sigma


def _sides(grid: FaceGrid) -> Ints:
    """Of each row in FeaturePoints that is a corner, its side (0: left, 1: right); -1 for other rows."""
    sides = np.full(len(grid.sightings.points.frame), -1)
    for side in (0, 1):
        rows = grid.sightings.corners[:, side]
        sides[rows[rows >= 0]] = side
    return sides


def _upright_tracks(grid: FaceGrid, agreeing: Ints) -> Iterator[Track]:
    """Tracks of both ends of each upright's edges."""
    ends = np.full(len(grid.sightings.points.frame), -1)
    ends[grid.sightings.uprights.reshape(-1, 2)] = [0, 1]
    for upright, side, end in np.ndindex(len(grid.uprights.x), 2, 2):
        rows = _rows_of(grid, agreeing, 2 * upright + side)
        name = f"upright {upright + 1} / {UPRIGHT_PARTS[side]} / {ENDS[end]}"
        place: Place = {"upright": upright + 1, "side": UPRIGHT_PARTS[side], "end": ENDS[end]}
        yield _track(grid, rows[ends[rows] == end], name, "upright", place)


def _beam_tracks(grid: FaceGrid, agreeing: Ints) -> Iterator[Track]:
    """Tracks of each beam's corners. Levels are sorted by bay, then height."""
    sides, sections = _sides(grid), grid.levels.section
    number = np.arange(len(sections)) - np.searchsorted(sections, sections)
    for level, side, edge in np.ndindex(len(sections), 2, 2):
        rows = _rows_of(grid, agreeing, 2 * (len(grid.uprights.x) + level) + edge)
        part = CORNER_PARTS[side][edge]
        section, beam = int(sections[level]) + 1, int(number[level]) + 1
        height, hand = part.split()
        place: Place = {"bay": section, "beam": beam, "side": hand, "edge": height}
        yield _track(grid, rows[sides[rows] == side], f"bay {section} / beam {beam} / {part}", "beam", place)


def _rows_of(grid: FaceGrid, agreeing: Ints, edge: int) -> Ints:
    """Rows in FeaturePoints of the agreeing observations of an edge."""
    rows: Ints = grid.source[agreeing[grid.observations.edge[agreeing] == edge]]
    return rows


def _track(grid: FaceGrid, rows: Ints, name: str, label: str, place: Place) -> Track:
    points = grid.sightings.points
    rows = rows[np.lexsort((points.view[rows], points.frame[rows]))]
    views = tuple(grid.sightings.names[index] for index in points.view[rows])
    return Track(name, label, place, points.frame[rows], views, points.pixels[rows], points.covariance[rows])
