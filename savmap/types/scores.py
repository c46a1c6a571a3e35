"""Scores: what a plugin's `evaluate` hook returns of its structures against a survey, and scores put together."""

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from savmap.types.common import Floats, array_record


@dataclass(frozen=True, eq=False)
@array_record
class Distances:
    """Points scored by their distance to the survey's: matched distances (n,) m, and how many points have no
    partner."""

    distances_m: Floats
    missing: int = 0
    spurious: int = 0


@dataclass(frozen=True, eq=False)
class Score:
    """How one plugin's structures, or all of a row's or site's, compare with the survey.

    errors: truth - estimate (n,) m by class of measure; all of them make up the mean absolute error. coordinates: the
    same for edge coordinates in the row's frame, which widths hide. missing, spurious: counts by class of element.
    distances: points under a heading of their own, outside the mean. deviations: by structure id, its largest edge
    error in m (infinite where it is spurious). begins_m: where the survey's x has the map's x = 0, where that is known
    to lie elsewhere than at the survey's own: the map lacks the row's beginning.
    """

    errors: Mapping[str, Floats] = field(default_factory=dict)
    coordinates: Mapping[str, Floats] = field(default_factory=dict)
    missing: Mapping[str, int] = field(default_factory=dict)
    spurious: Mapping[str, int] = field(default_factory=dict)
    distances: Mapping[str, Distances] = field(default_factory=dict)
    deviations: Mapping[str, float] = field(default_factory=dict)
    begins_m: float = 0.0


@dataclass(frozen=True)
class Survey:
    """What a surveyor measured: rows by name, each a mapping of plugins' keys, in metres and the row's own frame."""

    rows: Mapping[str, Mapping[str, Any]]


@dataclass(frozen=True)
class SurveyEntry:
    """One plugin's part of a row's entry in a survey: its keys, and, by id, why elements that were given are not in
    it."""

    values: Mapping[str, Any]
    left_out: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Evaluation:
    """The scores of the rows that are both in the map and in the survey, and the rows that are in one only.
    `deviations`: by row, plugin and structure id, as in a plugin's `Score`, for plugins do not know one another's
    ids."""

    rows: Mapping[str, Score]
    not_mapped: tuple[str, ...] = ()
    not_surveyed: tuple[str, ...] = ()
    deviations: Mapping[str, Mapping[str, Mapping[str, float]]] = field(default_factory=dict)

    def deviations_of(self, row: str, plugin: str) -> Mapping[str, float]:
        """How far a plugin's structures of a row are off the survey, by id, m; empty where nobody compared them."""
        return self.deviations.get(row, {}).get(plugin, {})


def pool(scores: Iterable[Score]) -> Score:
    """All scores as one: errors side by side, counts added. Of structures with the same id, the last one's deviation is
    kept."""
    parts = list(scores)
    return Score(
        errors=_concatenated(score.errors for score in parts),
        coordinates=_concatenated(score.coordinates for score in parts),
        missing=_added(score.missing for score in parts),
        spurious=_added(score.spurious for score in parts),
        distances=_pooled_distances([score.distances for score in parts]),
        deviations={name: value for score in parts for name, value in score.deviations.items()},
    )


def _concatenated(parts: Iterable[Mapping[str, Floats]]) -> dict[str, Floats]:
    by_name: dict[str, list[Floats]] = {}
    for part in parts:
        for name, errors in part.items():
            by_name.setdefault(name, []).append(errors)
    return {name: np.concatenate(errors) for name, errors in by_name.items()}


def _added(parts: Iterable[Mapping[str, int]]) -> dict[str, int]:
    total: Counter[str] = Counter()
    for part in parts:
        total.update(part)
    return dict(total)


def _pooled_distances(parts: list[Mapping[str, Distances]]) -> dict[str, Distances]:
    """By heading: matched distances side by side, counts added."""
    distances = _concatenated({name: given.distances_m for name, given in part.items()} for part in parts)
    missing = _added({name: given.missing for name, given in part.items()} for part in parts)
    spurious = _added({name: given.spurious for name, given in part.items()} for part in parts)
    return {name: Distances(distances[name], missing[name], spurious[name]) for name in distances}
