"""Perspective: the edges of a picture's strips lead to a common vanishing point (paper, section III.C, step 3).

Lines through a common vanishing point obey slope = level + turn v(0), v(0) being where they cross u = 0.
"""

from dataclasses import dataclass, replace

import numpy as np

from savmap.geometry.lines import Lines, convergence
from savmap.types import Bools, Floats
from savmap_shelves.boundaries.settings import BoundarySettings
from savmap_shelves.boundaries.strips import Borders, Strips, fitted

LEAST_STRIPS = 5
LEAST_LENGTH_PX = 40.0
MOST_TAPER = 3.0


@dataclass(frozen=True)
class Perspective:
    """The vanishing point that strips have in common, as `level` and `turn` of their slopes."""

    level: float
    turn: float

    def slope_at(self, u: Floats, v: Floats) -> Floats:
        """Slope of the line through (u, v) and the vanishing point."""
        return (self.level + self.turn * v) / (1 + self.turn * u)

    def astray(self, lines: Lines, tolerance: float) -> Bools:
        """Which lines do not lead there, as judged in the middle of their points."""
        middle = (lines.first + lines.last) / 2
        return np.abs(lines.slope - self.slope_at(middle, lines.at(middle))) > tolerance


def askew(strips: Strips, shape: tuple[float, float], settings: BoundarySettings) -> Bools:
    """Which strips' edges, extended, meet within the picture plane enlarged by `plane_margin` in each dimension (p,).

    `shape` is the picture's size along u and along v. This is published, with two exceptions: edges may meet as far as
    their fit's noise explains it, and what converges as all strips of the picture do is in perspective, not askew.
    """
    slack = settings.plane_margin / 2
    ends = np.array([[-slack], [1 + slack]]) * shape[0]
    middle = (strips.first + strips.last) / 2
    gap = strips.lower.at(ends) - strips.upper.at(ends)
    in_perspective = gap - _slope_apart(strips) * (ends - middle)
    noise = np.sqrt(strips.lower.variance_at(ends) + strips.upper.variance_at(ends))
    meets = np.maximum(gap, in_perspective) < -settings.askew_sigmas * noise
    nearer = strips.thickness / np.maximum(strips.thickness - gap, 1e-9)
    at = strips.upper.at(middle + nearer * (ends - middle))
    in_plane = (at > -slack * shape[1]) & (at < (1 + slack) * shape[1])
    return np.asarray((meets & in_plane).any(axis=0))


def crossed(strips: Strips, ends: Floats) -> Bools:
    """Which strips (p,), extended to `ends` (p, 2), are much thinner or thicker there than in the middle."""
    share = (strips.lower.column.at(ends) - strips.upper.column.at(ends)) / strips.thickness[:, None]
    return np.asarray(((share < 1 / MOST_TAPER) | (share > MOST_TAPER)).any(axis=1))


def paralleled(strips: Strips, settings: BoundarySettings) -> Strips:
    """Strips with a prior on the difference of their edges' slopes: that of the picture's perspective, `parallel_sigma`.

    It steadies short strips and hardly changes long ones.
    """
    upper, lower = strips.upper, strips.lower
    total = upper.slope_var + lower.slope_var + settings.parallel_sigma**2
    surprise = (lower.slope - upper.slope - _slope_apart(strips)) / total
    steady = [
        replace(
            line,
            slope=line.slope + sign * line.slope_var * surprise,
            slope_var=line.slope_var * (1 - line.slope_var / total),
        )
        for line, sign in ((upper, 1), (lower, -1))
    ]
    return replace(strips, upper=steady[0], lower=steady[1])


def steadied(strips: Strips, borders: Borders, settings: BoundarySettings) -> Strips:
    """Strips, those that do not lead to the common vanishing point fitted again so that they do.

    Masks that are too wide or cut obliquely by goods mislead lines. Nothing is changed if a picture has no clear vanishing
    point. Edges that still lead elsewhere lose their support.
    """
    common = _common_point(strips, settings.perspective_tolerance)
    if common is None:
        return strips
    bound = settings.perspective_tolerance
    wrong = np.flatnonzero(common.astray(strips.upper, bound) | common.astray(strips.lower, bound))
    if not len(wrong):
        return strips
    middle = ((strips.first + strips.last) / 2)[wrong]
    slopes = common.slope_at(middle, _middle(strips)[wrong].at(middle))
    again = fitted(borders.of(wrong), strips.cell[wrong], settings, slopes)
    upper, lower = (_drawn_to(lines, slopes, bound) for lines in (again.upper, again.lower))
    return strips.replaced(wrong, replace(again, upper=upper, lower=lower))


def _drawn_to(lines: Lines, slopes: Floats, sigma: float) -> Lines:
    """Lines with a prior on their slopes (g,); those that still differ by more than `sigma` lose their support."""
    share = lines.slope_var / (lines.slope_var + (sigma / 3) ** 2)
    slope = lines.slope + share * (slopes - lines.slope)
    inliers = np.where(np.abs(slope - slopes) > sigma, 0.0, lines.inliers)
    return replace(lines, slope=slope, slope_var=lines.slope_var * (1 - share), inliers=inliers)


def _common_point(strips: Strips, tolerance: float) -> Perspective | None:
    """The vanishing point that most long strips lead to; None where the picture has no clear one."""
    sound = strips[strips.two_edged & (strips.length >= LEAST_LENGTH_PX)]
    if len(sound) < LEAST_STRIPS:
        return None
    clear = _middle(sound[np.argsort(-sound.length, kind="stable")[: max(LEAST_STRIPS, 2 * len(sound) // 3)]])
    turn = convergence(clear)
    levels = clear.slope - turn * clear.at_zero
    level = float(np.median(levels))
    return Perspective(level, turn) if np.median(np.abs(levels - level)) < tolerance / 2 else None


def _slope_apart(strips: Strips) -> Floats:
    """The slope of lower less that of upper edges (p,) that the common vanishing point of all strips asks for."""
    return convergence(_middle(strips)) * (strips.lower.at_zero - strips.upper.at_zero)


def _middle(strips: Strips) -> Lines:
    """The strips' middle lines (p,), without variances."""
    upper, lower = strips.upper, strips.lower
    slope = (upper.slope + lower.slope) / 2
    zero = np.zeros(len(strips))
    return Lines(
        zero, slope, (upper.at_zero + lower.at_zero) / 2, zero, zero, strips.first, strips.last, strips.columns
    )
