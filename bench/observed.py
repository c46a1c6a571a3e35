"""A warehouse at observation level: rows from start to map without pixels, ours beside the published method.

    python bench/observed.py [--rows 46] [--sections 15] [--frames-a-section 20] [-o bench/results/observed.json]

Both methods get the same features, tracks and references: the camera's height (2 cm), the height of each section's lowest
edge (2 mm), the row's length (3 mm), and the widths of one upright and one beam (1 mm), each off by its own sigma.
The masks' errors are those of `savmap.lab.sim.observations.PAPER`. Published: corners as points of one pixel, plain least squares
from the published start (`savmap.graph.PUBLISHED`, `savmap_shelves.constraints.published`).
"""

import argparse
import json
import multiprocessing
import resource
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from observed_rows import ESTIMATED, LOWEST_SIGMA_M, driven_row, given, mapped, tracked

from savmap.errors import SavmapError
from savmap.files.atomic import write_text
from savmap.graph import PUBLISHED
from savmap.lab.sim.observations import PAPER
from savmap.report.evaluation import as_table, score_json
from savmap.types import Evaluation, Score, pool
from savmap_shelves.constraints import GridSettings, published

ROOT = Path(__file__).parent.parent
METHODS = ("ours", "published")
Result = dict[str, Any]


def map_row(task: tuple[int, int, int]) -> tuple[dict[str, Score], Result]:
    """Scores by method, and what it took: seconds and memory of our way from features to map."""
    seed, sections, frames = task
    driven = driven_row(seed, PAPER, sections=sections, frames_a_section=frames)
    known = given(driven, np.random.default_rng([seed, 7]))
    begin = time.perf_counter()
    tracks = tracked(driven)
    tracking = time.perf_counter() - begin
    settings = GridSettings(known.lowest_m, LOWEST_SIGMA_M, bias=ESTIMATED)
    scores: dict[str, Score] = {}
    result: Result = {}
    ways = (("ours", settings, None), ("published", published(known.lowest_m, LOWEST_SIGMA_M), PUBLISHED))
    for name, chosen, options in ways:
        try:
            row = mapped(driven, known, chosen, options, tracks=tracks)
        except SavmapError as error:
            scores[name], result[name] = (
                nothing(driven.survey),
                {**score_json(nothing(driven.survey)), "error": str(error)},
            )
            continue
        scores[name] = row.score
        result[name] = {
            **score_json(row.score),
            "seconds": tracking + row.seconds,
            "peak_gb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6,
            "report": dict(row.solution.report),
        }
    return scores, result


def nothing(survey: Mapping[str, Any]) -> Score:
    """The score of a row that was not mapped."""
    beams = sum(len(section["beams"]) for section in survey["sections"])
    return Score(missing={"upright": len(survey["uprights"]), "beam": beams})


def line(seed: int, result: Result) -> str:
    """One row of the table."""
    cells = []
    for name in METHODS:
        figures = result[name]
        if "error" in figures:
            cells.append(f" {figures['error'][:60]:>42}")
            continue
        wrong = f"{sum(figures['missing'].values()):8d} {sum(figures['spurious'].values()):9d}"
        cells.append(f"{wrong} {100 * figures['mae_m']:8.2f} {figures['seconds']:8.1f} {1e3 * figures['peak_gb']:6.0f}")
    return f"{seed:5d}" + "".join(cells)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", type=int, default=46)
    parser.add_argument("--first", type=int, default=0, help="seed of the first row")
    parser.add_argument("--sections", type=int, default=15)
    parser.add_argument("--frames-a-section", type=int, default=20)
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "bench" / "results" / "observed.json")
    arguments = parser.parse_args()
    results: dict[int, Result] = {}
    scores: dict[str, list[Score]] = {name: [] for name in METHODS}
    head = " missing  spurious   MAE cm  seconds     MB"
    print(f"{'':5}{'ours':>43}{'published':>43}\n  row{head}{head}", flush=True)
    seeds = range(arguments.first, arguments.first + arguments.rows)
    tasks = [(seed, arguments.sections, arguments.frames_a_section) for seed in seeds]
    with multiprocessing.get_context("spawn").Pool(1, maxtasksperchild=1) as workers:
        for seed, (row_scores, result) in zip(seeds, workers.imap(map_row, tasks), strict=True):
            results[seed] = result
            for name, score in row_scores.items():
                scores[name].append(score)
            print(line(seed, result), flush=True)
    pooled: Mapping[str, Score] = {name: pool(rows) for name, rows in scores.items() if rows}
    print(as_table(Evaluation(pooled)).split("\nAll rows")[0])
    total = {name: score_json(score) for name, score in pooled.items()}
    write_text(arguments.output, json.dumps({"all": total, "rows": results}, indent=2) + "\n")


if __name__ == "__main__":
    main()
