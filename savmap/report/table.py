"""An evaluation as a plain-text table for people; lengths in centimetres."""

from collections.abc import Mapping

import numpy as np

from savmap.evaluation import Distances, Evaluation, Score, mean_absolute_error, pool
from savmap.types import Floats

_HEAD = ("count", "mean", "mean abs", "95 %", "largest")


def as_table(evaluation: Evaluation) -> str:
    """One block a row, one over all rows where there are several, and the rows left out."""
    blocks = [_block(f"Row {name}", score) for name, score in evaluation.rows.items()]
    if len(blocks) > 1:
        blocks.append(_block("All rows", pool(evaluation.rows.values())))
    left_out = (("Not mapped", evaluation.not_mapped), ("Not surveyed", evaluation.not_surveyed))
    blocks += [f"{what}: {', '.join(names)}\n" for what, names in left_out if names]
    return "\n".join(blocks)


def _block(title: str, score: Score) -> str:
    widest = max((len(name) for name in (*score.errors, *score.coordinates)), default=0)
    lines = [f"{title}: truth - estimate, cm"]
    if score.errors:
        lines.append(f"  {'':{widest}}" + "".join(f"{head:>10}" for head in _HEAD))
    lines += [f"  {name:{widest}}{_figures(errors)}" for name, errors in {**score.errors, **score.coordinates}.items()]
    error = mean_absolute_error(score)
    lines += [f"  mean absolute error {100 * error:.2f} cm"] if error is not None else []
    lines += [f"  missing: {_counts(score.missing)}; spurious: {_counts(score.spurious)}"] if score.missing else []
    lines += [f"  {heading}: {_distances(own)}" for heading, own in score.apart.items()]
    return "\n".join(lines) + "\n"


def _figures(errors: Floats) -> str:
    if not len(errors):
        return f"{0:>10}" + f"{'-':>10}" * 4
    size = np.abs(errors)
    values = (errors.mean(), size.mean(), np.percentile(size, 95), size.max())
    return f"{len(errors):>10}" + "".join(f"{100 * value:>10.2f}" for value in values)


def _counts(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{count} {name}" for name, count in counts.items() if count) or "none"


def _distances(own: Distances) -> str:
    found = own.distances_m
    size = f", mean {100 * found.mean():.1f} cm, largest {100 * found.max():.1f} cm" if len(found) else ""
    return f"{len(found)} matched{size}; {own.missing} missing, {own.spurious} spurious"
