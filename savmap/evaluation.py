"""A map against a survey: what the plugins' `evaluate` hooks found, pooled over rows, as JSON and as a table.

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
_HEAD = ("count", "mean", "mean abs", "95 %", "largest")


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
class Survey:
    """What a surveyor measured: rows by name, each a mapping of plugins' keys, in metres and the row's own frame."""

    rows: Mapping[str, Mapping[str, Any]]


@dataclass(frozen=True)
class Evaluation:
    """The scores of the rows that are in both files, and the rows that are in one only."""

    rows: Mapping[str, Score]
    not_mapped: tuple[str, ...] = ()
    not_surveyed: tuple[str, ...] = ()


ScoreHook = Callable[[str, Sequence[Structure], Mapping[str, Any]], Score]


def evaluate_site(site: SiteMap, survey: Survey, score: ScoreHook) -> Evaluation:
    """Score each row that the survey has. `score(plugin, structures, surveyed row)` asks one plugin.

    Raises OutputError where map and survey have no row in common, or a row's survey is malformed.
    """
    common = [name for name in site.rows if name in survey.rows]
    if not common:
        named = f"map: {_listed(site.rows)}; survey: {_listed(survey.rows)}"
        raise OutputError(f"map and survey have no row in common ({named}): name them alike")
    rows = {name: _score_row(site.rows[name], survey.rows[name], score) for name in common}
    not_mapped = tuple(name for name in survey.rows if name not in site.rows)
    return Evaluation(rows, not_mapped, tuple(name for name in site.rows if name not in survey.rows))


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


def as_table(evaluation: Evaluation) -> str:
    """A plain-text table, lengths in cm: one block a row, one over all rows where there are several, and the rows left out."""
    blocks = [_block(f"Row {name}", score) for name, score in evaluation.rows.items()]
    if len(blocks) > 1:
        blocks.append(_block("All rows", pool(evaluation.rows.values())))
    left_out = (
        ("In the survey, but not mapped", evaluation.not_mapped),
        ("Mapped, but not in the survey", evaluation.not_surveyed),
    )
    blocks += [f"{what}: {', '.join(names)}\n" for what, names in left_out if names]
    return "\n".join(blocks)


def mean_absolute_error(score: Score) -> float | None:
    """The paper's figure: mean absolute error over all classes, m; None where nothing was matched."""
    every = np.concatenate([np.zeros(0), *score.errors.values()])
    return _rounded(np.abs(every).mean()) if len(every) else None


def named_counts(counts: Mapping[str, int]) -> str:
    """Such as "2 beam, 1 upright", or "none"."""
    return ", ".join(f"{count} {name}" for name, count in counts.items() if count) or "none"


def _score_row(row: RowMap, surveyed: Mapping[str, Any], score: ScoreHook) -> Score:
    try:
        return pool(score(plugin, structures, surveyed) for plugin, structures in row.structures.items())
    except OutputError as error:
        raise OutputError(f"row {row.name}: {error}") from error


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


def _block(title: str, score: Score) -> str:
    widest = max((len(name) for name in (*score.errors, *score.coordinates)), default=0)
    lines = [f"{title}: truth - estimate, cm"]
    if score.errors:
        lines.append(f"  {'':{widest}}" + "".join(f"{head:>10}" for head in _HEAD))
    lines += [f"  {name:{widest}}{_columns(errors)}" for name, errors in {**score.errors, **score.coordinates}.items()]
    error = mean_absolute_error(score)
    lines += [f"  mean absolute error {100 * error:.2f} cm"] if error is not None else []
    lines += (
        [f"  missing: {named_counts(score.missing)}; spurious: {named_counts(score.spurious)}"] if score.missing else []
    )
    lines += [f"  {heading}: {_distances(own)}" for heading, own in score.apart.items()]
    return "\n".join(lines) + "\n"


def _columns(errors: Floats) -> str:
    if not len(errors):
        return f"{0:>10}" + f"{'-':>10}" * 4
    size = np.abs(errors)
    values = (errors.mean(), size.mean(), np.percentile(size, 95), size.max())
    return f"{len(errors):>10}" + "".join(f"{100 * value:>10.2f}" for value in values)


def _distances(own: Distances) -> str:
    found = own.distances_m
    size = f", mean {100 * found.mean():.1f} cm, largest {100 * found.max():.1f} cm" if len(found) else ""
    return f"{len(found)} matched{size}; {own.missing} missing, {own.spurious} spurious"
