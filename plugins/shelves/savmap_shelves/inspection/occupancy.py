"""Which slots hold goods, by how deep behind the face lies what is seen in them.

In an empty slot one sees its deck, its ceiling, or what is behind the rack. Goods stand on the deck and hide all of
that: their fronts are nearer, and they end at upright edges. Each cell of the face, at each depth where a front may be,
says by how well frames agree there, against how well they agree further back, how likely it shows the front of goods,
their edge, or neither; these tables are counted on simulated rows. A slot is a line of columns, which goods occupy in
intervals, any height, any depth: their likelihoods are added up over both, and forward-backward over the sets of
intervals (semi-Markov, as for posts and beams) gives the probability that there are any. What nothing shows is left to
the prior, so that it stays unknown.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

import numpy as np
from scipy.ndimage import maximum_filter1d

from savmap.types import Bools, FaceDepths, Finding, FindingTable, Floats, Ints, Measured, Structure, array_record
from savmap.types.inspection import Cell, Grade, grade_of
from savmap.vision.evidence.intervals import Intervals, best_intervals, log_partitions

State = Literal["empty", "occupied", "unknown"]
FITTED = Path(__file__).parents[1] / "model" / "slots.json"
AGREEMENTS = (0.3, 0.5, 0.7, 0.85)
AHEAD = (-0.5, -0.25, -0.1, -0.03, 0.03, 0.1, 0.25, 0.5)
"""Limits of the tables' rows, the agreement of frames at a front's depth or further back, whichever is more, and of
their columns, by how much it is more at the front's depth."""
FRONTS_M, REAR_M = (-0.2, 0.62), 0.65
"""Where fronts of goods may be behind the face; what is further back is no goods of this slot."""
USUAL_FRONT_M = 0.03
TOPS = (0.15, 0.3, 0.45, 0.6, 0.75, 0.9, 1.0)
"""Heights of goods, as shares of the slot's."""
WIDTHS_M = (0.2, 1.3)
COLUMN_CELLS = 2
BESIDE_M, UNDER_M, ABOVE_M = 0.02, 0.02, 0.03
"""Left out at the sides, the deck and the ceiling of a slot."""
LEAST_HEIGHT_M, OPEN_HEIGHT_M = 0.4, 1.3
"""Lower openings are no slots; of one that is open above, so much is looked at."""
DECIDED = 0.8
"""From this probability on a slot is called empty or occupied."""
OVER_M = 0.03
"""Goods that stand out of the face by more are over the edge."""
PLACE_M = 0.03
"""The standard deviation of an edge of goods whose place is clear."""
NOWHERE = 99
TO_DO: Mapping[Grade, str] = {"amber": "look, and push them back", "unknown": "look whether they do"}
"""Of goods over the edge."""


@dataclass(frozen=True, eq=False)
@array_record
class SlotParameters:
    """The model's parameters, with their provenance in the file that they are read from.

    front, edge: log-likelihood ratios (5, 9) of a cell that shows the front of goods, or an upright edge of it, by its
    agreements. front_cells, edge_cells: how many cells say the same. rate: log rate of goods in a slot. depth_m: how
    far fronts are from the face, usually.
    """

    front: Floats
    edge: Floats
    front_cells: float
    edge_cells: float
    rate: float
    depth_m: float


@lru_cache
def fitted() -> SlotParameters:
    """The parameters that are shipped."""
    content: dict[str, Any] = json.loads(FITTED.read_text(encoding="utf-8"))["parameters"]
    return SlotParameters(np.array(content.pop("front")), np.array(content.pop("edge")), **content)


@dataclass(frozen=True)
class Occupancy:
    """What is in a slot: the probability that it holds goods; where that is decided, the widest free space between
    them and the free height above the highest, m; and the probability that some stand over the edge."""

    slot: Structure
    probability: float
    free_width: Measured | None = None
    free_height: Measured | None = None
    over_edge: float = 0.0

    @property
    def state(self) -> State:
        """By the probability."""
        if self.probability >= DECIDED:
            return "occupied"
        return "empty" if self.probability <= 1 - DECIDED else "unknown"


@dataclass(frozen=True, eq=False)
@array_record
class SlotView:
    """What the depths show of a slot: `agreements` (f, r, c), the cells' numbers in the tables at each front's depth
    `fronts_m` (f,), and `lowest` (f, r, c), the lowest of the tops whose goods would hide the cell from there,
    `NOWHERE` where none do. Columns are `column_m` wide; the first begins at `left_m`. `height_m`: of the slot, as far
    as it is looked at."""

    agreements: Ints
    lowest: Ints
    fronts_m: Floats
    left_m: float
    column_m: float
    height_m: float


@dataclass(frozen=True, eq=False)
@array_record
class SlotCells:
    """The cells of a slot: rows and columns (r,), (c,) of the depths, their places x (c,) and y (r,) m in the row's
    frame, the cameras (r, c, 3) m there, and from which depth (r, c) m behind the face an empty slot is seen."""

    rows: Ints
    columns: Ints
    x: Floats
    y: Floats
    cameras: Floats
    empty_m: Floats

    @property
    def seen(self) -> Bools:
        """Which cells (r, c) a camera shows."""
        return np.isfinite(self.cameras[..., 2])

    def at_depth(self, depth: Floats | float) -> tuple[Floats, Floats]:
        """Where (r, c) m the cells' rays are at depths behind the face."""
        share = depth / self.cameras[..., 2]
        across = self.x + (self.x - self.cameras[..., 0]) * share
        return across, self.y[:, None] + (self.y[:, None] - self.cameras[..., 1]) * share


def extent_of(slot: Structure) -> tuple[Floats, bool]:
    """The lower left and upper right corner (2, 2) m of a slot, and whether it is open above."""
    low, high = slot.vertices[:, :2].min(axis=0), slot.vertices[:, :2].max(axis=0)
    is_open = bool(high[1] - low[1] < 1e-6)
    return np.array([low, [high[0], low[1] + OPEN_HEIGHT_M if is_open else high[1]]]), is_open


def cells_of(depths: FaceDepths, corners: Floats, is_open: bool) -> SlotCells:
    """The cells of the depths that lie in a slot."""
    left, bottom = float(depths.origin @ depths.right), float(depths.origin @ depths.up)
    count, across = depths.scores.shape[1:]
    x = np.asarray(left + (np.arange(across) + 0.5) * depths.cell, np.float64)
    y = np.asarray(bottom + (np.arange(count)[::-1] + 0.5) * depths.cell, np.float64)
    (low_x, low_y), (high_x, high_y) = corners
    rows = np.flatnonzero((y > low_y + UNDER_M) & (y < high_y - ABOVE_M))
    columns = np.flatnonzero((x > low_x + BESIDE_M) & (x < high_x - BESIDE_M))
    cameras = depths.cameras[np.ix_(rows, columns)] + np.array([left, bottom, 0.0])
    y, rise = y[rows], y[rows][:, None] - cameras[..., 1]
    ceiling = np.inf if is_open else high_y
    room = np.where(rise > 0, ceiling - y[:, None], y[:, None] - low_y)
    empty = np.minimum(room * cameras[..., 2] / np.maximum(np.abs(rise), 1e-6), REAR_M)
    return SlotCells(rows, columns, x[columns], y, cameras, empty)


def slot_view(depths: FaceDepths, cells: SlotCells, corners: Floats) -> SlotView | None:
    """What the depths show of a slot; None where it is too small for them."""
    if len(cells.rows) < 3 or len(cells.columns) < 3 * COLUMN_CELLS:
        return None
    scores = depths.scores[:, cells.rows][:, :, cells.columns]
    is_front = (depths.depths > FRONTS_M[0]) & (depths.depths < FRONTS_M[1])
    steps = np.gradient(depths.depths)[is_front][:, None, None]
    fronts = depths.depths[is_front]
    behind = np.where(depths.depths[:, None, None] >= cells.empty_m - 0.03, scores, -1.0).max(axis=0)
    before = maximum_filter1d(scores, 3, axis=0)[is_front]
    agreement = np.digitize(np.maximum(before, behind), AGREEMENTS)
    numbers = agreement * (len(AHEAD) + 1) + np.digitize(before - behind, AHEAD)
    _, heights = cells.at_depth(fronts[:, None, None])
    height = float(corners[1, 1] - corners[0, 1])
    above = heights - corners[0, 1]
    shows = cells.seen & (above > 0) & (fronts[:, None, None] < cells.empty_m - 0.04 - steps)
    lowest = np.where(shows, np.searchsorted(height * np.array(TOPS[:-1]), above), NOWHERE)
    left = float(cells.x[0]) - depths.cell / 2
    return SlotView(numbers, lowest, fronts, left, COLUMN_CELLS * depths.cell, height)


@dataclass(frozen=True, eq=False)
@array_record
class GoodsScores:
    """Log-likelihood ratios of goods in a slot by top, front, and place: `inside` (t, f, n + 1) of columns, added up
    from the left, `edges` (t, f, n + 1) of the columns' borders; with the log prior of tops and fronts (f,)."""

    inside: Floats
    edges: Floats
    prior: Floats
    widths: Ints
    rate: float

    @classmethod
    def of(cls, view: SlotView, parameters: SlotParameters) -> "GoodsScores":
        """The scores of all intervals of a slot's columns."""
        front = parameters.front.ravel()[view.agreements] / parameters.front_cells
        edge = parameters.edge.ravel()[view.agreements] / parameters.edge_cells
        hidden = [view.lowest <= top for top in range(len(TOPS))]
        count = view.lowest.shape[2] // COLUMN_CELLS
        of_fronts, of_edges = (
            np.stack([np.where(mask, ratio, 0.0).sum(axis=1)[:, : COLUMN_CELLS * count] for mask in hidden])
            for ratio in (front, edge)
        )
        inside = of_fronts.reshape(*of_fronts.shape[:2], count, COLUMN_CELLS).sum(axis=3)
        edges = np.zeros((*inside.shape[:2], count + 1))
        # the cells on both sides of a border; edges next to an upright may hide behind it
        borders = np.arange(2, count - 1) * COLUMN_CELLS
        edges[:, :, 2 : count - 1] = of_edges[:, :, borders - 1] + of_edges[:, :, borders]
        prior = np.log(np.gradient(view.fronts_m)) - np.abs(view.fronts_m - USUAL_FRONT_M) / parameters.depth_m
        prior -= _log_sum(prior) + np.log(len(TOPS))
        least, most = (round(width / view.column_m) for width in WIDTHS_M)
        widths = np.arange(max(least, 2), min(most, count + 1))
        summed = np.pad(np.cumsum(inside, axis=2), ((0, 0), (0, 0), (1, 0)))
        return cls(summed, edges, prior, widths, parameters.rate - float(np.log(max(len(widths), 1))))

    def at(self, first: Ints | int, last: Ints | int) -> Floats:
        """Of goods from column `first` up to `last` (n,): (t, f, n)."""
        ratio = self.inside[:, :, last] - self.inside[:, :, first] + self.edges[:, :, first] + self.edges[:, :, last]
        return np.asarray(ratio + self.prior.reshape(1, -1, *[1] * np.ndim(first)))

    def intervals(self) -> Floats:
        """Of all intervals (n, w), tops and fronts added up; -inf where they do not fit."""
        count = self.inside.shape[2] - 1
        scores = np.full((count, len(self.widths)), -np.inf)
        for column, width in enumerate(self.widths.tolist()):
            first = np.arange(count - width + 1)
            every = self.at(first, first + width)
            scores[: len(first), column] = _log_sum(every.reshape(-1, len(first))) + self.rate
        return scores


def _log_sum(values: Floats) -> Floats:
    """log sum exp over the first axis."""
    most = values.max(axis=0)
    return np.asarray(most + np.log(np.exp(values - most).sum(axis=0)))


def log_odds(intervals: Floats, widths: Ints) -> float:
    """Of goods in a slot, by the scores (n, w) of all intervals of these widths (w,)."""
    log_sets = float(log_partitions([intervals], widths, 0)[0])
    return log_sets + float(np.log(-np.expm1(-max(log_sets, 1e-9))))


def occupancy_of(slot: Structure, depths: FaceDepths, parameters: SlotParameters) -> Occupancy | None:
    """What is in a slot; None for an opening that is too low to be one."""
    corners, is_open = extent_of(slot)
    if corners[1, 1] - corners[0, 1] < LEAST_HEIGHT_M:
        return None
    view = slot_view(depths, cells_of(depths, corners, is_open), corners)
    if view is None or not (view.lowest != NOWHERE).any():
        return Occupancy(slot, 0.5)
    scores = GoodsScores.of(view, parameters)
    if not len(scores.widths):
        return Occupancy(slot, 0.5)
    intervals = scores.intervals()
    probability = float(1 / (1 + np.exp(-np.clip(log_odds(intervals, scores.widths), -50, 50))))
    width, height = (_size(slot, name) for name in ("clear_width_m", "clear_height_m"))
    occupancy = Occupancy(slot, probability)
    if occupancy.state == "empty":
        return Occupancy(slot, probability, width, height)
    if occupancy.state == "unknown":
        return occupancy
    (goods,) = best_intervals([intervals], scores.widths, 0)
    over, top = _fronts_and_tops(goods, scores, view)
    free_height = None if height is None else Measured(max(height.value - top.value, 0.0), top.sigma)
    return Occupancy(slot, probability, _free_width(goods, view, corners), free_height, over)


def _size(slot: Structure, name: str) -> Measured | None:
    size = slot.attributes.get(name)
    return size if isinstance(size, Measured) else None


def _free_width(goods: Intervals, view: SlotView, corners: Floats) -> Measured:
    """The widest space that no goods occupy, more likely than not."""
    count = len(goods.posterior)
    taken = np.zeros(count + 1)
    for column, width in enumerate(goods.widths.tolist()):
        taken[:count] += goods.posterior[:, column]
        taken[width:] -= goods.posterior[: count + 1 - width, column]
    taken = np.cumsum(taken)[:count]
    edges = np.flatnonzero(np.diff(np.pad((taken < 0.5).astype(int), 1)))
    starts, ends = view.left_m + view.column_m * edges[::2], view.left_m + view.column_m * edges[1::2]
    starts = np.where(edges[::2] == 0, corners[0, 0], starts)
    ends = np.where(edges[1::2] == count, corners[1, 0], ends)
    unsure = view.column_m * float(np.minimum(taken, 1 - taken).clip(0, 1).sum())
    return Measured(float((ends - starts).max(initial=0.0)), float(np.hypot(PLACE_M, unsure)))


def _fronts_and_tops(goods: Intervals, scores: GoodsScores, view: SlotView) -> tuple[float, Measured]:
    """The probability that goods stand over the edge, and the height of the highest above the deck, m."""
    over, highest = 0.0, Measured(0.0, 0.0)
    for first, last in goods.cells.tolist():
        ratios = scores.at(first, last)
        shares = np.exp(ratios - ratios.max())
        shares /= shares.sum()
        over = max(over, float(shares[:, view.fronts_m < -OVER_M].sum()))
        by_top, tops = shares.sum(axis=1), view.height_m * np.array(TOPS)
        mean = float(by_top @ tops)
        sigma = float(np.hypot(np.sqrt(by_top @ np.square(tops - mean)), view.height_m * TOPS[0] / np.sqrt(12)))
        highest = max(highest, Measured(mean, sigma), key=float)
    return over, highest


def occupancies_of(slots: Sequence[Structure], depths: FaceDepths) -> list[Occupancy]:
    """What is in each of the slots that are high enough to be some."""
    each = (occupancy_of(slot, depths, fitted()) for slot in slots)
    return [occupancy for occupancy in each if occupancy is not None]


COLUMNS = (
    *("bay", "level", "state", "probability_occupied"),
    *("free_width_m", "sigma_free_width_m", "free_height_m", "sigma_free_height_m", "probability_over_edge"),
)


def slot_table(occupancies: Sequence[Occupancy]) -> FindingTable:
    """A line for each slot; sizes where it is decided what is in it."""
    lines = tuple(
        (
            *(int(float(occupancy.slot.attributes[name])) for name in ("bay", "level")),
            occupancy.state,
            round(occupancy.probability, 4),
            *_cells(occupancy.free_width),
            *_cells(occupancy.free_height),
            round(occupancy.over_edge, 4) if occupancy.state == "occupied" else None,
        )
        for occupancy in occupancies
    )
    return FindingTable("slots", "What is in the slots", COLUMNS, lines)


def _cells(size: Measured | None) -> tuple[Cell, Cell]:
    return (None, None) if size is None else (round(size.value, 3), round(size.sigma, 3))


def over_edge(occupancies: Sequence[Occupancy]) -> Iterator[Finding]:
    """A finding for each slot that holds goods: whether some stand out of the face."""
    for occupancy in occupancies:
        if occupancy.state == "occupied":
            x, y, z = occupancy.slot.vertices.mean(axis=0).tolist()
            grade = grade_of(occupancy.over_edge)
            yield Finding(
                "goods-over-edge",
                f"goods over the edge of {occupancy.slot.id}",
                grade,
                (occupancy.slot.id,),
                probability=occupancy.over_edge,
                action=TO_DO.get(grade, ""),
                place=(x, y, z),
            )
