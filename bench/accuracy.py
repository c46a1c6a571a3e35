"""What each part buys, and how far from the bound we are: the ablation at observation level.

    python bench/accuracy.py [--rows 4] [--sections 4] [-o bench/results/accuracy.json]

Rows with the masks' errors of `savmap.lab.sim.observations.PAPER`. Each addition to the published method alone, then one upon the
other; beside the whole method's error stands the Cramer-Rao bound: the mean absolute error that marginal sigmas of the same
graph allow for where noise is what it was said to be (variance inflation taken out), mean |N(0, s)| = 0.8 s.
"""

import argparse
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
from observed_rows import ESTIMATED, LOWEST_SIGMA_M, DrivenRow, Given, Mapped, driven_row, given, mapped, tracked
from uncertainty import figures

from savmap.errors import SavmapError
from savmap.files.atomic import write_text
from savmap.graph import PUBLISHED, SolveOptions
from savmap.lab.sim.observations import PAPER, MaskErrors
from savmap.report.evaluation import mean_absolute_error
from savmap.types import Track, pool
from savmap_shelves.constraints import GridSettings, published

ROOT = Path(__file__).parent.parent
PARTS = ("edges as lines", "robust loss and rejection", "linear start", "setback", "mask bias")
Case = tuple[DrivenRow, Given, list[Track]]


def way(parts: tuple[str, ...], known: Given) -> tuple[GridSettings, SolveOptions]:
    """The published method with some parts of ours."""
    settings, options = published(known.lowest_m, LOWEST_SIGMA_M), PUBLISHED
    if "edges as lines" in parts:
        settings = replace(settings, corners="lines")
    if "robust loss and rejection" in parts:
        options = replace(options, loss="huber", reject_sigma=4.0, rounds=5)
    if "linear start" in parts:
        options = replace(options, start="linear")
    if "setback" in parts:
        settings = replace(settings, beam_setback_sigma_m=0.01)
    if "mask bias" in parts:
        settings = replace(settings, bias=ESTIMATED)
        options = replace(options, rounds=max(options.rounds, 4))
    return settings, options


def cases(errors: MaskErrors, rows: int, sections: int) -> list[Case]:
    """Rows, references off by their sigmas, and tracks."""
    driven = [driven_row(3000 + seed, errors, sections=sections) for seed in range(rows)]
    return [(row, given(row, np.random.default_rng([seed, 9])), tracked(row)) for seed, row in enumerate(driven)]


def error_cm(prepared: list[Case], parts: tuple[str, ...]) -> tuple[float, list[tuple[DrivenRow, Mapped]]]:
    """Mean absolute error over all rows, cm, and the maps; rows that cannot be mapped are left out with a line."""
    maps = []
    for number, (driven, known, tracks) in enumerate(prepared):
        try:
            maps.append((driven, mapped(driven, known, *way(parts, known), tracks=tracks)))
        except SavmapError as error:
            print(f"  row {number} cannot be mapped: {error}", flush=True)
    mean = mean_absolute_error(pool(mapped_row.score for _, mapped_row in maps))
    return 100 * mean if mean is not None else float("nan"), maps


def bound_cm(maps: list[tuple[DrivenRow, Mapped]]) -> float:
    """The mean absolute error of widths and gaps that the graphs' sigmas allow for."""
    sigmas = [
        sigma / np.sqrt(max(float(mapped_row.solution.report["variance_inflation"]), 1.0))
        for driven, mapped_row in maps
        for kind, _, sigma in figures(driven.survey, mapped_row.tracks, mapped_row.solution)
        if "edge" not in kind
    ]
    return 100 * float(np.sqrt(2 / np.pi) * np.mean(sigmas)) if sigmas else float("nan")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", type=int, default=4)
    parser.add_argument("--sections", type=int, default=4)
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "bench" / "results" / "accuracy.json")
    arguments = parser.parse_args()
    results: dict[str, float] = {}
    prepared = cases(PAPER, arguments.rows, arguments.sections)

    def tell(name: str, value: float) -> None:
        results[name] = value
        print(f"{name:46}{value:8.2f} cm", flush=True)

    tell("published", error_cm(prepared, ())[0])
    for part in PARTS:
        tell(f"published + {part}", error_cm(prepared, (part,))[0])
    for count in range(2, len(PARTS) + 1):
        error, maps = error_cm(prepared, PARTS[:count])
        tell(f"  + ... + {PARTS[count - 1]}", error)
    tell("bound of the last", bound_cm(maps))
    clean = cases(MaskErrors(PAPER.sigma_px), arguments.rows, arguments.sections)
    error, maps = error_cm(clean, PARTS)
    tell("all parts, noise only", error)
    tell("bound of that", bound_cm(maps))
    write_text(arguments.output, json.dumps(results, indent=2) + "\n")


if __name__ == "__main__":
    main()
