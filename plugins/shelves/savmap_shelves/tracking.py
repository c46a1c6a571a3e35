"""Tracking: from the features of all frames to labelled tracks of uprights' edges and beams' corners (paper, III.D)."""

import logging
from collections import Counter
from collections.abc import Sequence

import numpy as np

from savmap.errors import StructureError
from savmap.types import Feature, Floats, Ints, RowFacts, Track
from savmap_shelves.adjust import FLOOR, Sighted, predicted
from savmap_shelves.face import Grid, Settings, fit_grid
from savmap_shelves.feet import foot_tracks
from savmap_shelves.sightings import CORNER_PARTS, UPRIGHT_PARTS

LEAST_TRAVEL = 0.2
BEAMS_BEYOND = 2
ALONG_GATE = 2.5
ENDS = ("top", "bottom")
_log = logging.getLogger(__name__)


def track_structures(
    features: Sequence[Feature], facts: RowFacts, settings: Settings | None = None, attitudes: Floats | None = None
) -> list[Track]:
    """Number uprights, sections and beams through the row and gather every point's observations.

    features: of all frames, as `extract_features` gives them. attitudes (n, 3, 3): world_from_rig of the frames, where
    they are known to a few degrees; without them the views are taken to look at the face. Raises StructureError where the
    frames do not show a row: none or too few uprights or beams, fewer than three frames, hardly any motion.
    """
    settings = settings or Settings()
    grid = fit_grid(features, facts, settings, attitudes)
    _require_motion(grid, facts)
    _report_part(grid, facts)
    elements = [*_upright_tracks(grid, settings.gate), *_beam_tracks(grid, settings.gate)]
    return [*elements, *foot_tracks(grid)]


def summary(tracks: Sequence[Track]) -> dict[str, int | str]:
    """Figures for reports: sections, uprights, beams, levels in each section, and the observations of an element."""
    uprights = _observed(tracks, "upright", ("upright",))
    beams = _observed(tracks, "beam", ("section", "beam"))
    levels = Counter(place[0] for place in beams)
    sections = range(1, max(len(uprights), 1))
    return {
        "sections": len(sections),
        "uprights": len(uprights),
        "beams": len(beams),
        "levels": ", ".join(str(levels[section]) for section in sections),
        "observations of an upright, least": min(uprights.values(), default=0),
        "observations of an upright, median": int(np.median(list(uprights.values()) or [0])),
        "observations of a beam, least": min(beams.values(), default=0),
        "observations of a beam, median": int(np.median(list(beams.values()) or [0])),
    }


def _observed(tracks: Sequence[Track], label: str, keys: tuple[str, ...]) -> dict[tuple[int, ...], int]:
    """For each thing of a class, the largest number of frames and views in which one of its points was seen."""
    counts: dict[tuple[int, ...], int] = {}
    for track in tracks:
        if track.label == label:
            place = tuple(int(track.place[key]) for key in keys)
            counts[place] = max(counts.get(place, 0), len(track.frames))
    return counts


def _require_motion(grid: Grid, facts: RowFacts) -> None:
    shown = np.unique(grid.observations.frame)
    along = grid.fit.states[shown, 1] / grid.fit.states[shown, 0]
    distance = float(np.median(1 / grid.fit.states[shown, 0]))
    travelled = float(np.ptp(along)) / distance
    if travelled < LEAST_TRAVEL:
        raise StructureError(
            f"row {facts.name}: too little motion: the camera moved {travelled:.2f} of its distance from the face"
            f" ({LEAST_TRAVEL} are needed) while {len(grid.uprights.x)} uprights and {len(grid.levels.y)} beams were seen"
        )


def _report_part(grid: Grid, facts: RowFacts) -> None:
    """Warn where several beams go on beyond the first or the last upright in most frames that show it."""
    bound = np.where(grid.seen.bounds >= 0, np.append(grid.uprights.which, -1)[grid.seen.bounds], -1)
    last = len(grid.uprights.x) - 1
    for side, beyond, upright in (("left", bound[:, 1] == 0, 0), ("right", bound[:, 0] == last, last)):
        beams = np.bincount(grid.seen.beam_frame[beyond], minlength=1)
        if (beams >= BEAMS_BEYOND).sum() > 0.5 * (grid.uprights.which == upright).sum():
            _log.warning(
                "row %s: beams go on beyond the outermost upright on the %s, which is seen only in part and not mapped",
                facts.name,
                side,
            )


def _honest(grid: Grid, gate: float) -> Ints:
    """Observations that agree with the fitted grid: within `gate` of the sigma expected, or of the spread usual here.

    Corners must agree along the beam too, less closely: that only shows a wrong upright, for the upright's own edge is
    observed better.
    """
    upright, corner = (grid.observations.row == row for row in (0, 1))
    residual = np.abs(grid.fit.residual)
    along = np.zeros(len(residual))
    along[corner] = np.abs(_along_beams(grid))
    good = np.ones(len(residual), dtype=np.bool_)
    for values, mine, share in ((residual, upright, 1.0), (residual, corner, 1.0), (along, corner, ALONG_GATE)):
        spread = 1.4826 * float(np.median(values[mine])) if mine.any() else 1.0
        good[mine] &= values[mine] <= share * gate * max(1.0, spread)
    return np.flatnonzero(good)


def _along_beams(grid: Grid) -> Floats:
    """For the corners among the observations, how far they are from their upright's edge, over their sigma."""
    corner = grid.observations.row == 1
    seen, source = grid.observations, grid.source[corner]
    level = grid.levels.section[(seen.edge[corner] - 2 * len(grid.uprights.x)) // 2]
    edge = 2 * level + 1 + _side_of(grid)[source]
    at_upright = Sighted(
        seen.frame[corner],
        edge,
        np.zeros(len(source), dtype=np.int64),
        seen.p[corner],
        seen.q[corner],
        np.hypot(grid.face.sigma_p[source], FLOOR),
    )
    apart: Floats = (at_upright.p - predicted(grid.fit.states, grid.fit.edges, at_upright)) / at_upright.sigma
    return apart


def _side_of(grid: Grid) -> Ints:
    """Of each row in Pixels that is a corner, its side (0: left, 1: right); -1 for other rows."""
    side_of = np.full(len(grid.seen.points.frame), -1)
    for side in (0, 1):
        rows = grid.seen.corners[:, side]
        side_of[rows[rows >= 0]] = side
    return side_of


def _upright_tracks(grid: Grid, gate: float) -> list[Track]:
    honest = _honest(grid, gate)
    end_of = np.full(len(grid.seen.points.frame), -1)
    end_of[grid.seen.uprights.reshape(-1, 2)] = [0, 1]
    tracks = []
    for upright in range(len(grid.uprights.x)):
        for side, end in np.ndindex(2, 2):
            mine = honest[grid.observations.edge[honest] == 2 * upright + side]
            rows = grid.source[mine]
            rows = rows[end_of[rows] == end]
            name = f"upright {upright + 1} / {UPRIGHT_PARTS[side]} / {ENDS[end]}"
            place: dict[str, int | str] = {"upright": upright + 1, "side": UPRIGHT_PARTS[side], "end": ENDS[end]}
            tracks.append(_track(grid, rows, name, "upright", place))
    return [track for track in tracks if len(track.frames)]


def _beam_tracks(grid: Grid, gate: float) -> list[Track]:
    honest, side_of = _honest(grid, gate), _side_of(grid)
    base, tracks = 2 * len(grid.uprights.x), []
    for level, (section, beam) in enumerate(_numbered(grid.levels.section)):
        for side, edge in np.ndindex(2, 2):
            mine = honest[grid.observations.edge[honest] == base + 2 * level + edge]
            rows = grid.source[mine]
            rows = rows[side_of[rows] == side]
            part = CORNER_PARTS[side][edge]
            height, hand = part.split()
            place: dict[str, int | str] = {"section": section, "beam": beam, "side": hand, "edge": height}
            name = f"section {section} / beam {beam} / {height} {hand}".replace(f"{height} {hand}", part)
            tracks.append(_track(grid, rows, name, "beam", place))
    return [track for track in tracks if len(track.frames)]


def _numbered(sections: Ints) -> list[tuple[int, int]]:
    """Section and beam from 1 of levels that are sorted by section, then height."""
    first = np.searchsorted(sections, sections)
    return [(int(s) + 1, int(k - f) + 1) for k, (s, f) in enumerate(zip(sections, first, strict=True))]


def _track(grid: Grid, rows: Ints, name: str, label: str, place: dict[str, int | str]) -> Track:
    points = grid.seen.points
    rows = rows[np.lexsort((points.view[rows], points.frame[rows]))]
    views = tuple(grid.seen.names[index] for index in points.view[rows])
    return Track(name, label, place, points.frame[rows], views, points.pixels[rows], points.covariance[rows])
