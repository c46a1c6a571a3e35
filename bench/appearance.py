"""Does appearance help? Maps with and without points of no structure as relative motion, everything else the same.

    python bench/appearance.py SITE.yaml ... [--sigmas 1] [--keep DIR] [-o bench/results/appearance.json]

The first row of each site of simulated footage is seen once and solved without such points, then with them, as `appearance`
of the site file has it (`savmap.vision.flow`, `savmap.graph.appearance`), for each standard deviation that they are believed to,
px. Printed: mean absolute errors, cm: of all measures, of the uprights' widths, of the gaps between them, of their edges along x;
root mean square errors, mm: of the camera's places after rotation and translation, of its steps along x from frame to
frame. Besides: how many elements are missing or spurious, and the share of points that are left out.
"""

import argparse
import json
import pickle
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from peers import misplaced

from savmap.files.atomic import write_text
from savmap.graph import CameraPriors, Problem, Solution, camera_priors, locate_camera, merge, motion_constraints, solve
from savmap.maps.survey import read_survey
from savmap.pipeline.initial_poses import initial_path
from savmap.pipeline.measure import RowMeasurements, clip_of, observe
from savmap.pipeline.row import Followed, Row, follow
from savmap.plugin.manager import LoadedPlugin
from savmap.report.evaluation import score_json
from savmap.site.job import job_for, plugins_for
from savmap.types import Flow, Trajectory
from savmap.types.progress import SilentMonitor
from savmap.video.reader import panoramas
from savmap.vision.flow import FlowTracker
from savmap.vision.views import Renderer

ROOT = Path(__file__).parent.parent
COLUMNS = ("mae_cm", "V element", "V gap", "V edge", "camera_mm", "step_x_mm", "wrong", "left_out")
Figures = dict[str, float]


@dataclass(frozen=True)
class Case:
    """One row: what is asked, what was seen and followed of it, its frames' part of the problem, and the truth."""

    row: Row
    room: LoadedPlugin
    seen: RowMeasurements
    frames: CameraPriors
    followed: Followed
    truth: Trajectory
    survey: Mapping[str, Any]

    @property
    def problem(self) -> Problem:
        """The problem without points of no structure."""
        return merge(self.frames, *self.followed.every)

    def figures(self, solution: Solution, left_out: float = 0.0) -> Figures:
        """What a solution is worth."""
        tracks = self.followed.tracks[self.room.name]
        own = self.room.describe(tracks=tracks, facts=self.seen.facts, solution=solution)
        scores = score_json(self.room.evaluate(structures=own, survey=self.survey))
        measures = {**scores["classes"], **scores["edges"]}
        return {
            "mae_cm": 100 * scores["mae_m"],
            **{name: 100 * measures[name]["mae_m"] for name in ("V element", "V gap", "V edge")},
            **path_figures(solution.trajectory, self.truth),
            "wrong": sum(scores["missing"].values()) + sum(scores["spurious"].values()),
            "left_out": left_out,
        }


def path_figures(path: Trajectory, truth: Trajectory) -> Figures:
    """Root mean square errors, mm: of places after rotation and translation, of steps along x between neighbours."""
    own, true = (dict(zip(one.frames.tolist(), one.world_from_rig[:, :3, 3], strict=True)) for one in (path, truth))
    steps = np.array([own[f + 1] - own[f] - true[f + 1] + true[f] for f in own if f + 1 in own])
    return {
        "camera_mm": 1000 * misplaced(own, true, scaled=False),
        "step_x_mm": 1000 * float(np.sqrt(np.mean(steps[:, 0] ** 2))),
    }


def case_of(site: Path, keep: Path) -> Case:
    """See and follow the first pass of a site's first row; what is seen is kept in a folder and used again."""
    job = job_for(site, ["shelves"], keep)
    name = next(iter(job.site.rows))
    row = row_of(job, name)
    row = replace(row, passes=row.passes[:1])
    rooms = plugins_for(job, name)
    seen = looked(row, rooms, keep / f"{site.parent.name}.pickle")
    start = initial_path(row, seen)
    frames = camera_priors(seen.facts, start, row.references)
    survey = read_survey(site.with_name("survey.json")).rows[name]
    return Case(row, rooms[0], seen, frames, follow(row, rooms, seen, start, frames), true_path(site, name), survey)


def looked(row: Row, rooms: Sequence[LoadedPlugin], file: Path) -> RowMeasurements:
    """What is seen of a row, from a file if it is there."""
    if not file.is_file():
        file.write_bytes(pickle.dumps(observe(row.name, row.passes, rooms, SilentMonitor())))
    seen: RowMeasurements = pickle.loads(file.read_bytes())
    return seen


def true_path(site: Path, row: str) -> Trajectory:
    """The truth of simulated footage in the row's frame."""
    content = json.loads(site.with_name("poses.json").read_text(encoding="utf-8"))
    world_from_row = np.eye(4)
    world_from_row[:3, :3] = content["rows"][row]["world_from_row"]
    world_from_row[:3, 3] = content["rows"][row]["origin"]
    poses = np.array([entry["world_from_rig"] for entry in content["frames"]])
    return Trajectory(np.array([entry["frame"] for entry in content["frames"]]), np.linalg.inv(world_from_row) @ poses)


def flows(case: Case) -> tuple[Flow, ...]:
    """Points followed in each view that the room looked at."""
    wanted = sorted({feature.view for feature in case.seen.features[case.room.name]})
    renderer, tracker = Renderer(), FlowTracker()
    for panorama in panoramas(clip_of(case.row.passes[0])):
        for name in wanted:
            tracker.update(renderer.render(panorama, case.seen.facts.views[name]))
    return tracker.flows


def ways(case: Case, sigmas: Sequence[float]) -> Iterator[tuple[str, Figures]]:
    """Figures without points, then with them."""
    problem = case.problem
    yield "without", case.figures(solve(problem))
    points, path = flows(case), locate_camera(problem).path
    for sigma in sigmas:
        motion, counts = motion_constraints(points, path, problem.used, sigma)
        solution = solve(merge(problem.camera, *problem.parts, motion))
        yield f"{sigma:g} px", case.figures(solution, 1.0 - counts["points used"] / counts["points followed"])


def means(results: Mapping[str, Mapping[str, Figures]]) -> dict[str, Figures]:
    """Means over the rows, for each way."""
    return {
        way: {column: float(np.mean([result[way][column] for result in results.values()])) for column in COLUMNS}
        for way in next(iter(results.values()))
    }


def show(name: str, result: Mapping[str, Figures]) -> None:
    """A block of the table."""
    for way, figures in result.items():
        print(f"{name:16s} {way:8s}", *(f"{figures[column]:9.3f}" for column in COLUMNS), flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sites", type=Path, nargs="+")
    parser.add_argument("--sigmas", type=float, nargs="*", default=[1.0])
    parser.add_argument("--keep", type=Path, help="keep what is seen in this folder, and use what is there")
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "bench" / "results" / "appearance.json")
    arguments = parser.parse_args()
    results: dict[str, dict[str, Figures]] = {}
    print(f"{'row':16s} {'points':8s}", *(f"{column:>9s}" for column in COLUMNS))
    with tempfile.TemporaryDirectory() as temporary:
        keep = arguments.keep or Path(temporary)
        keep.mkdir(parents=True, exist_ok=True)
        for site in arguments.sites:
            results[site.parent.name] = dict(ways(case_of(site, keep), arguments.sigmas))
            show(site.parent.name, results[site.parent.name])
    show("mean", means(results))
    write_text(arguments.output, json.dumps(results, indent=2) + "\n")


if __name__ == "__main__":
    main()
