"""A whole site at observation level, from start to site map: 46 rows of 15 sections, 23 aisles, racks with two faces.

    python -m bench site46 [--rows 46] [--sections 15] [--frames-a-section 20] [--jobs 2] [--keep DIR]

Each row is mapped by the program's tracking, constraints and solve from masks' edges with the errors of `PAPER`, with references off by
their sigmas (camera height 2 cm, lowest edges 2 mm, length 3 mm, two widths 1 mm). The rows are put into one frame (`savmap.assembly`)
from places good to 20 cm and half a degree. Printed: rows, what of time and memory grows from the first row to the last, the table of errors
over all rows, the places' errors before and after. `--keep` writes map.json and errors.png into DIR. The paper: 46 rows, 736 vertical and 4920
horizontal elements, 2890 element and 2547 gap widths, 4.8 cm.
"""

import argparse
import multiprocessing
import resource
import time
from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from bench.baseline import Figures
from bench.observed_rows import (
    ESTIMATED,
    LOWEST_SIGMA_M,
    VIEW,
    DrivenRow,
    Mapped,
    cart,
    given,
    mapped,
    rack,
    row_map,
    seen_row,
)
from savmap.assembly import Assembly, assembled
from savmap.errors import SavmapError
from savmap.lab.sim.drive.cart import drive
from savmap.lab.sim.observations import PAPER
from savmap.lab.sim.scene.build import build
from savmap.lab.sim.scene.files import parse_scene
from savmap.maps.map_file import write_map
from savmap.plugin.manager import open_plugin
from savmap.report.evaluation import as_table, mean_absolute_error
from savmap.report.picture import write_box_plot
from savmap.types import (
    Evaluation,
    Floats,
    Placement,
    RowMap,
    Score,
    SiteMap,
    Structure,
    pool,
)
from savmap_shelves.constraints import GridSettings

AISLE_M, PITCH_M = 3.0, 4.2
UPRIGHT_M = 0.1
LAMP_STEP_M, LAMP_Y_M = 3.4, 8.4
LAMP_SIGMA_M = np.array([0.03, 0.05, 0.03])
PLACE_SIGMA_M, PLACE_SIGMA_DEG = 0.2, 0.5
APART = 3


@dataclass(frozen=True)
class Task:
    """Row `number`, from 0: the left face of aisle number / 2, or the right one."""

    number: int
    sections: int
    frames_a_section: int

    @property
    def aisle(self) -> int:
        return self.number // 2

    @property
    def side(self) -> str:
        return "LR"[self.number % 2]

    @property
    def name(self) -> str:
        return f"{self.aisle + 1}{self.side}"

    @property
    def recording(self) -> Hashable:
        """The drive: one an aisle, but one a face in every third aisle."""
        alone = self.side if self.aisle % APART == APART - 1 else ""
        return f"aisle {self.aisle + 1}{alone}"

    @property
    def place(self) -> Placement:
        """Where the row truly stands."""
        right = self.side == "R"
        x = length_of(widths(self.aisle + 1, self.sections)) if right else 0.0
        z = PITCH_M * self.aisle + (AISLE_M if right else 0.0)
        return Placement(x, z, 180.0 if right else 0.0, np.zeros((3, 3)))


def widths(number: int, sections: int) -> list[float]:
    """Clear widths of a rack's bays along the site's x; rack k's faces look into aisles k - 1 and k."""
    clear = np.random.default_rng([number, 4646]).normal(3.55, 0.005, sections)
    return [round(float(width), 4) for width in clear]


def length_of(clear: list[float]) -> float:
    """From the first upright's outer edge to the last one's."""
    return sum(clear) + (len(clear) + 1) * UPRIGHT_M


def driven_row(task: Task) -> DrivenRow:
    """What a camera saw of the row, from its drive through the aisle."""
    racks = {}
    for side, number in (("L", task.aisle), ("R", task.aisle + 1)):
        clear = widths(number, task.sections)
        shelves = rack(np.random.default_rng([task.aisle, "LR".index(side), 46]), task.sections, (5, 11))
        shelves["bays"] = [
            {**bay, "width": w} for bay, w in zip(shelves["bays"], clear[:: 1 if side == "L" else -1], strict=True)
        ]
        racks[side] = shelves
    length = length_of(widths(task.aisle + 1, task.sections))
    seed = hash_of(task.recording)
    height = float(np.random.default_rng([seed, 46]).normal(3.0, 0.02))
    scene = parse_scene(
        {
            "seed": task.aisle,
            "hall": {"x": [-8.0, length + 8.0], "z": [-4.0, AISLE_M + 4.0], "height": 9.0},
            "goods": {"density": 0.0},
            "cart": cart(length, AISLE_M / 2, height, task.frames_a_section * (task.sections + 1)),
            "rows": {"L": {"x": 0.0, "z": 0.0}, "R": {"x": length, "z": AISLE_M, "facing": "-z"}},
            "structures": {"shelves": {"rows": racks}},
        }
    )
    built, path = build(scene), drive(scene.cart, seed)
    right = task.side == "R"
    view = replace(VIEW, yaw_deg=90.0) if right else VIEW
    return seen_row(built, task.side, path, view, PAPER, 1000 + task.number, task.name, -1 if right else 1)


def hash_of(recording: Hashable) -> int:
    """A seed that is the same for all rows of a drive."""
    return int.from_bytes(str(recording).encode()[-6:], "big")


def mapped_row(task: Task, driven: DrivenRow) -> tuple[Mapped, RowMap]:
    """The row's map by the program's way, with lamps beside the shelves."""
    known = given(driven, np.random.default_rng([task.number, 7]))
    row = mapped(driven, known, GridSettings(known.lowest_m, LOWEST_SIGMA_M, bias=ESTIMATED))
    with_racks = row_map(task.name, driven, row.solution, row.structures)
    structures = {**with_racks.structures, "lights": tuple(lamps(task))}
    return row, replace(with_racks, structures=structures, references=row.solution.references)


def lamps(task: Task) -> Iterator[Structure]:
    """The lamps over the aisle, as the row might have mapped them."""
    x = np.arange(1.7, length_of(widths(task.aisle, task.sections)), LAMP_STEP_M)
    z = PITCH_M * task.aisle + AISLE_M / 2
    place = np.linalg.inv(task.place.site_from_row)
    points = np.stack([x, np.full(len(x), LAMP_Y_M), np.full(len(x), z)], axis=1) @ place[:3, :3].T + place[:3, 3]
    rng = np.random.default_rng([task.number, 8])
    for number, point in enumerate(points[np.argsort(points[:, 0])], start=1):
        off = rng.normal(0, LAMP_SIGMA_M)
        covariance = np.diag(LAMP_SIGMA_M**2)[None]
        edges = np.zeros((0, 2), np.int64)
        yield Structure(f"light {number}", "light", (point + off)[None], covariance, ("centre",), edges)


def prior(task: Task) -> Placement:
    """Where the row is said to stand, off by its own sigmas."""
    rng = np.random.default_rng([task.number, 9])
    place, sigma = task.place, np.array([PLACE_SIGMA_M, PLACE_SIGMA_M, PLACE_SIGMA_DEG])
    x, z, heading = np.array([place.x_m, place.z_m, place.heading_deg]) + rng.normal(0, sigma)
    return Placement(float(x), float(z), float(heading), np.diag(sigma**2))


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


def map_task(task: Task) -> Result:
    """Make and map one row."""
    driven = driven_row(task)
    elements = {
        "upright": len(driven.survey["uprights"]),
        "beam": sum(len(section["beams"]) for section in driven.survey["sections"]),
    }
    begin = time.process_time()
    try:
        mapped, row = mapped_row(task, driven)
        score, error = mapped.score, ""
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
    """Mean seconds and memory over the first and the last fifth of the rows."""
    fifth = max(len(results) // 5, 1)
    parts = {"first": results[:fifth], "last": results[-fifth:]}
    seconds = {f"s a row, {name}": float(np.mean([one.seconds for one in part])) for name, part in parts.items()}
    return seconds | {f"peak MB, {name}": float(np.mean([one.peak_mb for one in part])) for name, part in parts.items()}


def site_of(results: Sequence[Result]) -> tuple[Assembly, float]:
    """The assembled site, and the seconds that took."""
    rows = {result.task.name: result.row for result in results if result.row is not None}
    failed = {result.task.name: result.error for result in results if result.row is None}
    plugins = {name: open_plugin(name, {}) for name in ("shelves", "lights")}
    begin = time.perf_counter()
    assembly = assembled(
        SiteMap(rows, {}, failed),
        {result.task.name: prior(result.task) for result in results},
        {result.task.name: {"pass 1": result.task.recording} for result in results},
        lambda _row, plugin, structures: plugins[plugin].cross_row_landmarks(structures),
    )
    return assembly, time.perf_counter() - begin


def place_errors(places: Mapping[str, Placement], results: Sequence[Result]) -> Floats:
    """x m, z m, heading degrees (n, 3) of the rows against the truth."""
    off = []
    for result in results:
        if result.task.name in places:
            place, true = places[result.task.name], result.task.place
            turn = (place.heading_deg - true.heading_deg + 180) % 360 - 180
            off.append([place.x_m - true.x_m, place.z_m - true.z_m, turn])
    return np.array(off).reshape(-1, 3)


def squareness(places: Mapping[str, Placement], results: Sequence[Result]) -> dict[str, float]:
    """Errors (root mean square) of faces across an aisle, along both faces of a rack, and of headings among themselves."""
    names = [result.task.name for result in results if result.task.name in places]
    off = dict(zip(names, place_errors(places, results), strict=True))
    aisles = [off[f"{k}R"] - off[f"{k}L"] for k in range(1, len(results)) if {f"{k}L", f"{k}R"} <= off.keys()]
    racks = [off[f"{k + 1}L"] - off[f"{k}R"] for k in range(1, len(results)) if {f"{k + 1}L", f"{k}R"} <= off.keys()]
    headings = np.array([error[2] for error in off.values()])
    return {
        "across an aisle x m": _rms(np.array([error[0] for error in aisles])),
        "along a rack's faces m": _rms(np.array([error[0] for error in racks])),
        "heading to the mean deg": _rms(headings - headings.mean()),
    }


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else float("nan")


def mapped_rows(tasks: Sequence[Task], jobs: int) -> list[Result]:
    """All rows, in worker processes that live to the end, so that what they do not give back would show."""
    print(
        f"{'':5} {'row':>5}{'V':>6}{'H':>6}{'missing':>9}{'spurious':>10}{'MAE cm':>9}{'seconds':>9}{'MB':>8}",
        flush=True,
    )
    results = []
    with multiprocessing.get_context("spawn").Pool(jobs) as workers:
        for number, result in enumerate(workers.imap(map_task, tasks), start=1):
            results.append(result)
            print(line(number, result), flush=True)
    return results


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of this bench."""
    parser.add_argument("--rows", type=int, default=46)
    parser.add_argument("--sections", type=int, default=15)
    parser.add_argument("--frames-a-section", type=int, default=20)
    parser.add_argument("--jobs", type=int, default=1)


def run(given: argparse.Namespace) -> Figures:
    """Figures of all rows and of the assembled site."""
    tasks = [Task(number, given.sections, given.frames_a_section) for number in range(given.rows)]
    results = mapped_rows(tasks, given.jobs)
    assembly, seconds = site_of(results)
    write_map(assembly.site_map, given.keep / "map.json")
    write_box_plot(Evaluation({result.task.name: result.score for result in results}), given.keep / "errors.png")
    return figures_of(results, assembly, seconds)


def figures_of(results: Sequence[Result], assembly: Assembly, seconds: float) -> Figures:
    """Figures of all rows and of the site."""
    score = pool(result.score for result in results)
    print(as_table(Evaluation({"all": score})))
    stated = {result.task.name: prior(result.task) for result in results}
    before, after = squareness(stated, results), squareness(assembly.site_map.placements, results)
    return {
        "as given": before,
        "assembled": after,
        "total": {
            "elements": sum(sum(result.elements.values()) for result in results),
            "missing": sum(score.missing.values()),
            "spurious": sum(score.spurious.values()),
            "mean cm": 100 * (mean_absolute_error(score) or float("nan")),
            **trends(results),
            "assembly s": seconds,
        },
    }
