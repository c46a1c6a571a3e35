"""A map against a survey: what the plugins' `evaluate` hooks found, pooled over rows, as JSON.

Errors are truth - estimate, in metres, as in the paper (section IV). A row's `missing` and `spurious` elements always
stand beside its mean absolute error: a map with a good mean and a missing element is not a good map.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from savmap.errors import OutputError
from savmap.types import Floats, RowMap, SiteMap, Structure

Fragment = dict[str, Any]


@dataclass(frozen=True)
class Distances:
    """Points scored by their distance to the survey's: matched distances (n,) m, and how many found no partner."""

    distances_m: Floats
    missing: int = 0
    spurious: int = 0


@dataclass(frozen=True)
class Score:
    """How one plugin's structures, or all of a row's or site's, compare with the survey.

    errors: truth - estimate (n,) m by class of measure; all of them make up the mean absolute error. coordinates: the
    same for edge coordinates in the row's frame, which widths hide. missing, spurious: counts by class of element.
    apart: points under a heading of their own, outside the mean. deviations: by structure id, its largest edge error in
    m (infinite where it is spurious).
    """

    errors: Mapping[str, Floats] = field(default_factory=dict)
    coordinates: Mapping[str, Floats] = field(default_factory=dict)
    missing: Mapping[str, int] = field(default_factory=dict)
    spurious: Mapping[str, int] = field(default_factory=dict)
    apart: Mapping[str, Distances] = field(default_factory=dict)
    deviations: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Evaluation:
    """The scores of the rows that are in both files, and the rows that are in one only."""

    rows: Mapping[str, Score]
    not_mapped: tuple[str, ...] = ()
    not_surveyed: tuple[str, ...] = ()


ScoreHook = Callable[[str, Sequence[Structure], Mapping[str, Any]], Score | None]


def evaluate_site(site: SiteMap, survey: Mapping[str, Mapping[str, Any]], score: ScoreHook) -> Evaluation:
    """Score each row that the survey has. `score(plugin, structures, surveyed row)` asks a plugin; None: not compared.

    Raises OutputError where map and survey have no row in common, or a row's survey is malformed.
    """
    common = [name for name in site.rows if name in survey]
    if not common:
        named = f"map: {_listed(site.rows)}; survey: {_listed(survey)}"
        raise OutputError(f"map and survey have no row in common ({named}): name them alike")
    rows = {name: _score_row(site.rows[name], survey[name], score) for name in common}
    not_mapped = tuple(name for name in survey if name not in site.rows)
    return Evaluation(rows, not_mapped, tuple(name for name in site.rows if name not in survey))


def pool(scores: Iterable[Score]) -> Score:
    """All scores as one: errors side by side, counts added. Deviations are kept where ids do not clash."""
    every = list(scores)
    return Score(
        errors=_joined(own.errors for own in every),
        coordinates=_joined(own.coordinates for own in every),
        missing=_added(own.missing for own in every),
        spurious=_added(own.spurious for own in every),
        apart=_joined_distances(own.apart for own in every),
        deviations={name: value for own in every for name, value in own.deviations.items()},
    )


def as_json(evaluation: Evaluation) -> Fragment:
    """The scores over all rows, each row's under `rows`, and the rows left out."""
    return {
        **score_json(pool(evaluation.rows.values())),
        "rows": {name: score_json(own) for name, own in evaluation.rows.items()},
        "not_mapped": list(evaluation.not_mapped),
        "not_surveyed": list(evaluation.not_surveyed),
    }


def score_json(score: Score) -> Fragment:
    """mae_m, missing, spurious, classes, edges, and one entry for each heading apart."""
    return {
        "mae_m": mean_absolute_error(score),
        "missing": dict(score.missing),
        "spurious": dict(score.spurious),
        "classes": {name: _figures(errors) for name, errors in score.errors.items()},
        "edges": {name: _figures(errors) for name, errors in score.coordinates.items()},
        **{heading: _distance_figures(own) for heading, own in score.apart.items()},
    }


def mean_absolute_error(score: Score) -> float | None:
    """The paper's figure: mean absolute error over all classes, m; None where nothing was matched."""
    every = np.concatenate([np.zeros(0), *score.errors.values()])
    return _rounded(np.abs(every).mean()) if len(every) else None


def _score_row(row: RowMap, surveyed: Mapping[str, Any], score: ScoreHook) -> Score:
    try:
        scores = [score(plugin, structures, surveyed) for plugin, structures in row.structures.items()]
    except OutputError as error:
        raise OutputError(f"row {row.name}: {error}") from error
    return pool(own for own in scores if own is not None)


def _figures(errors: Floats) -> Fragment:
    if not len(errors):
        return {"count": 0, "mean_m": None, "mae_m": None, "p95_m": None, "max_m": None}
    size = np.abs(errors)
    return {
        "count": len(errors),
        "mean_m": _rounded(errors.mean()),
        "mae_m": _rounded(size.mean()),
        "p95_m": _rounded(np.percentile(size, 95)),
        "max_m": _rounded(size.max()),
    }


def _distance_figures(own: Distances) -> Fragment:
    figures = _figures(own.distances_m)
    counts = {"count": figures["count"], "missing": own.missing, "spurious": own.spurious}
    return {**counts, "mae_m": figures["mae_m"], "max_m": figures["max_m"]}


def _joined(parts: Iterable[Mapping[str, Floats]]) -> dict[str, Floats]:
    joined: dict[str, Floats] = {}
    for part in parts:
        for name, errors in part.items():
            joined[name] = np.concatenate([joined.get(name, np.zeros(0)), errors])
    return joined


def _added(parts: Iterable[Mapping[str, int]]) -> dict[str, int]:
    added: dict[str, int] = {}
    for part in parts:
        for name, count in part.items():
            added[name] = added.get(name, 0) + count
    return added


def _joined_distances(parts: Iterable[Mapping[str, Distances]]) -> dict[str, Distances]:
    joined: dict[str, Distances] = {}
    for part in parts:
        for name, own in part.items():
            so_far = joined.get(name, Distances(np.zeros(0)))
            distances = np.concatenate([so_far.distances_m, own.distances_m])
            joined[name] = Distances(distances, so_far.missing + own.missing, so_far.spurious + own.spurious)
    return joined


def _rounded(value: float | np.floating[Any]) -> float:
    return round(float(value), 6) + 0.0


def _listed(names: Iterable[str]) -> str:
    return ", ".join(sorted(names)) or "none"
