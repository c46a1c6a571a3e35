"""Members out of shape: are those that are beyond a limit named, and none else, and are standard deviations true?

    python -m bench inspection [--set dev] [--measured 40] [--rendered 3] [--keep DIR]

Of the rows' uprights every other one leans, and half of these are bowed; every third beam sags; beams are level to 1 mm
in 1 m in a bay, and to as much again each (`savmap_shelves.lab.random_racks.deformed`). `--measured` rows have four bays,
and no pictures: parts of edges are off by what those of made-up footage are off by (`MEASURED`), and go through the
same solve and measuring of shapes as those of footage. `--rendered` rows go from footage to map; DIR keeps it.

A member is named where its finding is amber or red. `beyond` and `within`: its true value is so by three standard
deviations of what was measured of it.
"""

import argparse
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from bench.baseline import Figures, table
from bench.observed_rows import LOWEST_SIGMA_M, DrivenRow, Given, driven_along, given, mapped, rack, start_of, tracked
from bench.rows import measured, only_one_row
from bench.seeds import SETS, is_test, seeds
from savmap.errors import SavmapError
from savmap.graph import References, camera_priors, locate_camera, merge
from savmap.lab.sim.observations import MaskErrors
from savmap.lab.sim.random_row import random_row
from savmap.lab.sim.scene.files import Scene, parse_scene
from savmap.lab.sim.simulate import simulate
from savmap.pipeline.row import map_rows
from savmap.types import Measured, RowMap, Structure, Track, Trajectory, ViewSpec
from savmap.types.progress import NoteCollector
from savmap_shelves.constraints import GridSettings, constrain
from savmap_shelves.constraints.constrain import PICTURES
from savmap_shelves.inspection.inspect import inspect
from savmap_shelves.inspection.limits import ShelvesLimits
from savmap_shelves.inspection.shapes import BOW, LEAN, SAG, TILT, straightened, with_shapes
from savmap_shelves.lab.rack import PERMILLE, Curve, Rack, beam_curve, upright_curve
from savmap_shelves.lab.random_racks import deformed
from savmap_shelves.mapping import number_of

FAMILY = "deformed rows"
MEASURED = MaskErrors(sigma_px=0.15, uneven_px=0.05, drift_px=0.1, warped_px=0.1)
"""Of parts of edges in made-up rows' panoramas: 0.1 px of beams' and 0.2 of uprights' from frame to frame; the warp is an
assumption."""
VIEW = ViewSpec("shelf", yaw_deg=-90.0, hfov_deg=130.0, width=1280, height=1600)
"""Pixels as large as those of a panorama 2,048 wide, from 1.5 m."""
BAYS, LEVELS, FRAMES_A_BAY = 4, (4, 6), 12
CODES = {"out-of-plumb": LEAN, "upright-bow": BOW, "beam-sag": SAG}
SURELY = 3.0


@dataclass(frozen=True)
class Shape:
    """What is measured of a member's shape: `what`, the value and its standard deviation, the true value, in the unit of
    its limit where it has one (else 0), and whether it was named."""

    what: str
    value: float
    sigma: float
    truth: float
    limit: float = 0.0
    named: bool = False


def deformed_scene(seed: int, frames: int) -> Scene:
    """A random row whose first rack is out of shape."""
    content = random_row(seed, frames).model_dump(mode="json")
    racks = content["structures"]["shelves"]["rows"]
    name = next(iter(racks))
    racks[name] = deformed(racks[name], np.random.default_rng([seed, 49]))
    return parse_scene(content, f"deformed row {seed}")


def shapes(structures: Sequence[Structure], made: Rack) -> Iterator[Shape]:
    """What was measured of members that are numbered as those of the rack."""
    inspection = inspect(structures, (), None, ShelvesLimits(), None, None, "shelves")
    findings = {(finding.subjects[0], CODES[finding.code]): finding for finding in inspection.findings}
    for structure in structures:
        curve = true_curve(structure, made)
        if curve is None:
            continue
        for what, truth in true_shape(structure, curve).items():
            value, finding = structure.attributes.get(what), findings.get((structure.id, what))
            if finding is not None and finding.value is not None and finding.sigma is not None:
                named = finding.grade in ("amber", "red")
                limit = getattr(ShelvesLimits(), "sag_share" if what == SAG else what).amber
                yield Shape(what, finding.value, finding.sigma, truth, limit, named)
            elif isinstance(value, Measured):
                yield Shape(what, value.value, value.sigma, truth)


def true_curve(structure: Structure, made: Rack) -> Curve | None:
    """How a mapped member is really bent; None where its bay has other beams than the rack's."""
    if structure.label == "upright":
        return upright_curve(made, number_of(structure, "upright") - 1)
    bay, level = number_of(structure, "bay") - 1, number_of(structure, "beam") - 1
    return beam_curve(made, bay, level) if level < len(made.bays[bay].beams) else None


def true_shape(structure: Structure, curve: Curve) -> dict[str, float]:
    """By attribute, the true value between the ends that the map has: a sag as a share of the span."""
    if structure.label == "beam":
        return {TILT: PERMILLE * curve.slope, SAG: -curve.bow / curve.length}
    low, high = structure.vertices[:, 1].min(), structure.vertices[:, 1].max()
    ends, middle = (curve.at(low), curve.at(high)), curve.at((low + high) / 2)
    length = (high - low) / PERMILLE
    return {LEAN: (ends[1] - ends[0]) / length, BOW: (middle - sum(ends) / 2) / length}


def measured_row(seed: int) -> list[Shape]:
    """Of a row without pictures. Raises SavmapError."""
    rng = np.random.default_rng([seed, 46])
    shelves = deformed(rack(rng, BAYS, LEVELS, bridge=False), rng)
    driven = driven_along(shelves, seed, rng, MEASURED, FRAMES_A_BAY, VIEW, parts=True)
    known = given(driven, np.random.default_rng([seed, 7]), profiles=False)
    grid, facts = GridSettings(known.lowest_m, LOWEST_SIGMA_M, bias=PICTURES), driven.measurements.facts
    tracks = tracked(driven)
    row = mapped(driven, known, grid, tracks=straightened(tracks, facts, found_path(driven, known, tracks)))
    path, landmarks = row.solution.trajectory, row.solution.landmarks_of("shelves")
    structures = with_shapes(row.structures, row.tracks, facts, path, landmarks)
    return [*shapes(structures, Rack.model_validate(shelves))]


def found_path(driven: DrivenRow, known: Given, tracks: Sequence[Track]) -> Trajectory:
    """The path that the tracks give without references, as `located_by` of `savmap.pipeline.path` has it."""
    first = start_of(driven, known)
    frames = camera_priors(driven.measurements.facts, first, References())
    grid = constrain(tracks, driven.measurements.facts, first, settings=GridSettings(bias=PICTURES))
    return locate_camera(merge(frames, grid, partial=True)).path


def rendered_row(seed: int, folder: Path, frames: int) -> list[Shape]:
    """Of a row from footage, kept in a folder. Raises SavmapError."""
    if not (folder / "site.yaml").is_file():
        simulate(deformed_scene(seed, frames), folder)
    site = only_one_row(folder / "site.yaml")
    if site is None:
        return []
    content = yaml.safe_load(site.read_text(encoding="utf-8"))
    content["plugins"]["shelves"] = {"plumb": True}
    site.write_text(yaml.safe_dump(content), encoding="utf-8")
    (row,) = map_rows([measured(site, folder / "out").row], NoteCollector())
    if not isinstance(row, RowMap):
        raise row
    scene = yaml.safe_load((folder / "scene.yaml").read_text(encoding="utf-8"))
    made = Rack.model_validate(scene["structures"]["shelves"]["rows"][row.name])
    return [*shapes(_whole_bays(row.structures["shelves"], made), made)]


def _whole_bays(structures: Sequence[Structure], made: Rack) -> list[Structure]:
    """What is numbered as in the rack: nothing where uprights are missing or invented, nor of bays where beams are."""
    if sum(part.label == "upright" for part in structures) != len(made.bays) + 1:
        return []
    beams: dict[int, int] = defaultdict(int)
    for part in structures:
        if part.label == "beam":
            beams[number_of(part, "bay")] += 1
    whole = {bay for bay, count in beams.items() if count == len(made.bays[bay - 1].beams)}
    return [part for part in structures if part.label == "upright" or number_of(part, "bay") in whole]


def totals(results: Sequence[Shape]) -> Figures:
    """Figures of each kind of shape."""
    return {what: _figures([shape for shape in results if shape.what == what]) for what in (LEAN, BOW, TILT, SAG)}


def _figures(results: Sequence[Shape]) -> dict[str, float]:
    errors = np.array([shape.value - shape.truth for shape in results])
    sigmas = np.array([shape.sigma for shape in results])
    unit = PERMILLE if results and results[0].what == SAG else 1.0
    figures: dict[str, float] = {"members": len(results)}
    if not results:
        return figures
    figures |= {
        "error mm/m": unit * float(np.median(np.abs(errors))),
        "sigma mm/m": unit * float(np.median(sigmas)),
        "error / sigma": float(np.sqrt(np.mean((errors / sigmas) ** 2))),
    }
    limits = np.array([shape.limit for shape in results])
    if limits.any():
        named, far = np.array([shape.named for shape in results]), np.abs([shape.truth for shape in results]) - limits
        beyond, within = far > SURELY * sigmas, far < -SURELY * sigmas
        figures |= {"beyond": int(beyond.sum()), "named %": _percent(named[beyond])}
        figures |= {"within": int(within.sum()), "falsely named %": _percent(named[within])}
    return figures


def _percent(named: np.ndarray[Any, np.dtype[np.bool_]]) -> float:
    return 100 * float(named.mean()) if len(named) else 0.0


def tasks(arguments: argparse.Namespace, base: Path) -> Iterator[tuple[int, Callable[[], list[Shape]]]]:
    """The rows that the arguments ask for, by seed."""
    numbers = seeds(FAMILY, arguments.set)
    yield from ((seed, partial(measured_row, seed)) for seed in numbers[: arguments.measured])
    for seed in numbers[: arguments.rendered]:
        yield seed, partial(rendered_row, seed, base / f"deformed-row-{seed}", arguments.frames)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of this bench."""
    parser.add_argument("--set", choices=SETS, default="train", help="of seeds")
    parser.add_argument("--measured", type=int, default=40, help="how many rows without pictures")
    parser.add_argument("--rendered", type=int, default=0, help="how many rows from footage")
    parser.add_argument("--frames", type=int, default=40, help="of rendered footage")


def run(arguments: argparse.Namespace) -> Figures:
    """Figures over all rows, of each kind of shape."""
    results: list[Shape] = []
    refused = 0
    for seed, work in tasks(arguments, arguments.keep):
        try:
            results += (of_row := work())
        except SavmapError as error:
            refused += 1
            of_row = []
            if not is_test(FAMILY, seed):
                print(f"{seed:6d}  {str(error)[:100]}", flush=True)
        if not is_test(FAMILY, seed):
            print(seed, table(totals(of_row)), sep="\n", flush=True)
    return {**totals(results), "total": {"refused": refused}}
