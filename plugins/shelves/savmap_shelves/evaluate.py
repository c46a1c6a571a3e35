"""Mapped shelves against a survey: widths, gaps, edges, missing and spurious elements (paper, section IV).

Uprights are matched in order, then sections by where they lie between matched uprights, then beams in each section in
order. A gap is scored where both its elements are matched and nothing unmatched lies between them on either side.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from savmap.geometry.matching import matched
from savmap.types import Floats, Score, Structure, pool
from savmap_shelves.alignment import Costs, Pairs, align, gaps
from savmap_shelves.outline import Elements, Section, sections_of, uprights_of
from savmap_shelves.survey import SurveyedRow, read_row

NO_ELEMENTS = Elements((), np.zeros((0, 2)))


@dataclass(frozen=True)
class Measures:
    """How the measures of one direction are named: class of element, and names of errors."""

    label: str
    element: str
    gap: str
    edge: str


UPRIGHTS = Measures("upright", "V element", "V gap", "V edge")
BEAMS = Measures("beam", "H element", "H gap", "H edge")


def evaluate(structures: Sequence[Structure], survey: Mapping[str, Any]) -> Score:
    """The score of a row's uprights and beams; elements outside the surveyed extent are not scored.

    Raises OutputError where the row's survey or a structure is malformed.
    """
    surveyed = read_row(survey)
    uprights = uprights_of(structures)
    pairs = align_uprights(surveyed.upright_intervals(), uprights.intervals)
    onto = Warp(surveyed.upright_intervals(), uprights.intervals, pairs)
    beams = _score_sections(surveyed, sections_of(structures), onto)
    return pool([_score_uprights(surveyed, uprights, pairs, onto), *beams])


def align_uprights(truth: Floats, estimate: Floats) -> Pairs:
    """Pairs of uprights (n, 2), (m, 2): by the steps between them, which a drift along the row changes little."""
    return align(truth, estimate, Costs(_tolerance(truth), position=0.0, first=0.02))


def align_beams(truth: Floats, estimate: Floats) -> Pairs:
    """Pairs of beams (n, 2), (m, 2): by their heights, which the floor fixes, and the steps between them."""
    return align(truth, estimate, Costs(_tolerance(truth), position=0.5, first=1.0))


class Warp:
    """From the map's x to the survey's, through the matched uprights' centres; by the nearest one's offset outside."""

    def __init__(self, truth: Floats, estimate: Floats, pairs: Pairs) -> None:
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


def _score_uprights(surveyed: SurveyedRow, uprights: Elements, pairs: Pairs, onto: Warp) -> Score:
    """Where the map begins at another upright than the survey, its coordinates are taken from the first matched one."""
    truth, estimate = surveyed.upright_intervals(), uprights.intervals
    if pairs and pairs[0] != (0, 0):
        estimate = estimate + (truth[pairs[0][0], 0] - estimate[pairs[0][1], 0])
    scored = [onto.inside(interval) for interval in uprights.intervals]
    return _score(UPRIGHTS, truth, Elements(uprights.ids, estimate), pairs, scored)


def _score_sections(surveyed: SurveyedRow, sections: list[Section], onto: Warp) -> list[Score]:
    partner = _partners(surveyed.section_intervals(), np.array([onto(own.extent) for own in sections]).reshape(-1, 2))
    scores = []
    for k in range(len(surveyed.sections)):
        beams = sections[partner[k]].beams if k in partner else NO_ELEMENTS
        truth = surveyed.beam_intervals(k)
        scores.append(_score(BEAMS, truth, beams, align_beams(truth, beams.intervals), [True] * len(beams.ids)))
    for j, section in enumerate(sections):
        if j not in partner.values() and onto.inside(section.extent):
            scores.append(_score(BEAMS, np.zeros((0, 2)), section.beams, [], [True] * len(section.beams.ids)))
    return scores


def _partners(truth: Floats, estimate: Floats) -> dict[int, int]:
    """Mapped section of each surveyed one: one to one, the most common width, at least half of the narrower's."""
    common = np.minimum(truth[:, None, 1], estimate[None, :, 1]) - np.maximum(truth[:, None, 0], estimate[None, :, 0])
    narrower = np.minimum(np.diff(truth), np.diff(estimate).T)
    return {i: j for i, j in matched(-common, 0.0).items() if common[i, j] > 0.5 * narrower[i, j]}


def _score(measures: Measures, truth: Floats, found: Elements, pairs: Pairs, scored: list[bool]) -> Score:
    i, j = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    edges = truth[i] - found.intervals[j]
    whole = (np.diff(i) == 1) & (np.diff(j) == 1)
    gap_errors = gaps(truth[i])[whole] - gaps(found.intervals[j])[whole]
    matched = set(j.tolist())
    spurious = [k for k in range(len(found.ids)) if scored[k] and k not in matched]
    deviations = {found.ids[k]: float(np.abs(edge).max()) for k, edge in zip(j, edges, strict=True)}
    return Score(
        errors={measures.element: edges[:, 1] - edges[:, 0], measures.gap: gap_errors},
        coordinates={measures.edge: edges.ravel()},
        missing={measures.label: len(truth) - len(pairs)},
        spurious={measures.label: len(spurious)},
        deviations=deviations | {found.ids[k]: float("inf") for k in spurious},
    )


def _tolerance(truth: Floats) -> float:
    """A quarter of the usual step from one element to the next, m."""
    steps = np.diff(truth.mean(axis=1))
    return float(np.median(steps)) / 4 if len(steps) else 0.25
