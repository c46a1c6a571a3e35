"""Made-up rows from footage to scored map: missing, spurious, error, verdict.

    python -m bench rows [--set dev] [--count 20] [--family "grey rows" ...] [--references camera] [--row second]
                         [--without paint] [--keep DIR]

Families: `rows` are random short ones; `grey rows` have beams and decks of one grey in flat light; `dark rows` are dark
and thin in a dark hall; of `long rows` the bays come six times over. `--references`: all that the footage comes with (camera height, lowest beams, a length), `length`
(camera height and length), or `camera` (its height only), which is what most users have at first. `--row second` maps
the rack on the right of the drive, another random one, where the drive goes past all of it; `both` maps either.

`--without` switches a term of the face's model off. Below the totals stands how often objects of each probability
exist. DIR keeps footage and what the walk along it saw: another run only finds and solves. Remove the folders `stages`
in it where code that walks has changed.

The acceptance table: `--set test --family rows "grey rows" "dark rows" --count 20 --row both`.
"""

import argparse
import json
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import yaml
from threadpoolctl import threadpool_limits

import savmap
from bench.baseline import Figures
from bench.seeds import SETS, is_test, seeds
from savmap.errors import SavmapError
from savmap.files.journal import Journal
from savmap.jobs.cache import FolderCache
from savmap.jobs.tasks import request_for
from savmap.lab.sim.random_row import random_row
from savmap.lab.sim.scene.files import Scene, parse_scene
from savmap.lab.sim.simulate import simulate
from savmap.maps.map_file import write_map
from savmap.maps.survey import read_survey
from savmap.pipeline.records import MeasuredRow
from savmap.pipeline.row import map_rows, measure
from savmap.report.evaluation import as_json
from savmap.site.job import job_for
from savmap.types import SiteMap, Trajectory
from savmap.types.progress import NoteCollector
from savmap_shelves import find
from savmap_shelves.face_model import FaceReader
from savmap_shelves.find import face_reader
from savmap_shelves.lab.fit import LaidSurvey
from savmap_shelves.lab.looks import darkened, greyed
from savmap_shelves.likelihood import fitted

FAMILIES = ("rows", "grey rows", "dark rows", "long rows")
ROWS = ("first", "second")
"""The rows of a simulated aisle, left and right of the drive."""
TERMS: Mapping[str, Mapping[str, Any]] = {
    "paint": {"paint": 0.0},
    "occlusion": {"hidden": (0.0,), "chances": (1.0,)},
    "shared levels": {"shared": 0.0},
    "profile": {"profile": 1e3},
    "beams' plane": {},
}
"""Terms of the face's model, and the parameters that switch them off. Without the beams' plane, what is solved of their
depth is withheld."""
BINS = (0.0, 0.1, 0.5, 0.9, 0.99, 1.0)
"""Of probabilities, in the table of reliability; the model names none below 0.01."""
SCORES = ("mae_m", "missing", "spurious", "lights", "ends of lights")
GOOD_M = 0.01
"""A row that is right within this should be trusted."""
SLACK_M, TIMES = 0.3, 6


def footage(seed: int, frames: int, folder: Path, family: str = "rows") -> Path:
    """The site file of a random row's footage, made unless it exists."""
    site = folder / "site.yaml"
    if not site.is_file():
        scene = random_row(seed, frames)
        changed = {
            "grey rows": lambda: greyed(scene, seed),
            "dark rows": lambda: darkened(scene, seed),
            "long rows": lambda: lengthened(scene, TIMES),
        }
        simulate(changed[family]() if family in changed else scene, folder)
    return site


def is_driven_past(site: Path, row: str) -> bool:
    """Whether the camera of a simulated aisle comes past a row from end to end."""
    scene = yaml.safe_load(site.with_name("scene.yaml").read_text(encoding="utf-8"))
    uprights = json.loads(site.with_name("survey.json").read_text(encoding="utf-8"))["rows"][row]["uprights"]
    origin, facing = scene["rows"][row]["x"], scene["rows"][row]["facing"]
    ends = np.array([uprights[0][0], uprights[-1][1]]) * (1 if facing == "+z" else -1) + origin
    drive = sorted((scene["cart"]["start"][0], scene["cart"]["end"][0]))
    return bool(drive[0] - SLACK_M <= ends.min() and ends.max() <= drive[1] + SLACK_M)


def only_one_row(site: Path, which: str = "first", references: str = "all") -> Path | None:
    """A copy of a site file that maps its first or its second row alone, with so many of its references; None where it has no second one, or the
    drive does not go past the whole of that."""
    content = yaml.safe_load(site.read_text(encoding="utf-8"))
    names = list(content["rows"])[ROWS.index(which) :]
    if not names or (which != ROWS[0] and not is_driven_past(site, names[0])):
        return None
    name = names[0]
    row = content["rows"][name]
    content["rows"] = {name: row}
    if references != "all":
        row.pop("plugins", None)
    if references == "camera":
        row.pop("references", None)
    path = site.with_name(f"{which}-row.yaml" if references == "all" else f"{which}-row-{references}.yaml")
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    return path


@dataclass(frozen=True, eq=False)
class FaceMeasurements:
    """A row that was measured, and the evidence and the path by which the model read its face last."""

    row: MeasuredRow
    reader: FaceReader
    path: Trajectory


def measured(site: Path, output: Path, plugins: Sequence[str] | None = None) -> FaceMeasurements:
    """The only row of a site, measured; what the walk along it saw is kept in a folder, and used again there. Raises
    SavmapError."""
    job = job_for(site, plugins, output)
    request = request_for(job, next(iter(job.site.rows)))
    walk, key = FolderCache(output).frames(request.name), " ".join(plugin.name for plugin in request.plugins)
    readers: list[tuple[FaceReader, Trajectory]] = []

    def kept(gather: Any, path: Trajectory, *given: Any) -> FaceReader:
        readers.append((face_reader(gather, path, *given), path))
        return readers[-1][0]

    with threadpool_limits(1, "blas"), Journal(walk, key) as journal, patch.object(find, "face_reader", kept):
        (row,) = measure([request], journal, NoteCollector())
    if isinstance(row, SavmapError):
        raise row
    return FaceMeasurements(row, *readers[-1])


@contextmanager
def without(term: str | None) -> Iterator[None]:
    """While this lasts, a term of the face's model is switched off."""
    with ExitStack() as stack:
        if term is not None:
            parameters = replace(fitted(), **TERMS[term])
            stack.enter_context(patch.object(find, "fitted", lambda: parameters))
        if term == "beams' plane":
            stack.enter_context(patch.object(find, "beam_depth", lambda _: 0.0))
        yield


def survey_on_face(site: Path, face: FaceMeasurements) -> LaidSurvey:
    """The surveyed members of the only row of a simulated site, where they are on the face's evidence."""
    name = face.row.request.name
    truth = json.loads(site.with_name("poses.json").read_text(encoding="utf-8"))
    frame = truth["rows"][name]
    stamps_s = np.array([shot["stamp_s"] for shot in truth["frames"]])
    filmed = face.row.measurements.facts.frames.stamps_s[face.path.frames]
    nearest = np.abs(stamps_s[:, None] - filmed).argmin(axis=0)
    poses = np.array([truth["frames"][number]["world_from_rig"] for number in nearest.tolist()])
    places = (poses[:, :3, 3] - frame["origin"]) @ np.array(frame["world_from_row"])
    survey = read_survey(site.with_name("survey.json")).rows[name]
    laid = LaidSurvey.by_path(survey, face.path.world_from_rig[:, :3, 3], places)
    return laid.moved_to(face.row.measurements.objects["shelves"])


def score(site: Path, output: Path) -> dict[str, Any]:
    """Map a site and score it; an error counts as everything missing and is named."""
    start = time.perf_counter()
    figures: dict[str, Any] = {}
    try:
        face = measured(site, output)
        figures["objects"] = [*survey_on_face(site, face).existing(face.row.measurements.objects["shelves"])]
        with threadpool_limits(1, "blas"):
            (row,) = map_rows([face.row], NoteCollector())
        if isinstance(row, SavmapError):
            raise row
        site_map = SiteMap({row.name: row}, {})
        write_map(site_map, output / "map.json")
        scores = as_json(savmap.evaluate(site_map, site.with_name("survey.json")))
        figures |= {key: scores[key] for key in SCORES if key in scores}
        figures["verdict"] = row.verdict.grade if row.verdict else "-"
        figures["codes"] = {warning.code for warning in row.verdict.warnings} if row.verdict else set()
    except SavmapError as error:
        figures["error"] = str(error)
    return {**figures, "seconds": time.perf_counter() - start}


def is_whole(figures: Mapping[str, Any]) -> bool:
    """Whether a row's map misses nothing and invents nothing, lamps as well as the racks' elements."""
    return "error" not in figures and counted(figures) == (0, 0)


def counted(figures: Mapping[str, Any]) -> tuple[int, int]:
    """How many elements a row's map misses, and how many it invents."""
    lamps = figures.get("lights", {})
    return (
        sum(figures["missing"].values()) + lamps.get("missing", 0),
        sum(figures["spurious"].values()) + lamps.get("spurious", 0),
    )


def line(seed: int, figures: Mapping[str, Any]) -> str:
    """A printed row of the table."""
    if "error" in figures:
        return f"{seed:6d}  {figures['error'][:100]}"
    missing, spurious = counted(figures)
    lamps = figures.get("lights", {}).get("mae_m")
    lamp_text = f"{100 * lamps:8.2f}" if lamps is not None else "       -"
    error, seconds = 100 * figures["mae_m"], figures["seconds"]
    return f"{seed:6d} {missing:8d} {spurious:9d} {error:8.2f} {lamp_text} {seconds:9.1f}  {figures['verdict']}"


def totals(results: Sequence[Mapping[str, Any]]) -> Figures:
    """Figures over all faces, and how often objects of each probability exist; errors are those of mapped faces."""
    scored = [figures for figures in results if "error" not in figures]
    counts = np.array([counted(figures) for figures in scored], np.int64).reshape(-1, 2).sum(axis=0)
    lamps = [figures["lights"]["mae_m"] for figures in scored if figures.get("lights", {}).get("mae_m") is not None]
    errors = [100 * figures["mae_m"] for figures in scored if figures["mae_m"] is not None]
    trusted = [figures for figures in scored if figures["verdict"] == "trusted"]
    total: dict[str, float] = {
        "rows": len(results),
        "whole": sum(map(is_whole, scored)),
        "racks whole": sum(not any(counted({**figures, "lights": {}})) for figures in scored),
        "lamps whole": sum(not any(counted({**figures, "missing": {}, "spurious": {}})) for figures in scored),
        "good": sum(map(is_good, scored)),
        "good trusted": sum(map(is_good, trusted)),
        "trusted": len(trusted),
        "refused": len(results) - len(scored),
        "missing": int(counts[0]),
        "spurious": int(counts[1]),
    }
    if errors:
        total |= {"mean cm": float(np.mean(errors)), "largest cm": max(errors)}
    if lamps:
        total["lamps cm"] = 100 * float(np.mean(lamps))
    for code in sorted({code for figures in scored if is_good(figures) for code in figures.get("codes", ())}):
        total[f"good, {code}"] = sum(is_good(figures) and code in figures.get("codes", ()) for figures in scored)
    total["seconds a row"] = float(np.mean([figures["seconds"] for figures in results]))
    return {**reliability([pair for figures in results for pair in figures.get("objects", ())]), "total": total}


def is_good(figures: Mapping[str, Any]) -> bool:
    """Whether a row's map is whole, and its errors are small."""
    errors = (figures["mae_m"], figures.get("lights", {}).get("mae_m"))
    return is_whole(figures) and all(error is None or error <= GOOD_M for error in errors)


def reliability(objects: Sequence[tuple[float, bool]]) -> Figures:
    """By bins of the probability of objects: how many, their mean probability, and the share that exists."""
    table = {}
    likely, exist = np.array([pair[0] for pair in objects]), np.array([pair[1] for pair in objects], np.bool_)
    numbers = np.digitize(likely, BINS[1:-1])
    for number, (low, high) in enumerate(pairwise(BINS)):
        inside = numbers == number
        if inside.any():
            cells = {"objects": int(inside.sum()), "mean P": likely[inside].mean(), "exist": exist[inside].mean()}
            table[f"P {low:g} to {high:g}"] = {key: float(value) for key, value in cells.items()}
    return table


def lengthened(scene: Scene, times: int) -> Scene:
    """The scene with the first rack's bays so many times over, the others, the hall and the drive longer by as much."""
    content = scene.model_dump(mode="json")
    racks, cart = content["structures"]["shelves"]["rows"], content["cart"]
    more = (times - 1) * _length(next(iter(racks.values())))
    for name, rack in racks.items():
        before, bays = _length(rack), rack["bays"]
        count = max(1, round(len(bays) * (before + more) / before))
        rack["bays"] = [bays[number % len(bays)] for number in range(count)]
        if content["rows"][name]["facing"] == "-z":
            content["rows"][name]["x"] += _length(rack) - before
    content["hall"]["x"][1] += more + 6.0
    cart["start" if cart["start"][0] > cart["end"][0] else "end"][0] += more
    cart["frames"] *= times
    return parse_scene(content, "long row")


def _length(rack: Mapping[str, Any]) -> float:
    """m."""
    return float(sum(bay["width"] for bay in rack["bays"]))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of this bench."""
    parser.add_argument(
        "--set", choices=SETS, default="dev", help="of seeds; rows of `test` are printed as totals only"
    )
    parser.add_argument("--count", type=int, help="of rows; all of the set")
    parser.add_argument("--family", choices=FAMILIES, nargs="+", default=FAMILIES[:1])
    parser.add_argument("--frames", type=int, default=40)
    parser.add_argument("--references", choices=["all", "length", "camera"], default="all")
    parser.add_argument(
        "--row", choices=[*ROWS, "both"], default=ROWS[0], help="the row on the left or on the right of the drive"
    )
    parser.add_argument("--without", choices=TERMS, help="a term of the face's model that is switched off")


def run(given: argparse.Namespace) -> Figures:
    """Map each row of the set."""
    results: list[dict[str, Any]] = []
    print("  seed  missing  spurious  MAE cm  lamps cm  seconds  verdict", flush=True)
    with without(given.without):
        for family, seed, site, output in sites(given, given.keep):
            results.append(score(site, output))
            if not is_test(family, seed):
                print(line(seed, results[-1]), flush=True)
    return totals(results) if results else {}


def sites(given: argparse.Namespace, base: Path) -> Iterator[tuple[str, int, Path, Path]]:
    """Family and seed of each face that the arguments ask for, its site file, and the folder of what is kept of it. Of
    a rack that is not there, or not driven past from end to end, there is none."""
    for family in given.family:
        for seed in seeds(family, given.set, given.count):
            folder = base / f"{family.replace(' ', '-')[:-1]}-{seed}"
            made = footage(seed, given.frames, folder, family)
            for row in ROWS if given.row == "both" else (given.row,):
                site = only_one_row(made, row, given.references)
                if site is not None:
                    yield family, seed, site, folder / ("out" if row == ROWS[0] else f"out-{row}")
