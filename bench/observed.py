"""A warehouse at observation level: rows from start to map without pixels, ours beside the published method.

    python -m bench observed [--set dev] [--rows 46] [--sections 15] [--frames-a-section 20]

Both methods get the same features, tracks and references: the camera's height (2 cm), the height of each section's lowest
edge (2 mm), the row's length (3 mm), and the widths of one upright and one beam (1 mm), each off by its own sigma.
The masks' errors are those of `savmap.lab.sim.observations.PAPER`. Published: corners as points of one pixel, plain least squares
from the published start (`savmap.graph.PUBLISHED`, `savmap_shelves.constraints.published`).
"""

import argparse
import multiprocessing
import resource
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from bench.baseline import Figures
from bench.observed_rows import ESTIMATED, LOWEST_SIGMA_M, driven_row, given, mapped, tracked
from bench.seeds import SETS, is_test, seeds
from savmap.errors import SavmapError
from savmap.graph import PUBLISHED
from savmap.lab.sim.observations import PAPER
from savmap.report.evaluation import mean_absolute_error
from savmap.types import Score, pool
from savmap_shelves.constraints import GridSettings, published

METHODS = ("ours", "published")


@dataclass(frozen=True)
class RowResult:
    """Scores by method, and the seconds and memory that our way took from features to map."""

    scores: Mapping[str, Score]
    seconds: float
    peak_gb: float


def map_row(task: tuple[int, int, int]) -> RowResult:
    """Both methods on the row of a seed, of so many sections and frames a section."""
    seed, sections, frames = task
    driven = driven_row(seed, PAPER, sections=sections, frames_a_section=frames)
    measured = given(driven, np.random.default_rng([seed, 7]))
    begin = time.perf_counter()
    tracks = tracked(driven)
    seconds = time.perf_counter() - begin
    ways = {
        "ours": (GridSettings(measured.lowest_m, LOWEST_SIGMA_M, bias=ESTIMATED), None),
        "published": (published(measured.lowest_m, LOWEST_SIGMA_M), PUBLISHED),
    }
    scores: dict[str, Score] = {}
    for name, (settings, options) in ways.items():
        try:
            row = mapped(driven, measured, settings, options, tracks=tracks)
        except SavmapError:
            scores[name] = nothing(driven.survey)
            continue
        scores[name] = row.score
        seconds += row.seconds if name == "ours" else 0.0
    return RowResult(scores, seconds, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6)


def nothing(survey: Mapping[str, Any]) -> Score:
    """The score of a row that was not mapped."""
    beams = sum(len(section["beams"]) for section in survey["sections"])
    return Score(missing={"upright": len(survey["uprights"]), "beam": beams})


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of this bench."""
    parser.add_argument("--set", choices=SETS, default="dev", help="of seeds")
    parser.add_argument("--rows", type=int, help="how many; all of the set")
    parser.add_argument("--sections", type=int, default=15)
    parser.add_argument("--frames-a-section", type=int, default=20)


def run(given: argparse.Namespace) -> Figures:
    """Each method's figures over all rows, each row in a process of its own."""
    results: list[RowResult] = []
    tasks = [(seed, given.sections, given.frames_a_section) for seed in seeds("observation", given.set, given.rows)]
    with multiprocessing.get_context("spawn").Pool(1, maxtasksperchild=1) as workers:
        for (seed, *_), result in zip(tasks, workers.imap(map_row, tasks), strict=True):
            results.append(result)
            if not is_test("observation", seed):
                errors = ", ".join(f"{name} {_text(result.scores[name])}" for name in METHODS)
                print(f"{seed:6d} {result.seconds:6.1f} s, {errors}", flush=True)
    return {name: _figures(name, results) for name in METHODS}


def _text(score: Score) -> str:
    mean = mean_absolute_error(score)
    return "refused" if mean is None else f"{100 * mean:.2f} cm"


def _figures(name: str, results: Sequence[RowResult]) -> dict[str, float]:
    scores = [result.scores[name] for result in results]
    errors = [100 * mean for mean in map(mean_absolute_error, scores) if mean is not None]
    whole = pool(scores)
    figures: dict[str, float] = {
        "rows": len(scores),
        "refused": len(scores) - len(errors),
        "missing": sum(whole.missing.values()),
        "spurious": sum(whole.spurious.values()),
        "mean cm": 100 * (mean_absolute_error(whole) or float("nan")),
        "largest cm": max(errors, default=float("nan")),
    }
    if name == METHODS[0]:
        figures |= {"seconds a row": float(np.mean([result.seconds for result in results]))}
        figures |= {"peak GB": max(result.peak_gb for result in results)}
    return figures
