"""A site map against a survey: what the plugins' `evaluate` hooks return, row by row, as JSON and as a table.

Errors are truth - estimate, in metres, as in the paper (section IV). The counts of `missing` and `spurious` elements
always stand beside the mean absolute error: a map with a good mean and a missing element is not a good map.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from savmap.errors import OutputError, visible
from savmap.types import Distances, Evaluation, Floats, RowMap, Score, SiteMap, Structure, Survey, pool

Fragment = dict[str, Any]
ScoreHook = Callable[[str, str, Sequence[Structure], Mapping[str, Any]], Score]
_HEADINGS = ("count", "mean", "mean abs", "95 %", "largest")


@dataclass(frozen=True)
class Statistics:
    """Of errors: how many, their mean, and the mean, 95th percentile and largest of their sizes; None where there are
    none."""

    count: int
    mean: float | None = None
    mean_absolute: float | None = None
    percentile_95: float | None = None
    largest: float | None = None

    @property
    def values(self) -> tuple[float | None, ...]:
        """All but the count."""
        return self.mean, self.mean_absolute, self.percentile_95, self.largest


def evaluate_site(site: SiteMap, survey: Survey, score: ScoreHook) -> Evaluation:
    """Score each row that the survey has. `score(row, plugin, structures, surveyed row)` asks one plugin.

    Raises OutputError where map and survey have no row in common, or a row's survey is malformed.
    """
    common = [name for name in site.rows if name in survey.rows]
    if not common:
        names = f"map: {', '.join(sorted(site.rows)) or 'none'}; survey: {', '.join(sorted(survey.rows)) or 'none'}"
        raise OutputError(f"map and survey have no row in common ({names}): name them alike")
    scores = {name: _row_scores(site.rows[name], survey.rows[name], score) for name in common}
    not_mapped = tuple(name for name in survey.rows if name not in site.rows)
    return Evaluation(
        {name: pool(parts.values()) for name, parts in scores.items()},
        not_mapped,
        tuple(name for name in site.rows if name not in survey.rows),
        {name: {plugin: part.deviations for plugin, part in parts.items()} for name, parts in scores.items()},
    )


def statistics(errors: Floats) -> Statistics:
    """Statistics of errors (n,)."""
    if not len(errors):
        return Statistics(0)
    size = np.abs(errors)
    percentile = float(np.percentile(size, 95))
    return Statistics(len(errors), float(errors.mean()), float(size.mean()), percentile, float(size.max()))


def all_errors(score: Score) -> Floats:
    """The errors (n,) of all classes, m."""
    return np.concatenate([np.zeros(0), *score.errors.values()])


def mean_absolute_error(score: Score) -> float | None:
    """The paper's figure: mean absolute error over all classes, m; None where nothing was matched."""
    return _rounded(statistics(all_errors(score)).mean_absolute)


def as_json(evaluation: Evaluation) -> Fragment:
    """The scores over all rows, each row's under `rows`, and the rows that are in one file only."""
    return {
        **score_json(pool(evaluation.rows.values())),
        "rows": {name: score_json(score) for name, score in evaluation.rows.items()},
        "not_mapped": list(evaluation.not_mapped),
        "not_surveyed": list(evaluation.not_surveyed),
    }


def score_json(score: Score) -> Fragment:
    """mae_m, missing, spurious, classes, edges, and one entry for each heading apart."""
    return {
        "mae_m": mean_absolute_error(score),
        "missing": dict(score.missing),
        "spurious": dict(score.spurious),
        "classes": {name: _statistics_json(errors) for name, errors in score.errors.items()},
        "edges": {name: _statistics_json(errors) for name, errors in score.coordinates.items()},
        **{heading: _distances_json(distances) for heading, distances in score.distances.items()},
    }


def as_table(evaluation: Evaluation) -> str:
    """A plain-text table, lengths in cm: a block for each row, one over all rows where there are several, and the rows
    left out."""
    blocks = [_block(f"Row {visible(name)}", score) for name, score in evaluation.rows.items()]
    if len(blocks) > 1:
        blocks.append(_block("All rows", pool(evaluation.rows.values())))
    left_out = (
        ("In the survey, but not mapped", evaluation.not_mapped),
        ("Mapped, but not in the survey", evaluation.not_surveyed),
    )
    blocks += [f"{what}: {', '.join(map(visible, names))}\n" for what, names in left_out if names]
    return "\n".join(blocks)


def named_counts(counts: Mapping[str, int]) -> str:
    """Such as "2 beam, 1 upright", or "none"."""
    return ", ".join(f"{count} {name}" for name, count in counts.items() if count) or "none"


def _row_scores(row: RowMap, surveyed: Mapping[str, Any], score: ScoreHook) -> dict[str, Score]:
    """By plugin. Where one finds that the map begins elsewhere in the row than the survey, the others' structures are
    moved there."""
    try:
        scores = {plugin: score(row.name, plugin, group, surveyed) for plugin, group in row.structures.items()}
        begins_m = next((part.begins_m for part in scores.values() if part.begins_m), 0.0)
        return {
            plugin: part if part.begins_m == begins_m else score(row.name, plugin, _moved(group, begins_m), surveyed)
            for (plugin, group), part in zip(row.structures.items(), scores.values(), strict=True)
        }
    except OutputError as error:
        raise OutputError(f"row {row.name}: {error}") from error


def _moved(structures: Sequence[Structure], x_m: float) -> list[Structure]:
    return [replace(structure, vertices=structure.vertices + np.array([x_m, 0.0, 0.0])) for structure in structures]


def _statistics_json(errors: Floats) -> Fragment:
    given = statistics(errors)
    names = ("mean_m", "mae_m", "p95_m", "max_m")
    return {"count": given.count, **{name: _rounded(value) for name, value in zip(names, given.values, strict=True)}}


def _distances_json(distances: Distances) -> Fragment:
    given = _statistics_json(distances.distances_m)
    counts = {"count": given["count"], "missing": distances.missing, "spurious": distances.spurious}
    return {**counts, "mae_m": given["mae_m"], "max_m": given["max_m"]}


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 6) + 0.0


def _block(title: str, score: Score) -> str:
    classes = {**score.errors, **score.coordinates}
    widest = max((len(name) for name in classes), default=0)
    lines = [f"{title}: truth - estimate, cm"]
    if score.errors:
        lines.append(f"  {'':{widest}}" + "".join(f"{heading:>10}" for heading in _HEADINGS))
    for name, errors in classes.items():
        given = statistics(errors)
        cells = ("-" if value is None else f"{100 * value:.2f}" for value in given.values)
        lines.append(f"  {name:{widest}}{given.count:>10}" + "".join(f"{cell:>10}" for cell in cells))
    error = mean_absolute_error(score)
    lines += [f"  mean absolute error {100 * error:.2f} cm"] if error is not None else []
    counts = f"  missing: {named_counts(score.missing)}; spurious: {named_counts(score.spurious)}"
    lines += [counts] if score.missing else []
    lines += [f"  {heading}: {_distances(distances)}" for heading, distances in score.distances.items()]
    return "\n".join(lines) + "\n"


def _distances(distances: Distances) -> str:
    metres = distances.distances_m
    size = f", mean {100 * metres.mean():.1f} cm, largest {100 * metres.max():.1f} cm" if len(metres) else ""
    return f"{len(metres)} matched{size}; {distances.missing} missing, {distances.spurious} spurious"
