"""Beams that seem the higher, the further above or below the camera they are: what shows below or above their faces is taken for a part of them.

Of a beam above the camera one sees the underside, of one below it the top. Where these, or a deck behind them, look like the face, the edge that is
measured is the one behind, and seems further off by its depth times the slope of the sight line: a beam 10 cm high and 5 cm deep is mapped 14 cm
high where one looks up at it at 40 degrees. Within a row that is plain to see, for its beams are of few profiles.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from savmap.types import Doubt, Floats, Structure
from savmap_shelves.mapping import sections_of

LEAST_BEAMS, LEAST_LEVELS = 6, 3
LEVEL_M, STEP_M, BEYOND_M = 0.1, 0.05, 0.5
RISE_M, UNEXPLAINED = 0.01, 0.4
ROUNDS, TIGHT_M = 8, 0.001


def beams_with_sides(structures: Sequence[Structure]) -> Iterator[Doubt]:
    """One line for a row whose beams' heights grow with their distance from one level, the camera's, by a centimetre or more, and vary little besides."""
    beams = [section.beams for section in sections_of(structures)]
    intervals = np.concatenate([np.zeros((0, 2)), *(group.intervals for group in beams)])
    ids = [name for group in beams for name in group.ids]
    level, height = intervals.mean(axis=1), np.diff(intervals, axis=1)[:, 0]
    if len(ids) < LEAST_BEAMS or len(np.unique(np.round(level / LEVEL_M))) < LEAST_LEVELS:
        return
    camera, face, rise, off = growing(level, height)
    usual_off = float(np.abs(height - np.median(height)).mean())
    most = rise * np.abs(level - camera)
    if np.percentile(most, 90) < RISE_M or off > UNEXPLAINED * usual_off:
        return
    worst = int(np.argmax(most))
    details = (
        f"they are the higher the further they are from {camera:.1f} m above the floor: {100 * face:.1f} cm there, {ids[worst]} {100 * height[worst]:.1f} cm",
        "lower edges above that and upper edges below it are off: undersides, tops or decks may be taken for faces",
    )
    wrong = tuple(name for name, error in zip(ids, most.tolist(), strict=True) if error >= RISE_M)
    figure, action = f"up to {100 * most.max():.1f} cm", f"compare with the pictures: {ids[worst]}"
    yield Doubt("shape", "beams seem higher far from the camera", wrong, None, None, False, figure, action, details)


def growing(level: Floats, height: Floats) -> tuple[float, float, float, float]:
    """The level, m, from which on heights (n,) of beams at levels (n,) grow both ways, the height there, how much they grow for each metre, 0 or more,
    and by how much they differ from that on average."""
    best = (float(np.median(level)), float(np.median(height)), 0.0, float(np.abs(height - np.median(height)).mean()))
    for camera in np.arange(level.min() - BEYOND_M, level.max() + BEYOND_M, STEP_M):
        away = np.stack([np.ones_like(level), np.abs(level - camera)], axis=1)
        weight: Floats = np.ones(len(level))
        fitted: Floats = np.zeros(2)
        for _ in range(ROUNDS):
            fitted = np.asarray(np.linalg.lstsq(away * weight[:, None], height * weight, rcond=None)[0], np.float64)
            off = np.abs(away @ fitted - height)
            spread = max(1.48 * float(np.median(off)), TIGHT_M)
            weight = np.sqrt(1 / np.maximum(1.0, off / (2 * spread)))
        if fitted[1] > 0 and off.mean() < best[3]:
            best = float(camera), float(fitted[0]), float(fitted[1]), float(off.mean())
    return best
