"""Whether the end of a lit strip is hidden by something that runs across it, such as a pipe below the lamp."""

import numpy as np

from savmap.plugin import Floats
from savmap_lights.picture.profiles import BEYOND_PX, SHARP_PX, STEEP_STEPS, STEP_PX, Singles, profile_of, sampled

BESIDE_PX, COVERS, SAME_PX = 3.0, 8.0, 2.0
ALIKE = 12.0
FLANK_PX = np.linspace(0, 2 * BESIDE_PX, 5)


def is_covered(grey: Singles, middle: Floats, axis: Floats, width: float, at: float, outward: int) -> bool:
    """Whether something that runs across hides a strip where it ends, `outward` (+-1) along the axis: the brightness
    changes sharply beside the strip too, on both sides, and is alike beyond the end. Before what runs behind it, a
    lamp's housing or glow shows there."""
    reach = SHARP_PX / 2 + SAME_PX
    flanks = _flanks(grey, middle, axis, width, at + np.arange(-reach, reach + 0.01, STEP_PX))
    steps = np.abs(flanks[:, STEEP_STEPS:] - flanks[:, :-STEEP_STEPS]).max(axis=1)
    return bool(steps.min() >= COVERS) and _goes_on_across(grey, middle, axis, width, at, outward)


def _flanks(grey: Singles, middle: Floats, axis: Floats, width: float, along: Floats) -> Floats:
    """Brightness (2, n) beside a strip, on either side, at places along it."""
    sideways = 0.5 * width + max(BESIDE_PX, 0.25 * width) + FLANK_PX
    values = sampled(grey, middle, axis, along, np.concatenate([-sideways, sideways]))
    return np.asarray(values.reshape(-1, 2, len(sideways)).mean(axis=2).T)


def _goes_on_across(grey: Singles, middle: Floats, axis: Floats, width: float, at: float, outward: int) -> bool:
    """Whether what lies across beside a strip's end looks alike beyond the end, somewhere."""
    before = at - outward * np.arange(SHARP_PX, SHARP_PX + BEYOND_PX, STEP_PX)
    beyond = at + outward * np.arange(SAME_PX, BEYOND_PX, STEP_PX)
    ahead = profile_of(grey, middle, axis, beyond, 0.25 * width)
    flanks = _flanks(grey, middle, axis, width, beyond)
    before_end = np.median(_flanks(grey, middle, axis, width, before), axis=1)
    across = (np.abs(flanks - before_end[:, None]) >= COVERS / 2).any(axis=0)
    alike = (ahead >= flanks.min(axis=0) - ALIKE) & (ahead <= flanks.max(axis=0) + ALIKE)
    return bool((across & alike).any() or not across.any())
