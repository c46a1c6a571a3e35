"""A warehouse at observation level: rows from start to map without pixels, ours beside the published method.

    python bench/observed.py [--rows 46] [--sections 15] [--frames-a-section 20] [-o bench/results/observed.json]

Both methods get the same features, tracks and references: the camera's height (2 cm), the height of each section's lowest
edge (2 mm), the row's length (3 mm), and the widths of one upright and one beam (1 mm), each off by its own sigma.
The masks' errors are those of `savmap.sim.observations.PAPER`. Published: corners as points of one pixel, plain least squares
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
from observed_rows import LOWEST_SIGMA_M, Mapped, given, made, mapped, tracked

from savmap.errors import SavmapError
from savmap.evaluation import Evaluation, Score, as_table, pool, score_json
from savmap.graph import PUBLISHED
from savmap.sim.observations import PAPER
from savmap_shelves.constraints import GridSettings, published

ROOT = Path(__file__).parent.parent
METHODS = ("ours", "published")
Result = dict[str, Any]


def one_row(task: tuple[int, int, int]) -> tuple[dict[str, Score], Result]:
    """Scores by method, and what it took: seconds and memory of our way from features to map."""
    seed, sections, frames = task
    one = made(seed, PAPER, sections=sections, frames_a_section=frames)
    known = given(one, np.random.default_rng([seed, 7]))
    begin = time.perf_counter()
    tracks = tracked(one)
    tracking = time.perf_counter() - begin
    ours = mapped(one, known, GridSettings(known.lowest_m, LOWEST_SIGMA_M, 0.0, 0.01, 1.0, "estimated"), tracks=tracks)
    result: Result = {
        "seconds": tracking + ours.seconds,
        "peak_gb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6,
        "bias_px": [ours.solution.report[f"bias {n}, px"] for n in (1, 2, 3)],
    }
    scores = {"ours": ours.score}
    try:
        theirs: Mapped = mapped(one, known, published(known.lowest_m, LOWEST_SIGMA_M), PUBLISHED, tracks=tracks)
        scores["published"] = theirs.score
    except SavmapError as error:
        result["published failed"] = str(error)
    return scores, {**result, **{name: score_json(score) for name, score in scores.items()}}


def line(seed: int, result: Result) -> str:
    """One row of the table."""
    ours = result["ours"]
    wrong = f"{sum(ours['missing'].values()):8d} {sum(ours['spurious'].values()):9d}"
    theirs = f"{100 * result['published']['mae_m']:13.2f}" if "published" in result else "       failed"
    return (
        f"{seed:5d} {wrong} {100 * ours['mae_m']:8.2f} {theirs} {result['seconds']:8.1f} {1e3 * result['peak_gb']:6.0f}"
    )


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
    print("  row  missing  spurious  ours cm  published cm  seconds     MB", flush=True)
    seeds = range(arguments.first, arguments.first + arguments.rows)
    tasks = [(seed, arguments.sections, arguments.frames_a_section) for seed in seeds]
    with multiprocessing.get_context("spawn").Pool(1, maxtasksperchild=1) as workers:
        for seed, (found, result) in zip(seeds, workers.imap(one_row, tasks), strict=True):
            results[seed] = result
            for name, score in found.items():
                scores[name].append(score)
            print(line(seed, result), flush=True)
    every: Mapping[str, Score] = {name: pool(own) for name, own in scores.items() if own}
    print(as_table(Evaluation(every)).split("\nAll rows")[0])
    total = {name: score_json(own) for name, own in every.items()}
    arguments.output.parent.mkdir(parents=True, exist_ok=True)
    arguments.output.write_text(json.dumps({"all": total, "rows": results}, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
