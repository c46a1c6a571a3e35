"""Lamps through the sequence: sightings put on the ceiling plane from the camera's first positions, then grouped.

Paper, section III.D. The height of the lamps is the one at which the sightings of all frames fall on one another best.
"""

from collections.abc import Sequence

import numpy as np

from savmap.plugin import (
    UPWARDS,
    Feature,
    Floats,
    RowFacts,
    Sightings,
    StructureError,
    Track,
    Trajectory,
    frames_showing,
    gathering_level,
    sightings,
    track_of,
)
from savmap.vision import peaks

MIN_SUPPORT = 3
MAX_SLOPE = 3.0
HEIGHTS_M = (0.5, 20.0)
SAME_LAMP_M = 0.3
SAME_LINE_M = 0.4
LEAST_SHARE = 0.4
SURE = 0.2


def track_lamps(features: Sequence[Feature], facts: RowFacts, start: Trajectory) -> list[Track]:
    """Tracks "light 3 / end 0" and "light 3 / end 1" (towards +x) of strips, "light 3 / centre" of compact lamps.

    Lamps are those of the line nearest above the camera's path, numbered along x from 1.
    Raises StructureError when no lamp is seen in at least three frames.
    """
    seen = sightings(features, facts, start, upwards=True, max_slope=MAX_SLOPE)
    centres = seen.where(seen.of_part("centre"))
    if len(centres.frames) < MIN_SUPPORT:
        raise _no_lamp()
    height_m = gathering_level(centres, HEIGHTS_M)
    seen, line_z = _nearest_line(seen, height_m)
    x, is_centre = seen.at(height_m)[:, 0], seen.of_part("centre")
    lamps = peaks.peaks(x[is_centre], SAME_LAMP_M, MIN_SUPPORT)
    hits = np.array([len(np.unique(seen.frames[is_centre & (np.abs(x - lamp) <= SAME_LAMP_M)])) for lamp in lamps])
    places = np.array([[lamp, height_m, line_z] for lamp in lamps]).reshape(-1, 3)
    shown = frames_showing(places, facts, start, UPWARDS[:, 2])
    lamps = lamps[hits >= LEAST_SHARE * shown]
    if len(lamps) == 0:
        raise _no_lamp()
    return [track for number, at in enumerate(lamps, start=1) for track in _tracks(number, at, lamps, seen, x)]


def _no_lamp() -> StructureError:
    return StructureError(
        "no lamp was seen in three frames or more: does the ceiling view show lamps, and was the network trained on such?"
    )


def _nearest_line(seen: Sightings, height_m: float) -> tuple[Sightings, float]:
    """The sightings of the line of lamps, parallel to x, that runs nearest above the camera, and its z."""
    z = seen.at(height_m)[:, 1]
    sure = seen.of_part("centre") & (seen.certainty >= SURE)
    lines = peaks.peaks(z[sure], SAME_LINE_M, max(MIN_SUPPORT, int(sure.sum() / 10)))
    if len(lines) == 0:
        raise _no_lamp()
    nearest = float(lines[np.argmin(np.abs(lines - np.median(seen.origins[:, 2])))])
    return seen.where(np.abs(z - nearest) <= SAME_LINE_M), nearest


def _tracks(number: int, at: float, lamps: Floats, seen: Sightings, x: Floats) -> list[Track]:
    spacing = float(np.diff(lamps).min()) if len(lamps) > 1 else 2.0
    near, is_centre = np.abs(x - at) < 0.5 * spacing, seen.of_part("centre")
    ends = near & ~is_centre
    sides = [ends & (x < at), ends & (x > at)]
    if min(int(side.sum()) for side in sides) >= MIN_SUPPORT:
        return [track_of(number, f"end {end}", seen.where(side).features) for end, side in enumerate(sides)]
    return [track_of(number, "centre", seen.where(near & is_centre).features)]
