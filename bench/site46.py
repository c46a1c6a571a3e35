"""A whole site at observation level, from start to site map: 46 rows of 15 sections, 23 aisles, racks with two faces.

    python bench/site46.py [--rows 46] [--sections 15] [--frames-a-section 20] [--jobs 2] [-o bench/results/site46]

Each row is mapped by the program's own tracking, constraints and solve from masks' edges with the errors of `PAPER`, with references
off by their own sigmas (camera height 2 cm, lowest edges 2 mm, length 3 mm, two widths 1 mm). The rows are put into one frame
(`savmap.assembly`) from places good to 20 cm and half a degree. Printed: rows, what of time and memory grows from the first row to
the last, the table of errors over all rows, the places' errors before and after. Written: map.json, errors.png, figures.json.
Ends with 1 if more than one element in a thousand is missing or spurious.
"""

import argparse
import json
import multiprocessing
import resource
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from site_rows import Task, made, mapped_row, prior

from savmap.assembly import Assembly, assembled, site_lines
from savmap.errors import SavmapError
from savmap.files.atomic import write_text
from savmap.maps.map_file import write_map
from savmap.plugin.manager import open_plugin
from savmap.report.evaluation import as_table, mean_absolute_error, score_json
from savmap.report.picture import write_box_plot
from savmap.types import Evaluation, Floats, Placement, RowMap, Score, SiteMap, pool

ROOT = Path(__file__).parent.parent
ALLOWED = 1e-3
PAPER_COUNTS = "the paper: 46 rows, 736 vertical and 4920 horizontal elements, 2890 element and 2547 gap widths, 4.8 cm"


@dataclass(frozen=True)
class Result:
    """One row: its map and score (or why there is none), how many elements it has, seconds from features to map, and the
    worker's peak memory so far."""

    task: Task
    row: RowMap | None
    score: Score
    elements: Mapping[str, int]
    seconds: float
    peak_mb: float
    error: str = ""


def one_row(task: Task) -> Result:
    """Make and map one row."""
    one = made(task)
    elements = {
        "upright": len(one.survey["uprights"]),
        "beam": sum(len(section["beams"]) for section in one.survey["sections"]),
    }
    begin = time.process_time()
    try:
        found, row = mapped_row(task, one)
        score, error = found.score, ""
    except SavmapError as problem:
        row, score, error = None, Score(missing=dict(elements)), str(problem)
    seconds = time.process_time() - begin
    return Result(task, row, score, elements, seconds, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3, error)


def line(number: int, result: Result) -> str:
    """One row of the table."""
    if result.row is None:
        return f"{number:5d} {result.task.name:>5}  {result.error}"
    wrong = f"{sum(result.score.missing.values()):9d}{sum(result.score.spurious.values()):10d}"
    error = 100 * (mean_absolute_error(result.score) or 0.0)
    counts = f"{result.elements['upright']:6d}{result.elements['beam']:6d}"
    return f"{number:5d} {result.task.name:>5}{counts}{wrong}{error:9.2f}{result.seconds:9.1f}{result.peak_mb:8.0f}"


def trends(results: Sequence[Result]) -> dict[str, float]:
    """Means over the first and the last fifth of the rows (the first row of each worker left out for memory: there it grows to its
    size), and slopes a row with their standard errors."""
    fifth = max(len(results) // 5, 1)
    found: dict[str, float] = {}
    for name in ("seconds", "peak_mb"):
        values = np.array([getattr(own, name) for own in results])
        slope, error = _slope(values)
        found |= {f"{name} first": float(values[:fifth].mean()), f"{name} last": float(values[-fifth:].mean())}
        found |= {f"{name} slope": slope, f"{name} slope sigma": error}
    return found


def _slope(values: Floats) -> tuple[float, float]:
    steps = np.arange(len(values)) - (len(values) - 1) / 2
    spread = float(steps @ steps)
    if len(values) < 3:
        return 0.0, float("inf")
    slope = float(steps @ values) / spread
    left = values - values.mean() - slope * steps
    return slope, float(np.sqrt(left @ left / (len(values) - 2) / spread))


def site_of(results: Sequence[Result]) -> tuple[Assembly, float]:
    """The assembled site, and the seconds that took."""
    rows = {own.task.name: own.row for own in results if own.row is not None}
    failed = {own.task.name: own.error for own in results if own.row is None}
    rooms = {name: open_plugin(name, {}) for name in ("shelves", "lights")}
    begin = time.perf_counter()
    assembly = assembled(
        SiteMap(rows, {}, failed),
        {own.task.name: prior(own.task) for own in results},
        {own.task.name: {"pass 1": own.task.recording} for own in results},
        lambda plugin, structures: rooms[plugin].shared(structures),
    )
    return assembly, time.perf_counter() - begin


def place_errors(places: Mapping[str, Placement], results: Sequence[Result]) -> Floats:
    """x m, z m, heading degrees (n, 3) of the rows against the truth."""
    off = []
    for own in results:
        if own.task.name in places:
            found, true = places[own.task.name], own.task.place
            turn = (found.heading_deg - true.heading_deg + 180) % 360 - 180
            off.append([found.x_m - true.x_m, found.z_m - true.z_m, turn])
    return np.array(off).reshape(-1, 3)


def squareness(places: Mapping[str, Placement], results: Sequence[Result]) -> dict[str, float]:
    """Errors (root mean square) of rows, of faces across an aisle, along both faces of a rack, of headings among themselves."""
    names = [own.task.name for own in results if own.task.name in places]
    off = dict(zip(names, place_errors(places, results), strict=True))
    aisles = [off[f"{k}R"] - off[f"{k}L"] for k in range(1, len(results)) if {f"{k}L", f"{k}R"} <= off.keys()]
    racks = [off[f"{k + 1}L"] - off[f"{k}R"] for k in range(1, len(results)) if {f"{k + 1}L", f"{k}R"} <= off.keys()]
    every = np.array(list(off.values()))
    chi2 = [off[name] @ np.linalg.solve(places[name].covariance, off[name]) for name in names]
    return {
        "x m": _rms(every[:, 0]),
        "z m": _rms(every[:, 1]),
        "heading deg": _rms(every[:, 2]),
        "heading to the mean deg": _rms(every[:, 2] - every[:, 2].mean()),
        "across an aisle x m": _rms(np.array(aisles).reshape(-1, 3)[:, 0]),
        "across an aisle z m": _rms(np.array(aisles).reshape(-1, 3)[:, 1]),
        "along a rack's faces m": _rms(np.array(racks).reshape(-1, 3)[:, 0]),
        "off, in sigmas": float(np.sqrt(np.mean(chi2) / 3)),
    }


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else float("nan")


def shares(results: Sequence[Result], score: Score) -> dict[str, float]:
    """Elements missing and spurious, of all there are."""
    count = sum(sum(own.elements.values()) for own in results)
    missing, spurious = (sum(counts.values()) for counts in (score.missing, score.spurious))
    return {
        "elements": count,
        "missing": missing,
        "spurious": spurious,
        "missing or spurious": (missing + spurious) / count,
    }


def table(results: Sequence[Result], score: Score) -> str:
    """The paper's figures beside those over all rows."""
    vertical, horizontal = (sum(own.elements[kind] for own in results) for kind in ("upright", "beam"))
    widths, gaps = (
        sum(len(errors) for name, errors in score.errors.items() if name.endswith(what)) for what in ("element", "gap")
    )
    ours = f"here: {len(results)} rows, {vertical} vertical and {horizontal} horizontal elements, "
    error = f"{100 * (mean_absolute_error(score) or 0.0):.2f} cm"
    return (
        f"{PAPER_COUNTS}\n{ours}{widths} element and {gaps} gap widths, {error}\n{as_table(Evaluation({'all': score}))}"
    )


def mapped_rows(tasks: Sequence[Task], jobs: int) -> list[Result]:
    """All rows, in worker processes that live to the end, so that what they do not give back would show."""
    print(
        f"{'':5} {'row':>5}{'V':>6}{'H':>6}{'missing':>9}{'spurious':>10}{'MAE cm':>9}{'seconds':>9}{'MB':>8}",
        flush=True,
    )
    results = []
    with multiprocessing.get_context("spawn").Pool(jobs) as workers:
        for number, result in enumerate(workers.imap(one_row, tasks), start=1):
            results.append(result)
            print(line(number, result), flush=True)
    return results


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", type=int, default=46)
    parser.add_argument("--sections", type=int, default=15)
    parser.add_argument("--frames-a-section", type=int, default=20)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "bench" / "results" / "site46")
    arguments = parser.parse_args()
    tasks = [Task(number, arguments.sections, arguments.frames_a_section) for number in range(arguments.rows)]
    results = mapped_rows(tasks, arguments.jobs)
    score = pool(own.score for own in results)
    assembly, seconds = site_of(results)
    figures = told(results, score, assembly, seconds)
    arguments.output.mkdir(parents=True, exist_ok=True)
    write_map(assembly.site_map, arguments.output / "map.json")
    write_box_plot(Evaluation({own.task.name: own.score for own in results}), arguments.output / "errors.png")
    write_text(arguments.output / "figures.json", json.dumps(figures, indent=2) + "\n")
    return int(figures["counts"]["missing or spurious"] > ALLOWED)


def told(results: Sequence[Result], score: Score, assembly: Assembly, seconds: float) -> dict[str, Any]:
    """Print what there is to say of all rows and of the site, and give it back."""
    trend, counts = trends(results), shares(results, score)
    print(
        f"\ntime a row: {trend['seconds first']:.1f} s in the first fifth, {trend['seconds last']:.1f} s in the last; "
        f"{1e3 * trend['seconds slope']:+.0f} +- {1e3 * trend['seconds slope sigma']:.0f} ms a row"
    )
    print(
        f"peak memory: {trend['peak_mb first']:.0f} MB in the first fifth, {trend['peak_mb last']:.0f} MB in the last; "
        f"{trend['peak_mb slope']:+.2f} +- {trend['peak_mb slope sigma']:.2f} MB a row"
    )
    verdict = "within" if counts["missing or spurious"] <= ALLOWED else "BEYOND"
    print(
        f"{counts['missing']} missing and {counts['spurious']} spurious of {counts['elements']}: {verdict} 1 in 1000\n"
    )
    print(table(results, score))
    known = {own.task.name: prior(own.task) for own in results}
    before, after = squareness(known, results), squareness(assembly.site_map.placements, results)
    print(
        f"assembly of {len(assembly.site_map.placements)} rows: {seconds:.2f} s; errors (rms) as given, and assembled"
    )
    for name, value in after.items():
        print(f"  {name:<26}{before[name]:10.4f}{value:10.4f}")
    print("\n".join([*assembly.notes, *site_lines(assembly.site_map)]))
    return {
        "trend": trend,
        "counts": counts,
        "score": score_json(score),
        "places given": before,
        "places": after,
        "assembly seconds": seconds,
        "rows": {
            own.task.name: {**score_json(own.score), "seconds": own.seconds, "peak_mb": own.peak_mb, "error": own.error}
            for own in results
        },
    }


if __name__ == "__main__":
    sys.exit(main())
