"""The lamps of a row, as objects to be measured in the pictures: the ceiling's height, its lines, and their lamps."""

from collections.abc import Iterator

import numpy as np

from savmap.plugin import Floats, FoundObject, Gather, PlaneEvidence, PlanePatch, RowFacts, StructureError, Trajectory
from savmap_lights.lamp_model import Lamp, LampReader, Line, agreement
from savmap_lights.likelihood import fitted

HEIGHTS, STEP, NEAR, HALVINGS = (0.5, 14.0), 1.1, 13, 3
"""Heights above the camera that are tried, as shares of its distance from the face, the ratio of each to the next, how
many are tried about a good one, and how often the step between these is halved."""
RIVAL = 0.7
"""Peaks at which frames agree at least so much as at the highest one are looked at more closely."""
COARSE, MIDDLE, FINE = 1 / 80, 1 / 160, 1 / 400
"""Sides of cells for finding the height, and for the lamps, as shares of the height."""
ACROSS, BEYOND = 1.2, 0.8
"""How far beside and beyond the camera's path the ceiling is read, as shares of the height."""
LEAST_SHOWN = 0.01
"""Cells that were seen less than this share of the usual are taken for unseen."""
LIKELY = 0.5
"""Lamps that are more likely than this are numbered and mapped."""


def find(gather: Gather, path: Trajectory, facts: RowFacts) -> list[FoundObject]:
    """Lamps "light 1" ... along x, of the line nearest above the camera's path and before the face, and what may exist
    beside them. Raises StructureError where no line of lamps shows."""
    height = lamp_height(gather, path)
    patch = ceiling_patch(path, height, FINE)
    reader = reader_of(gather(patch), height)
    camera = float(np.median(path.world_from_rig[:, 2, 3]) - patch.origin[2])
    places = sorted(reader.lines(), key=lambda line: abs((line.low + line.high) / 2 - camera))
    line = next((line for line in map(reader.read, places) if any(map(is_likely, line.lamps))), None)
    if line is None:
        raise StructureError(f"row {facts.name}: no line of lamps shows above the camera's path in all frames together")
    return [*_objects(line, patch)]


def is_likely(lamp: Lamp) -> bool:
    """Whether a lamp is numbered and mapped."""
    return lamp.probability >= LIKELY


def ceiling_patch(path: Trajectory, height: float, cell: float) -> PlanePatch:
    """The level plane at a height above the camera, about its path and before the face, in cells whose side is a share
    of the height."""
    places = path.world_from_rig[:, :3, 3]
    _, y, z = np.median(places, axis=0).tolist()
    first, last = places[:, 0].min() - BEYOND * height, places[:, 0].max() + BEYOND * height
    nearest = max(z - ACROSS * height, 0.0)
    origin = np.array([first, y + height, nearest])
    size = np.array([last - first, z + ACROSS * height - nearest])
    return PlanePatch("ceiling", origin, np.eye(3)[0], np.eye(3)[2], size, cell * height)


def lamp_height(gather: Gather, path: Trajectory) -> float:
    """The height above the camera at which the frames agree most on where lamps are; the least where they show none."""

    def agreed(height: float, cell: float) -> float:
        return agreement(gather(ceiling_patch(path, height, cell), picture=False), "light")

    distance = float(np.median(path.world_from_rig[:, 2, 3]))
    count = int(np.log(HEIGHTS[1] / HEIGHTS[0]) / np.log(STEP))
    tried = HEIGHTS[0] * distance * STEP ** np.arange(count)
    coarse = np.array([agreed(height, COARSE) for height in tried.tolist()])
    least = max(RIVAL * coarse.max(), np.finfo(float).tiny)
    highest = (coarse >= np.roll(coarse, 1)) & (coarse >= np.roll(coarse, -1)) & (coarse >= least)
    peaks: dict[float, float] = {}
    for peak in tried[highest].tolist():
        best = max(peak * STEP ** np.linspace(-1, 1, NEAR), key=lambda height: agreed(height, MIDDLE))
        for halving in range(HALVINGS):
            step = STEP ** (0.5**halving / (NEAR - 1))
            best = max((best, best * step, best / step), key=lambda height: agreed(height, MIDDLE))
        peaks[best] = agreed(best, MIDDLE)
    return max(peaks, key=lambda height: peaks[height], default=float(tried[0]))


def reader_of(evidence: PlaneEvidence, height: float) -> LampReader:
    """What reads the lines and lamps in a ceiling's evidence, the lowest row first."""
    shown = evidence.weight > LEAST_SHOWN * np.median(evidence.weight[evidence.weight > 0])
    mean = np.asarray(evidence.of("light")[::-1], np.float64)
    bright = np.asarray(evidence.picture[::-1].mean(axis=2), np.float64)
    cell = evidence.patch.cell
    return LampReader(mean, bright, shown[::-1], cell / height, cell, fitted())


def _objects(line: Line, patch: PlanePatch) -> Iterator[FoundObject]:
    mapped = [lamp for lamp in line.lamps if is_likely(lamp)]
    for number, lamp in enumerate(mapped, 1):
        yield _object(f"light {number}", lamp, line, patch)
    others = [lamp for lamp in (*line.lamps, *line.possible) if not is_likely(lamp)]
    places = [_where(lamp, mapped) for lamp in others]
    for number, (lamp, place) in enumerate(zip(others, places, strict=True)):
        yield _object(f"{place}, {places[: number + 1].count(place)}", lamp, line, patch)


def _where(lamp: Lamp, mapped: list[Lamp]) -> str:
    """Where a lamp that is not mapped would be among those that are."""
    before = sum(other.low < lamp.low for other in mapped)
    return f"after light {before}" if before else "before light 1"


def _object(name: str, lamp: Lamp, line: Line, patch: PlanePatch) -> FoundObject:
    return FoundObject(name, "light", outline_of(patch, (lamp.low, lamp.high), (line.low, line.high)), lamp.probability)


def outline_of(patch: PlanePatch, x: tuple[float, float], z: tuple[float, float]) -> Floats:
    """The corners (4, 3) of a rectangle of a patch: both of its first end, then both of its second."""
    corners = np.array([[x[0], z[0]], [x[1], z[0]], [x[1], z[1]], [x[0], z[1]]])
    return np.asarray(patch.origin + corners[:, :1] * patch.right + corners[:, 1:] * patch.up)
