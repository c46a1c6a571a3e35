"""Lamps above an aisle as one probabilistic model: lines along the aisle, and lamps along each line.

Both are the best set of intervals on the evidence of all frames (savmap.vision.evidence.intervals), in the level plane
where that evidence is sharpest. Lengths are in cells, counted from the patch's lower left corner.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import grey_closing, uniform_filter1d
from scipy.special import expit

from savmap.plugin import Bools, Floats, Ints, PlaneEvidence
from savmap.vision.evidence.intervals import Intervals, best_intervals, interval_scores
from savmap_lights.likelihood import LampParameters

LEAST, WIDEST = 2, 0.35
"""Cells of the narrowest lamp, and the width across of the widest, as a share of the height."""
LONGER = 1.03
"""Lengths that are tried grow by this ratio."""
SURE, ROUNDS = 5.0, 2
"""A lamp that scores more tells the usual length; of reading a line, each with what the one before gave."""
NEAR, LEAST_DIP, JOINT = 0.02, 0.5, 50.0
"""Of joints: to what distance brightness is compared, as a share of the height; the least noise of it, grey levels; and
what a joint says against a lamp across it, nats a cell."""
EXCEPTION, SIGNIFICANT = 0.1, 12.0
"""The share of joints that do not show, and the score from which on evenly spaced ones are there."""
STRETCH = 0.025
"""How long a stretch tells that a line may be there, as a share of the height."""
BRIGHT = 0.9
"""The quantile of a lamp's brightness that tells whether it shines."""
POSSIBLE = 0.01
"""What is less likely is absent."""


@dataclass(frozen=True)
class Lamp:
    """A lamp's extent along the line, in the patch's coordinates, and how likely it exists."""

    low: float
    high: float
    probability: float


@dataclass(frozen=True, eq=False)
class Line:
    """A line of lamps: its extent across the aisle, in the patch's coordinates, and its lamps; some are only
    possible."""

    low: float
    high: float
    lamps: tuple[Lamp, ...] = ()
    possible: tuple[Lamp, ...] = ()


def agreement(evidence: PlaneEvidence, label: str) -> float:
    """How much the frames agree on a plane: most on that of the lamps.

    It is the share of the frames' scores that other frames confirm, times how sharp the mean is along the aisle. With n
    frames a cell, whose scores s are nearly 0 or 1 and have the mean m, the mean of s_f s_g over all pairs of different
    frames is (n m^2 - m) / (n - 1). In lines of light only the joints tell the height: there the mean is sharp.
    """
    mean, weight, views = (
        values.astype(np.float64) for values in (evidence.of(label), evidence.weight, evidence.views)
    )
    total = float((weight * mean).sum())
    if total <= 0:
        return 0.0
    several = views > 1.5
    confirmed = weight * (views * mean**2 - mean) / np.where(several, views - 1, 1.0)
    change = (mean[:, 2:] - mean[:, :-2]) * several[:, 2:] * several[:, :-2]
    return max(float(confirmed[several].sum()), 0.0) * float((weight[:, 1:-1] * change**2).sum()) / total**2


@dataclass(frozen=True, eq=False)
class LampReader:
    """Reads the lines of a ceiling, and the lamps of a line, in the mean scores (rows, columns) of cells, the lowest
    row first, how `bright` these are (rows, columns), 0..255, and which were `shown` (rows, columns). cell: their side
    as a share of the lamps' height above the camera; unit: their side in the patch's unit."""

    mean: Floats
    bright: Floats
    shown: Bools
    cell: float
    unit: float
    parameters: LampParameters

    def ratios(self) -> Floats:
        return np.where(self.shown, self.parameters.ratios(self.mean), 0.0)

    def lines(self) -> list[Line]:
        """Where lines of lamps may be: neighbouring rows in which some stretch is more likely a lamp than not."""
        stretch = max(1, round(STRETCH / self.cell))
        likely = uniform_filter1d(self.ratios(), stretch, axis=1).max(axis=1) > 0
        changes = np.flatnonzero(np.diff(np.concatenate([[False], likely, [False]]).astype(np.int8)))
        runs = changes.reshape(-1, 2)
        return [Line(low * self.unit, high * self.unit) for low, high in runs.tolist() if high - low >= LEAST]

    def read(self, line: Line) -> Line:
        """A line with its lamps, but for those of which an end is out of sight; as wide as its lamps are."""
        low, high = round(line.low / self.unit), round(line.high / self.unit)
        lamps = self._lamps(low, high)
        if not len(lamps.cells):
            return line
        low, high = self._across(np.concatenate([np.arange(*cells) for cells in lamps.cells.tolist()]), low, high)
        lamps = self._lamps(low, high)
        line = Line(low * self.unit, high * self.unit)
        profile = np.where(self.shown[low:high], self.mean[low:high], 0.0).mean(axis=0)
        rooms = zip([0, *lamps.cells[:-1, 1].tolist()], [*lamps.cells[1:, 0].tolist(), len(profile)], strict=True)
        places = zip(lamps.cells.tolist(), rooms, lamps.existing.tolist(), strict=True)
        read_lamps = tuple(self._lamp(profile, (low, high), cells, room, likely) for cells, room, likely in places)
        others = tuple(
            Lamp(first * self.unit, last * self.unit, likely) for first, last, likely in lamps.others(POSSIBLE)
        )
        first, last = np.flatnonzero(self.shown[low:high].any(axis=0))[[0, -1]].tolist()
        inside, others = (
            tuple(lamp for lamp in each if (first + 1) * self.unit < lamp.low and lamp.high < last * self.unit)
            for each in (read_lamps, others)
        )
        return replace(line, lamps=inside, possible=others)

    def _lamps(self, low: int, high: int) -> Intervals:
        """The lamps between two rows."""
        ratios = self.ratios()[low:high].T
        joints = self._joints(low, high, ratios.mean(axis=1))
        ratios, gap = ratios + joints[:, None], 1 if joints.any() else max(1, round(self.parameters.gap / self.cell))
        widths = lengths(len(ratios))
        shown = interval_scores(ratios, widths, self.parameters.occlusion(self.cell))
        usual: float | None = None
        for _ in range(ROUNDS):
            prior = self.parameters.lamp + self._profile(widths, usual)
            (lamps,) = best_intervals([shown + prior], widths, gap)
            sure = np.diff(lamps.cells, axis=1)[lamps.score > SURE, 0]
            if not len(sure):
                break
            usual = float(np.median(sure))
        return lamps

    def _across(self, columns: Ints, low: int, high: int) -> tuple[int, int]:
        """The rows (first, last + 1), about those of a line, at which its lamps' columns show most."""
        widths = np.arange(LEAST, round(WIDEST / self.cell))
        scores = interval_scores(self.ratios()[:, columns], widths, self.parameters.occlusion(self.cell))
        first = np.arange(len(scores))[:, None]
        about = (first < high) & (first + widths > low)
        row, width = np.unravel_index(int(np.where(about, scores, -np.inf).argmax()), scores.shape)
        return int(row), int(row + widths[width])

    def _lamp(
        self, profile: Floats, rows: tuple[int, int], cells: Sequence[int], room: tuple[int, int], likely: float
    ) -> Lamp:
        low, high = (self.unit * borders(profile, cells[0], cells[1], room)).tolist()
        return Lamp(low, high, likely * self._shines(rows, cells))

    def _shines(self, rows: tuple[int, int], columns: Sequence[int]) -> float:
        """How likely what is so bright is a lamp: these are the brightest things above an aisle. Where something hides
        a part of it, the rest tells."""
        usual, spread = self.parameters.shines
        share = float(np.quantile(self.bright[slice(*rows), slice(*columns)], BRIGHT)) / float(self.bright.max())
        return float(expit((share - usual) / spread))

    def _joints(self, low: int, high: int, ratios: Floats) -> Floats:
        """Log-likelihood ratios (columns,), 0 but at joints of a line of light: strips that are hung end to end are a
        little darker there only, in some frames, but at even distances."""
        near = round(NEAR / self.cell)
        lit = grey_closing(ratios, (2 * near + 1,)) > 0
        against = np.zeros(len(ratios))
        if not lit.any():
            return against
        profile = self.bright[low:high].mean(axis=0)
        dips = (np.roll(profile, near) + np.roll(profile, -near)) / 2 - profile
        dips -= np.median(dips[lit])
        usual = max(1.48 * float(np.median(np.abs(dips[lit]))), LEAST_DIP)
        for place in evenly_spaced(uniform_filter1d(dips, near) > usual, lit, 4 * near):
            against[max(place - near // 2, 0) : place + near // 2 + 1] = -JOINT
        return against

    def _profile(self, widths: Ints, usual: float | None) -> Floats:
        """Log prior (w,) of lengths: most are about the usual one, once it is known."""
        even = np.full(len(widths), 1 / len(widths))
        if usual is None:
            return np.asarray(np.log(even))
        near = np.exp(-0.5 * np.square((widths - usual) / max(1.0, self.parameters.profile * usual)))
        return np.asarray(np.log(self.parameters.unusual * even + (1 - self.parameters.unusual) * near / near.sum()))


def evenly_spaced(dark: Bools, lit: Bools, least: int) -> list[int]:
    """The cells of a line, of which (n,) some are `dark`, at which it is so at an even distance of `least` cells or
    more wherever it is `lit`, with a few exceptions; none where that may be by chance."""
    share = float(np.clip(dark[lit].mean(), 0.05, 0.5))
    hit, miss = np.log((1 - EXCEPTION) / share), np.log(EXCEPTION / (1 - share))
    says = np.pad(np.where(dark, hit, miss) * lit, (0, len(dark)))
    best, places, pitch = SIGNIFICANT, np.zeros(0, np.int64), float(least)
    while pitch < len(dark) / 3:
        cells = np.round(np.arange(pitch)[:, None] + pitch * np.arange(len(dark) / pitch)).astype(np.int64)
        score = says[cells].sum(axis=1)
        if score.max() > best:
            best, places = float(score.max()), cells[int(score.argmax())]
        pitch *= 1 + 0.5 / len(dark)
    return [place for place in places.tolist() if place < len(lit) and lit[place]]


def lengths(most: int) -> Ints:
    """Lengths that are tried, in cells, each the next or longer by `LONGER`."""
    count = int(np.log(max(most, 4) / LEAST) / np.log(LONGER)) + 1
    return np.unique(np.round(LEAST * LONGER ** np.arange(count)).astype(np.int64))


def borders(profile: Floats, low: int, high: int, room: tuple[int, int]) -> Floats:
    """Where mean scores (n,) along a line fall to half of a lamp's (2,), in cells, about the first and the last + 1
    cell of the best set; between two others (`room`) at most, and where they do not fall so far, as at a joint, at
    these."""
    half = float(np.median(profile[low:high])) / 2
    first = _crossing(profile[room[0] : high][::-1], high - low - 1, half)
    last = _crossing(profile[low : room[1]], high - low - 1, half)
    return np.array([low if first is None else high - first, high if last is None else low + last], np.float64)


def _crossing(profile: Floats, start: int, level: float) -> float | None:
    """Where a profile (n,) falls below a level beyond the cell `start`, or before it where that is below; in cells."""
    dark = profile < level
    while start > 0 and dark[start]:
        start -= 1
    after = start + int(dark[start:].argmax())
    if not dark[after] or after == 0:
        return None
    return float(after + 0.5 - (level - profile[after]) / (profile[after - 1] - profile[after]))
