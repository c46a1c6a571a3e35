"""Mapped shelves beside a survey: scores, drawings, and a survey's entry out of what somebody measured.

Uprights are matched in order, then bays by where they lie between matched uprights, then beams in each bay in
order. A gap is scored where both its elements are matched and nothing unmatched lies between them on either side."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Annotated, Any, Self

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator
from scipy.optimize import linear_sum_assignment

from savmap.errors import OutputError
from savmap.files.validation import checked
from savmap.types import Drawing, Floats, Role, Score, Structure, SurveyEntry, pool
from savmap_shelves.mapping import Elements, MappedSection, sections_of, uprights_of

Pair = tuple[int, int]
NO_INTERVALS = np.zeros((0, 2))


def _forwards(interval: tuple[float, float]) -> tuple[float, float]:
    if not interval[0] < interval[1]:
        raise ValueError(f"{list(interval)} should be [smaller, larger]")
    return interval


def _in_order(intervals: list[tuple[float, float]]) -> list[tuple[float, float]]:
    for before, after in pairwise(intervals):
        if after[0] < before[1]:
            raise ValueError(f"{list(after)} should lie beyond {list(before)}: elements in order, not overlapping")
    return intervals


Interval = Annotated[tuple[float, float], AfterValidator(_forwards)]
Intervals = Annotated[list[Interval], AfterValidator(_in_order)]


class SurveyedSection(BaseModel):
    """Beams [y_bottom, y_top] of one bay, from the bottom up, metres in the row's frame."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    beams: Intervals


class SurveyedRow(BaseModel):
    """Uprights [x_left, x_right] from left to right and the bays between them, metres in the row's frame.

    Other keys of a survey's row are left alone.
    """

    model_config = ConfigDict(extra="ignore", frozen=True, allow_inf_nan=False)

    uprights: Intervals = Field(min_length=2)
    sections: list[SurveyedSection]

    @model_validator(mode="after")
    def _section_between_uprights(self) -> Self:
        count = len(self.uprights)
        if len(self.sections) != count - 1:
            raise ValueError(f"{count} uprights bound {count - 1} bays, not {len(self.sections)}")
        return self

    def upright_intervals(self) -> Floats:
        """x of left and right edges (n, 2)."""
        return np.array(self.uprights, dtype=np.float64)

    def section_intervals(self) -> Floats:
        """x of the bays' free width (n - 1, 2)."""
        uprights = self.upright_intervals()
        return np.column_stack([uprights[:-1, 1], uprights[1:, 0]])

    def beam_intervals(self, section: int) -> Floats:
        """y of bottom and top edges (m, 2) of a bay counted from 0."""
        return np.array(self.sections[section].beams, dtype=np.float64).reshape(-1, 2)


def read_row(entry: Mapping[str, Any]) -> SurveyedRow:
    """The shelves of a row's entry in a survey file. Raises OutputError."""
    return checked(SurveyedRow, entry, "survey")


def holds_shelves(entry: Mapping[str, Any]) -> bool:
    """Whether a row's entry says anything of shelves; it may be of other plugins alone."""
    return not SurveyedRow.model_fields.keys().isdisjoint(entry)


@dataclass(frozen=True)
class AlignmentCosts:
    """What a match costs; an element left unmatched, on either side, costs 1.

    tolerance_m: the disagreement that costs 1. position: weight of a pair's disagreement in place; the rest, 1 -
    position, weighs how its step from the pair before it disagrees, which a drift along the list leaves alone. first:
    weight of the first pair's disagreement in place, for it has no step.
    """

    tolerance_m: float
    position: float
    first: float


def align(truth: Floats, estimate: Floats, costs: AlignmentCosts) -> list[Pair]:
    """The cheapest matching, in order, of intervals `truth` (n, 2) and `estimate` (m, 2), both sorted by their centre.

    Either may have elements that the other lacks. Returns pairs of indices, increasing in both. Dynamic programming
    over the pair that was matched last.
    """
    rows, columns = len(truth), len(estimate)
    if not rows or not columns:
        return []
    distance = _disagreement(truth[:, None] - estimate[None]) / costs.tolerance_m
    best = np.empty((rows, columns))
    before: dict[Pair, Pair | None] = {}
    for i, j in np.ndindex(rows, columns):
        best[i, j], before[i, j] = _best_start(i, j, truth, estimate, best, distance, costs)
    i_last, j_last = np.indices(best.shape)
    total = best + (rows - 1 - i_last) + (columns - 1 - j_last)
    last = np.unravel_index(int(np.argmin(total)), total.shape)
    if total[last] >= rows + columns:
        return []
    pairs: list[Pair] = []
    pair: Pair | None = (int(last[0]), int(last[1]))
    while pair is not None:
        pairs.append(pair)
        pair = before[pair]
    return pairs[::-1]


def _best_start(
    i: int, j: int, truth: Floats, estimate: Floats, best: Floats, distance: Floats, costs: AlignmentCosts
) -> tuple[float, Pair | None]:
    """The least cost of a matching that ends with the pair (i, j), and the pair before it; None if it is the first."""
    first_cost = i + j + costs.first * distance[i, j]
    if not i or not j:
        return first_cost, None
    steps = (truth[i] - truth[:i])[:, None] - (estimate[j] - estimate[:j])[None]
    skipped = (i - 1 - np.arange(i))[:, None] + (j - 1 - np.arange(j))[None]
    step = (1 - costs.position) * _disagreement(steps) / costs.tolerance_m
    through = best[:i, :j] + skipped + step + costs.position * distance[i, j]
    where = np.unravel_index(int(np.argmin(through)), through.shape)
    return (
        (first_cost, None) if first_cost < through[where] else (float(through[where]), (int(where[0]), int(where[1])))
    )


def _disagreement(ends: Floats) -> Floats:
    """Mean absolute difference of two intervals' ends (..., 2)."""
    mean: Floats = np.abs(ends).mean(axis=-1)
    return mean


def gaps(intervals: Floats) -> Floats:
    """Free lengths (n - 1,) between consecutive intervals (n, 2)."""
    return intervals[1:, 0] - intervals[:-1, 1]


@dataclass(frozen=True)
class MeasureNames:
    """How the measures of one direction are named: class of element, and names of errors."""

    label: str
    element: str
    gap: str
    edge: str


UPRIGHTS = MeasureNames("upright", "V element", "V gap", "V edge")
BEAMS = MeasureNames("beam", "H element", "H gap", "H edge")


def evaluate(structures: Sequence[Structure], survey: Mapping[str, Any]) -> Score:
    """The score of a row's uprights and beams; elements outside the surveyed extent are not scored.

    Empty if the survey has no uprights. Raises OutputError where the row's survey or a structure is malformed.
    """
    if not holds_shelves(survey):
        return Score()
    surveyed = read_row(survey)
    uprights = uprights_of(structures)
    pairs = align_uprights(surveyed.upright_intervals(), uprights.intervals)
    warp = Warp(surveyed.upright_intervals(), uprights.intervals, pairs)
    beams = _score_sections(surveyed, sections_of(structures), warp)
    begins_m = _beginning(surveyed.upright_intervals(), uprights.intervals, pairs)
    return replace(pool([_score_uprights(surveyed, uprights, pairs, warp), *beams]), begins_m=begins_m)


def align_uprights(truth: Floats, estimate: Floats) -> list[Pair]:
    """Pairs of uprights (n, 2), (m, 2): by the steps between them, which a drift along the row changes little."""
    return align(truth, estimate, AlignmentCosts(_tolerance(truth), position=0.0, first=0.02))


def align_beams(truth: Floats, estimate: Floats) -> list[Pair]:
    """Pairs of beams (n, 2), (m, 2): by their heights, which the floor fixes, and the steps between them."""
    return align(truth, estimate, AlignmentCosts(_tolerance(truth), position=0.5, first=1.0))


def _tolerance(truth: Floats) -> float:
    """A quarter of the usual step from one element to the next, m."""
    steps = np.diff(truth.mean(axis=1))
    return float(np.median(steps)) / 4 if len(steps) else 0.25


class Warp:
    """From the map's x to the survey's, through the matched uprights' centres; by the nearest one's offset outside."""

    def __init__(self, truth: Floats, estimate: Floats, pairs: Sequence[Pair]) -> None:
        matched = np.array(pairs, dtype=np.int64).reshape(-1, 2)
        self._extent = float(truth[0, 0]), float(truth[-1, 1])
        self._mapped = estimate[matched[:, 1]].mean(axis=1)
        self._offsets = truth[matched[:, 0]].mean(axis=1) - self._mapped

    def __call__(self, x: Floats) -> Floats:
        """x in the survey's frame, of any shape."""
        return x + np.interp(x, self._mapped, self._offsets) if len(self._mapped) else x

    def inside(self, interval: Floats) -> bool:
        """Whether the centre of a mapped interval (2,) lies within the surveyed extent."""
        centre = float(self(interval.mean(keepdims=True))[0])
        return self._extent[0] <= centre <= self._extent[1]


def _score_uprights(surveyed: SurveyedRow, uprights: Elements, pairs: Sequence[Pair], warp: Warp) -> Score:
    """Where the map begins at another upright than the survey, its coordinates are taken from the first matched one."""
    truth = surveyed.upright_intervals()
    estimate = uprights.intervals + _beginning(truth, uprights.intervals, pairs)
    scored = [warp.inside(interval) for interval in uprights.intervals]
    return _score(UPRIGHTS, truth, Elements(uprights.ids, estimate), pairs, scored)


def _beginning(truth: Floats, estimate: Floats, pairs: Sequence[Pair]) -> float:
    """Where the survey has the map's x = 0: elsewhere than at 0 only if the first uprights (n, 2), (m, 2) of both are
    not a pair."""
    first = next(iter(pairs), (0, 0))
    return 0.0 if first == (0, 0) else float(truth[first[0], 0] - estimate[first[1], 0])


def _score_sections(surveyed: SurveyedRow, sections: Sequence[MappedSection], warp: Warp) -> list[Score]:
    extents = extents_of(sections, warp)
    partner = partners(surveyed.section_intervals(), extents)
    scores = []
    for k in range(len(surveyed.sections)):
        beams = sections[partner[k]].beams if k in partner else Elements((), NO_INTERVALS)
        truth = surveyed.beam_intervals(k)
        scores.append(_score(BEAMS, truth, beams, align_beams(truth, beams.intervals), [True] * len(beams.ids)))
    for j, section in enumerate(sections):
        if j not in partner.values() and warp.inside(section.extent):
            scores.append(_score(BEAMS, NO_INTERVALS, section.beams, [], [True] * len(section.beams.ids)))
    return scores


def extents_of(sections: Sequence[MappedSection], warp: Warp) -> Floats:
    """From where to where mapped bays (n, 2) reach, in the survey's frame, m."""
    return np.array([warp(section.extent) for section in sections], np.float64).reshape(-1, 2)


def partners(truth: Floats, estimate: Floats) -> dict[int, int]:
    """Mapped bay of each surveyed one: one to one, the most common width, at least half of the narrower's."""
    common = np.minimum(truth[:, None, 1], estimate[None, :, 1]) - np.maximum(truth[:, None, 0], estimate[None, :, 0])
    narrower = np.minimum(np.diff(truth), np.diff(estimate).T)
    rows, columns = linear_sum_assignment(np.maximum(common, 0), maximize=True)
    return {int(i): int(j) for i, j in zip(rows, columns, strict=True) if common[i, j] > 0.5 * narrower[i, j]}


def _score(
    names: MeasureNames, truth: Floats, mapped: Elements, pairs: Sequence[Pair], scored: Sequence[bool]
) -> Score:
    i, j = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    edges = truth[i] - mapped.intervals[j]
    whole = (np.diff(i) == 1) & (np.diff(j) == 1)
    gap_errors = gaps(truth[i])[whole] - gaps(mapped.intervals[j])[whole]
    matched = set(j.tolist())
    spurious = [k for k in range(len(mapped.ids)) if scored[k] and k not in matched]
    deviations = {mapped.ids[k]: float(np.abs(edge).max()) for k, edge in zip(j, edges, strict=True)}
    return Score(
        errors={names.element: edges[:, 1] - edges[:, 0], names.gap: gap_errors},
        coordinates={names.edge: edges.ravel()},
        missing={names.label: len(truth) - len(pairs)},
        spurious={names.label: len(spurious)},
        deviations=deviations | {mapped.ids[k]: float("inf") for k in spurious},
    )


BEHIND_M = 0.3
"""Between the fronts of members in front of one another: racks are 0.6 m deep and more, a face is within 0.1 m."""
NEAR_END = 0.25
"""The share of an element's extent that counts as its end: all its points there make up the edge."""
NARROWEST_M = 1e-3
SIDES = {0: ("left", "right"), 1: ("lower", "upper")}


def survey_entry(structures: Sequence[Structure]) -> SurveyEntry:
    """Uprights from left to right, and the beams between each two from the floor up. A beam beside the outermost
    uprights is left out, and what is in front of or behind what is nearer to the face: a model has the rack's back,
    too.

    Raises OutputError where uprights are missing, overlap or have no width."""
    posts, other_posts = _of_face([part for part in structures if part.label == "upright"], (0,))
    beams, other_beams = _of_face([part for part in structures if part.label == "beam"], (0, 1))
    uprights = _ordered_intervals(posts, 0)
    if len(uprights) < 2:
        raise OutputError(f"a survey of beams needs the uprights at their sides: there are {len(uprights)}")
    between = np.searchsorted([interval.mean() for _, interval in uprights], [_middle_x(beam) for beam in beams])
    bays: list[list[Structure]] = [[] for _ in range(len(uprights) + 1)]
    for beam, number in zip(beams, between.tolist(), strict=True):
        bays[number].append(beam)
    sections = [{"beams": [interval.tolist() for _, interval in _ordered_intervals(bay, 1)]} for bay in bays[1:-1]]
    values: dict[str, Any] = {"uprights": [interval.tolist() for _, interval in uprights], "sections": sections}
    read_row(values)
    others = dict.fromkeys((part.id for part in (*other_posts, *other_beams)), "something else is nearer to the face")
    outside = dict.fromkeys((beam.id for beam in (*bays[0], *bays[-1])), "beside the outermost uprights")
    return SurveyEntry(values, others | outside)


def _of_face(structures: Sequence[Structure], axes: tuple[int, ...]) -> tuple[list[Structure], list[Structure]]:
    """The members of the face, and those that stand in front of or behind one: they overlap along these axes."""
    extents = np.array([[part.vertices.min(axis=0), part.vertices.max(axis=0)] for part in structures])
    face, others = list[int](), list[Structure]()
    for k in np.argsort([abs(part.vertices[:, 2].max()) for part in structures], kind="stable").tolist():
        low, high = extents[k]
        overlap = np.minimum(extents[face, 1], high) - np.maximum(extents[face, 0], low)
        behind = abs(extents[face, 1, 2] - high[2]) > BEHIND_M
        if ((overlap[:, axes] > 0).all(axis=1) & behind).any():
            others.append(structures[k])
        else:
            face.append(k)
    return [structures[k] for k in sorted(face)], others


def _ordered_intervals(structures: Sequence[Structure], axis: int) -> list[tuple[str, Floats]]:
    """Ids and intervals (2,) m along an axis, in their order."""
    return sorted(
        ((structure.id, _interval(structure, axis)) for structure in structures), key=lambda pair: float(pair[1].mean())
    )


def _interval(structure: Structure, axis: int) -> Floats:
    """From edge to edge along an axis: the means of the points that are labelled so, or, without labels, of those near
    either end."""
    along = structure.vertices[:, axis]
    low, high = (
        np.array([side in label.split() for label in structure.vertex_labels], dtype=np.bool_) for side in SIDES[axis]
    )
    if not (low.any() and high.any()):
        near = NEAR_END * np.ptp(along)
        low, high = along <= along.min() + near, along >= along.max() - near
    interval = np.array(sorted((float(along[low].mean()), float(along[high].mean()))))
    if np.ptp(interval) < NARROWEST_M:
        what = "width" if axis == 0 else "height"
        raise OutputError(f"{structure.id}: has no {what}: all its points are at {interval[0]:.3f} m")
    return interval


def _middle_x(beam: Structure) -> float:
    along = beam.vertices[:, 0]
    return float((along.min() + along.max()) / 2)


OFF_M = 0.05
FACE_LEGEND, PLAN_LEGEND = "uprights and beams", "uprights"


def draw(
    structures: Sequence[Structure], survey: Mapping[str, Any] | None, deviations: Mapping[str, float]
) -> tuple[Drawing, ...]:
    """Uprights and beams, over the survey's if there is one.

    Those whose deviation (m, by id) is more than `OFF_M` are marked. Raises OutputError where the row's survey is
    malformed.
    """
    surveyed = _surveyed_drawings(read_row(survey)) if survey is not None and holds_shelves(survey) else ()
    mapped = [structure for structure in structures if structure.label in ("upright", "beam")]
    return (
        *surveyed,
        *(part for structure in mapped for part in _mapped_drawings(structure, deviations.get(structure.id, 0.0))),
    )


def _mapped_drawings(structure: Structure, deviation_m: float) -> Iterator[Drawing]:
    role: Role = "off" if deviation_m > OFF_M else "mapped"
    if structure.label == "beam":
        yield Drawing("polygon", _outline(structure), role, "structure", FACE_LEGEND, ("face",), name=structure.id)
        return
    number = structure.id.split()[-1]
    yield Drawing("polygon", _outline(structure), role, "structure", FACE_LEGEND, ("face",), number, structure.id)
    yield Drawing("line", _foot(structure), role, "structure", PLAN_LEGEND, ("plan",), number, structure.id)


def _outline(structure: Structure) -> Floats:
    """The corners in order around the middle, whatever their order in the map."""
    x, y = (structure.vertices - structure.vertices.mean(axis=0))[:, :2].T
    return structure.vertices[np.argsort(np.arctan2(y, x))]


def _foot(structure: Structure) -> Floats:
    """Left and right edge of an upright seen from above (2, 3)."""
    left = np.array(["left" in label.split() for label in structure.vertex_labels])
    return np.array([structure.vertices[left].mean(axis=0), structure.vertices[~left].mean(axis=0)])


def _surveyed_drawings(row: SurveyedRow) -> Iterator[Drawing]:
    """Uprights, of unsurveyed height, reach just above the highest beam of the row."""
    top = max((beams[-1][1] for beams in (section.beams for section in row.sections) if beams), default=2.0) + 0.3
    for x in row.upright_intervals():
        yield Drawing("polygon", _rectangle(x, np.array([0.0, top])), "survey", "structure", FACE_LEGEND, ("face",))
        foot = np.array([[x[0], 0.0, 0.0], [x[1], 0.0, 0.0]])
        yield Drawing("line", foot, "survey", "structure", PLAN_LEGEND, ("plan",))
    for number, x in enumerate(row.section_intervals()):
        for y in row.beam_intervals(number):
            yield Drawing("polygon", _rectangle(x, y), "survey", "structure", FACE_LEGEND, ("face",))


def _rectangle(x: Floats, y: Floats) -> Floats:
    """Corners (4, 3) in the face plane, around."""
    return np.array([[x[0], y[0], 0.0], [x[1], y[0], 0.0], [x[1], y[1], 0.0], [x[0], y[1], 0.0]])
