"""What each part buys on footage: the published method, ours on the masks' edges, and on edges measured in the panorama.

    python bench/footage.py [SITE ...] [--sizes 2048,4096,7680] [--keep DIR] [-o bench/results/footage.json]

Without a site the scene examples/scenes/precise-row.yaml is simulated at each width and its row mapped. The networks see
each frame twice, once for each kind of edge. Beside the last way stand Cramer-Rao bounds: the mean absolute error of widths and
gaps, 0.8 of their standard deviation, if only noise of the size that the residuals show were to blame: independent from frame to
frame, and persisting from frame to frame as the residuals do.
"""

import argparse
import json
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from uncertainty import figures

from savmap.cli.console import Console
from savmap.errors import SavmapError
from savmap.files.atomic import write_text
from savmap.graph import PUBLISHED, Problem, merge, solve
from savmap.jobs.tasks import request_for
from savmap.lab.sim.scene.files import load_scene
from savmap.lab.sim.simulate import simulate
from savmap.maps.survey import read_survey
from savmap.pipeline.records import LocatedRow
from savmap.pipeline.row import locate, measure, track_plugin
from savmap.plugin.manager import open_plugin
from savmap.report.evaluation import mean_absolute_error
from savmap.site.job import job_for
from savmap.types import Score, Track
from savmap_shelves.constraints import GridSettings, constrain, published
from savmap_shelves.constraints.constrain import NO_BIAS
from savmap_shelves.mapping import describe
from savmap_shelves.report.evaluation import evaluate

ROOT = Path(__file__).parent.parent
SCENE = ROOT / "examples" / "scenes" / "precise-row.yaml"
WAYS = ("published", "masks' edges", "measured edges")


@dataclass(frozen=True, eq=False)
class TrackedShelves:
    """One row of a site measured with one kind of edges: the row, the lowest beams' heights, its tracks, its truth."""

    row: LocatedRow
    lowest: Any
    tracks: list[Track]
    survey: Mapping[str, Any]


def track_shelves(site_file: Path, subpixel: bool, console: Console) -> TrackedShelves:
    """Measure and track a site's first row with the shelves plugin."""
    job = job_for(site_file, ["shelves"], site_file.parent)
    name = next(iter(job.site.rows))
    settings = job.site.plugin_config(name, "shelves")
    plugin = open_plugin("shelves", {**settings, "subpixel": subpixel})
    row = locate(measure(replace(request_for(job, name), plugins=[plugin]), console))
    assert job.site.survey is not None
    survey = read_survey(job.site.survey).rows[name]
    return TrackedShelves(row, settings["lowest_beam_bottom_height_m"], track_plugin(plugin, row, None), survey)


def problem_of(shelves: TrackedShelves, settings: GridSettings) -> Problem:
    """The row's problem for the graph with given settings."""
    row = shelves.row
    return merge(row.frames, constrain(shelves.tracks, row.measurements.facts, row.start, settings=settings))


def ours(shelves: TrackedShelves) -> GridSettings:
    """The settings of the main job."""
    return GridSettings(shelves.lowest["values"], shelves.lowest["sigma"])


def bounds_cm(shelves: TrackedShelves) -> tuple[float, float]:
    """The mean absolute error of widths and gaps that noise of the residuals' size leaves: independent from frame to
    frame; persisting as long as the residuals do."""
    solution = solve(problem_of(shelves, replace(ours(shelves), bias=NO_BIAS)))
    sigmas = [s for kind, _, s in figures(shelves.survey, shelves.tracks, solution) if "edge" not in kind]
    persisting = 100 * float(np.sqrt(2 / np.pi) * np.mean(sigmas))
    scale, inflation = (float(solution.report[key]) for key in ("residual_scale", "variance_inflation"))
    return persisting * scale / float(np.sqrt(inflation)), persisting


def figures_of(score: Score) -> dict[str, Any]:
    """Figures of one map, cm."""
    mean = {name: 100 * float(np.mean(score.errors[name])) for name in ("V element", "H element")}
    return {
        "mae_cm": 100 * (mean_absolute_error(score) or float("nan")),
        "missing": sum(score.missing.values()),
        "spurious": sum(score.spurious.values()),
        **{f"{name} mean_cm": value for name, value in mean.items()},
    }


def ways(site_file: Path, console: Console) -> Iterator[tuple[str, dict[str, Any]]]:
    """Each way's figures on one footage."""
    masks, measured = (track_shelves(site_file, subpixel, console) for subpixel in (False, True))
    plans = (
        (masks, published(masks.lowest["values"], masks.lowest["sigma"]), PUBLISHED),
        (masks, ours(masks), None),
        (measured, ours(measured), None),
    )
    for name, (shelves, settings, options) in zip(WAYS, plans, strict=True):
        try:
            solution = solve(problem_of(shelves, settings), options)
            result = figures_of(evaluate(describe(shelves.tracks, solution), shelves.survey))
        except SavmapError as error:
            yield name, {"error": str(error)}
            continue
        if name == WAYS[-1] and not result["missing"] + result["spurious"]:
            result["bounds_cm"] = bounds_cm(shelves)
        yield name, result


def footage(size: int, folder: Path, console: Console) -> Path:
    """The site file of the scene's footage of a given width, made unless it is there."""
    site = folder / f"precise-{size}" / "site.yaml"
    if not site.is_file():
        scene = load_scene(SCENE)
        cart = scene.cart.model_copy(update={"width": size})
        simulate(scene.model_copy(update={"cart": cart}), site.parent, console)
    return site


def line(name: str, result: Mapping[str, Any]) -> str:
    """One line of the table."""
    if "error" in result:
        return f"  {name:16}{result['error'][:100]}"
    bounds = "".join(f"{bound:9.3f}{result['mae_cm'] / bound:7.1f}" for bound in result.get("bounds_cm", ()))
    means = "".join(f"{result[f'{kind} element mean_cm']:10.2f}" for kind in "VH")
    return f"  {name:16}{result['missing']:8d}{result['spurious']:9d}{result['mae_cm']:9.2f}{means}{bounds}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sites", nargs="*", type=Path)
    parser.add_argument("--sizes", default="2048,4096,7680")
    parser.add_argument("--keep", type=Path, help="keep footage in this folder")
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "bench" / "results" / "footage.json")
    arguments = parser.parse_args()
    results: dict[str, dict[str, Any]] = {}
    print(
        f"{'cm':18}{'missing':>8}{'spurious':>9}{'MAE':>9}{'V bias':>10}{'H bias':>10}{'bound':>9}{'ratio':>7}{'persists':>9}{'ratio':>7}"
    )
    with tempfile.TemporaryDirectory() as scratch, Console(Path(scratch) / "log") as console:
        folder = arguments.keep or Path(scratch)
        made = (footage(int(size), folder, console) for size in arguments.sizes.split(","))
        for site in arguments.sites or made:
            print(site.absolute().parent.name, flush=True)
            results[site.absolute().parent.name] = by_way = {}
            for name, result in ways(site, console):
                by_way[name] = result
                print(line(name, result), flush=True)
    write_text(arguments.output, json.dumps(results, indent=2) + "\n")


if __name__ == "__main__":
    main()
