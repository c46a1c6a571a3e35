"""The truth of simulated slots, and the parameters of the model of what is in them, counted and fitted by it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize

from savmap.types import Bools, FaceDepths, Floats, Structure, array_record
from savmap_shelves.inspection.occupancy import (
    AGREEMENTS,
    AHEAD,
    LEAST_HEIGHT_M,
    NOWHERE,
    OVER_M,
    GoodsScores,
    SlotCells,
    SlotParameters,
    SlotView,
    cells_of,
    extent_of,
    log_odds,
    slot_view,
)

TABLE = len(AGREEMENTS) + 1, len(AHEAD) + 1
PSEUDO_COUNT, MOST_RATIO = 3.0, 3.0
"""Of a table's cells; and no cell says more than this."""
STEPS = 6
"""Places of a ray at which it may be inside goods."""
MOST_ODDS = 9.0
"""No slot counts by more than these log odds: some goods are hidden by others."""
EVALUATIONS, SPREAD = 60, 0.4
LEAST_JUMP_M = 0.1
"""An edge is where what is seen beside it is further away by this."""
LEAST_WIDTH_M, LEAST_DEPTH_M = 0.1, 0.02
"""Labels are no goods by themselves."""
START = SlotParameters(np.zeros(TABLE), np.zeros(TABLE), 20.0, 14.0, -3.0, 0.4)


@dataclass(frozen=True, eq=False)
@array_record
class TrueSlot:
    """A slot and the boxes of goods in it (n, 2, 3): lowest and highest corners, m in the row's frame."""

    slot: Structure
    goods: Floats

    @property
    def is_occupied(self) -> bool:
        """Whether it holds goods."""
        return bool(len(self.goods))

    @property
    def is_over_edge(self) -> bool:
        """Whether goods stand out of the face."""
        return bool((self.goods[:, 1, 2] > OVER_M).any())

    @property
    def free_width_m(self) -> float:
        """The widest space between goods, or between goods and an upright."""
        (left, _), (right, _) = extent_of(self.slot)[0].tolist()
        widest = 0.0
        for low, high in sorted(self.goods[:, :, 0].tolist()):
            widest, left = max(widest, low - left), max(left, high)
        return float(max(widest, right - left))

    @property
    def top_m(self) -> float:
        """The height of the highest goods above the deck."""
        return float(self.goods[:, 1, 1].max(initial=0.0) - extent_of(self.slot)[0][0, 1])


def true_slots(places: Sequence[Structure], goods: Floats) -> list[TrueSlot]:
    """The slots among a row's places that are high enough, with what of the row's goods (n, 2, 3) is in each."""
    middles = goods.mean(axis=1)
    slots = []
    for slot in places:
        (left, bottom), (right, top) = extent_of(slot)[0]
        if slot.label == "level" and top - bottom >= LEAST_HEIGHT_M:
            inside = (middles[:, 0] > left) & (middles[:, 0] < right)
            inside &= (goods[:, 0, 1] > bottom - 0.05) & (goods[:, 0, 1] < top - 0.05)
            slots.append(TrueSlot(slot, goods[inside]))
    return slots


@dataclass(frozen=True, eq=False)
@array_record
class Example:
    """A slot as the depths show it, whether it holds goods, and how often its cells have each pair of agreements
    where they show the front of goods, an edge, and none (3, 5, 9)."""

    view: SlotView
    is_occupied: bool
    counts: Floats


def example_of(true: TrueSlot, depths: FaceDepths) -> Example | None:
    """None where nothing shows the slot."""
    corners, is_open = extent_of(true.slot)
    cells = cells_of(depths, corners, is_open)
    view = slot_view(depths, cells, corners)
    if view is None or not (view.lowest != NOWHERE).any():
        return None
    front, hidden = _true_fronts(cells, true.goods)
    edge = _edges(front)
    shown = np.isfinite(front)
    is_clear: Bools = ~shown & ~hidden & ~np.isfinite(edge)
    at_all = view.agreements[(view.lowest != NOWHERE) & is_clear]
    counts = [
        _counted(view, np.where(np.isfinite(edge), np.inf, front)),
        _counted(view, edge),
        np.bincount(at_all, minlength=int(np.prod(TABLE))),
    ]
    return Example(view, true.is_occupied, np.array(counts, np.float64).reshape(3, *TABLE))


def _true_fronts(cells: SlotCells, goods: Floats) -> tuple[Floats, Bools]:
    """How deep (r, c) m the front of goods is that each cell shows, inf where none; which cells' rays meet goods."""
    front = np.full(cells.seen.shape, np.inf)
    hidden = np.zeros(cells.seen.shape, np.bool_)
    for low, high in goods:
        if high[0] - low[0] < LEAST_WIDTH_M or high[2] - low[2] < LEAST_DEPTH_M:
            continue
        for number, depth in enumerate(np.linspace(-high[2], -low[2], STEPS)):
            x, y = cells.at_depth(float(depth))
            inside = (x > low[0]) & (x < high[0]) & (y > low[1]) & (y < high[1]) & cells.seen
            hidden |= inside
            if number == 0:
                front = np.where(inside, np.minimum(front, depth), front)
    return front, hidden


def _edges(front: Floats) -> Floats:
    """How deep (r, c) m the front is whose upright edge lies between a cell and its neighbour, inf where none does."""
    edge = np.full(front.shape, np.inf)
    near, far = np.minimum(front[:, :-1], front[:, 1:]), np.maximum(front[:, :-1], front[:, 1:])
    jump = np.where(far > near + LEAST_JUMP_M, near, np.inf)
    edge[:, :-1] = jump
    edge[:, 1:] = np.minimum(edge[:, 1:], jump)
    return edge


def _counted(view: SlotView, front: Floats) -> Floats:
    """How often the cells that show a front have each pair of agreements at its depth."""
    shown = np.isfinite(front)
    number = np.abs(view.fronts_m[:, None, None] - np.where(shown, front, 0.0)).argmin(axis=0)[None]
    agreements = np.take_along_axis(view.agreements, number, 0)[0]
    shown &= np.take_along_axis(view.lowest, number, 0)[0] != NOWHERE
    return np.bincount(agreements[shown], minlength=int(np.prod(TABLE))).astype(np.float64)


def fit(examples: Sequence[Example]) -> SlotParameters:
    """The parameters: tables counted, the other four by maximum likelihood."""
    shares = np.sum([example.counts for example in examples], axis=0) + PSEUDO_COUNT
    ratios = np.log(shares / shares.sum(axis=(1, 2), keepdims=True))
    front, edge = (np.clip(ratios[k] - ratios[2], -MOST_RATIO, MOST_RATIO) for k in (0, 1))
    start = replace(START, front=front, edge=edge)
    scales = np.log([start.front_cells, start.edge_cells, start.depth_m])

    def parameters(x: Floats) -> SlotParameters:
        front_cells, edge_cells, depth_m = np.exp(scales + x[:3]).tolist()
        return replace(
            start, front_cells=front_cells, edge_cells=edge_cells, depth_m=depth_m, rate=float(start.rate + x[3])
        )

    def loss(x: Floats) -> float:
        scores = (GoodsScores.of(example.view, parameters(x)) for example in examples)
        odds = np.array([log_odds(goods.intervals(), goods.widths) for goods in scores])
        signs = np.array([1 if example.is_occupied else -1 for example in examples])
        return float(np.logaddexp(0.0, -np.clip(signs * odds, -MOST_ODDS, MOST_ODDS)).sum()) + 0.5 * float(x @ x)

    simplex = SPREAD * np.vstack([np.zeros(4), np.eye(4)])
    result = minimize(
        loss, np.zeros(4), method="Nelder-Mead", options={"maxfev": EVALUATIONS, "initial_simplex": simplex}
    )
    return parameters(result.x)
