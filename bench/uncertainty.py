"""Are the standard deviations true? Normalised errors (estimate - truth) / sigma over many rows at observation level.

    python -m bench uncertainty [--set dev] [--rows 30] [--sections 3]

Each row's references are off by errors drawn from their own sigmas. The normalised errors' root mean square (1 is right) and the share of
them within 1.96 sigma (95 % is right), by what is wrong with the masks, for all figures and for the uprights' edges along x.
"""

import argparse
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from bench.baseline import Figures
from bench.observed_rows import ESTIMATED, LOWEST_SIGMA_M, driven_row, given, mapped
from bench.seeds import SETS, seeds
from savmap.errors import SavmapError
from savmap.graph import Solution
from savmap.lab.sim.observations import PAPER, MaskErrors
from savmap.types import Floats, Track
from savmap_shelves.constraints import GridSettings
from savmap_shelves.constraints.track_grid import grid_of

LEVEL = 1.96
KINDS = ("V edge", "V element", "V gap", "H edge", "H element", "H gap")
CASES: Mapping[str, MaskErrors] = {
    "noise": MaskErrors(0.7),
    "noise that stays": MaskErrors(0.5, drift_px=0.5),
    "mask errors": MaskErrors(0.7, missed=0.1, duplicated=0.05, incomplete=0.3, wide=0.1, outliers=0.05),
    "paper": PAPER,
}
Figure = tuple[str, float, float]


def figures(survey: Mapping[str, Any], tracks: Sequence[Track], solution: Solution) -> Iterator[Figure]:
    """Kind, error and sigma, both m, of everything in a map of which nothing is missing or spurious."""
    grid = grid_of(tracks)
    points = solution.landmarks_of("shelves")
    lines: list[tuple[str, int, tuple[Any, ...], str, float]] = []
    for (upright, side), names in grid.columns.items():
        truth = survey["uprights"][upright - 1][side == "right"]
        lines.append(("V", 0, (upright, side), names[0], truth))
    for (section, beam, edge), names in grid.rows.items():
        truth = survey["sections"][section - 1]["beams"][beam - 1][edge == "upper"]
        lines.append(("H", 1, (section, beam, edge), names[0], truth))
    for kind, axis, _, name, truth in lines[1:]:
        place = points[name]
        yield f"{kind} edge", float(place.position[axis] - truth), float(np.sqrt(place.covariance[axis, axis]))
    for (kind, axis, place_a, a, x), (other, _, place_b, b, y) in _neighbours(lines):
        if kind == other:
            what = "element" if place_a[:-1] == place_b[:-1] else "gap"
            error = float(points[b].position[axis] - points[a].position[axis]) - (y - x)
            yield f"{kind} {what}", error, solution.difference_sigma("shelves", a, b, axis)


def _neighbours(lines: list[tuple[str, int, tuple[Any, ...], str, float]]) -> Iterator[tuple[Any, Any]]:
    """Edges next to one another, along x or in one section."""
    order = sorted(lines, key=lambda line: (line[0], line[2][0] if line[0] == "H" else 0, line[4]))
    for a, b in pairwise(order):
        if a[0] == b[0] and (a[0] == "V" or a[2][0] == b[2][0]):
            yield a, b


def run_case(errors: MaskErrors, rows: Sequence[int], sections: int) -> dict[str, Floats]:
    """Normalised errors by kind."""
    by_kind: dict[str, list[float]] = {kind: [] for kind in KINDS}
    for seed in rows:
        driven = driven_row(seed, errors, sections=sections)
        known = given(driven, np.random.default_rng([seed, 8]))
        try:
            row = mapped(driven, known, GridSettings(known.lowest_m, LOWEST_SIGMA_M, bias=ESTIMATED))
        except SavmapError as refusal:
            print(f"  row {seed} is left out: {refusal}", flush=True)
            continue
        if any(row.score.missing.values()) or any(row.score.spurious.values()):
            continue
        for kind, error, sigma in figures(driven.survey, row.tracks, row.solution):
            by_kind[kind].append(error / sigma)
    return {kind: np.array(values) for kind, values in by_kind.items()}


def summary(values: Floats) -> dict[str, float]:
    """Root mean square, share within 1.96, count."""
    return {
        "spread": float(np.sqrt(np.mean(values**2))),
        "within_95": float(np.mean(np.abs(values) < LEVEL)),
        "count": len(values),
    }


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of this bench."""
    parser.add_argument("--set", choices=SETS, default="dev", help="of seeds")
    parser.add_argument("--rows", type=int, default=30)
    parser.add_argument("--sections", type=int, default=3)
    parser.add_argument("--case", choices=tuple(CASES), action="append")


def run(given: argparse.Namespace) -> Figures:
    """Spread and share by case."""
    results = {}
    for name in given.case or CASES:
        by_kind = run_case(CASES[name], seeds("observation", given.set, given.rows), given.sections)
        all_kinds, edges = summary(np.concatenate(list(by_kind.values()))), summary(by_kind["V edge"])
        results[name] = {
            "error / sigma": all_kinds["spread"],
            "within 95 %": 100 * all_kinds["within_95"],
            "uprights' x / sigma": edges["spread"],
            "uprights' x within 95 %": 100 * edges["within_95"],
        }
        print(name, results[name], flush=True)
    return results
