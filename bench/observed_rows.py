"""Rows at observation level: a scene of the paper's size, masks' edges with their errors, and the way from there to a map.

Shared by site46, compare, against, inspection and cost; the tracking, constraints, solve and scoring are the program's.
"""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from savmap.graph import (
    CameraHeight,
    KnownLength,
    References,
    Solution,
    SolveOptions,
    camera_priors,
    merge,
    solve,
)
from savmap.lab.sim.drive.cart import Drive, drive
from savmap.lab.sim.observations import MaskErrors
from savmap.lab.sim.scene.build import Built, build
from savmap.lab.sim.scene.files import parse_scene
from savmap.pipeline.path import initial_path
from savmap.pipeline.records import RowMeasurements, RowRequest
from savmap.types import (
    Attribute,
    Floats,
    FrameTable,
    RowFacts,
    RowMap,
    Score,
    Structure,
    Track,
    Trajectory,
    ViewSpec,
)
from savmap.vision.markers import MarkerTracks
from savmap_shelves.association import track_structures
from savmap_shelves.constraints import GridSettings, constrain
from savmap_shelves.constraints.constrain import BiasSettings
from savmap_shelves.lab.observed import observe, observed_features, observed_parts
from savmap_shelves.mapping import describe
from savmap_shelves.report.evaluation import evaluate

VIEW = ViewSpec("shelf", yaw_deg=-90.0, hfov_deg=150.0)
"""640x480 and 150 degrees (paper, section IV.A): 1.75 cm a pixel at 1.5 m."""
ESTIMATED = BiasSettings(1.0, 0.25, 0.05, "estimated")
SIGN_SIGMA_M = 0.01
FACING = np.array([[0.0, 0, 1], [0, -1, 0], [1, 0, 0]])
HEIGHT_SIGMA_M, LOWEST_SIGMA_M, LENGTH_SIGMA_M, WIDTH_SIGMA_M = 0.02, 0.002, 0.003, 0.001
PROFILES = (
    ("upright 2 / left", "upright 2 / right"),
    ("bay 2 / beam 2 / lower", "bay 2 / beam 2 / upper"),
)


@dataclass(frozen=True)
class DrivenRow:
    """A row that a camera was driven along: the scene, the drive, what was measured, and the row's name there."""

    built: Built
    path: Drive
    measurements: RowMeasurements
    row: str = "A"

    @property
    def survey(self) -> Mapping[str, Any]:
        row: Mapping[str, Any] = self.built.survey["rows"][self.row]
        return row


@dataclass(frozen=True)
class Given:
    """What the user measured: references for the solve, and the heights of the lowest beams' bottom edges (or None)."""

    references: References
    lowest_m: tuple[float, ...] | None


@dataclass(frozen=True)
class Mapped:
    """A row's map: tracks, solution, structures, score, and the seconds that tracking and solving took."""

    tracks: list[Track]
    solution: Solution
    structures: list[Structure]
    score: Score
    seconds: float


def rack(rng: np.random.Generator, sections: int, levels: tuple[int, int], bridge: bool = True) -> dict[str, Any]:
    """A rack 7 m high of sections 3.55 m wide, with a bridge section in the middle."""
    bays = []
    for number in range(sections):
        count = int(rng.integers(levels[0], levels[1] + 1))
        pitch = 6.6 / count
        bottoms = rng.uniform(0.12, 0.4) + pitch * np.arange(count) + rng.uniform(-0.04, 0.04, count)
        if bridge and number == sections // 2:
            bottoms = bottoms[bottoms > 2.6]
        bays.append({"width": float(rng.normal(3.55, 0.005)), "beams": bottoms.round(4).tolist()})
    return {"upright_width": 0.1, "beam_height": 0.1, "height": 7.2, "bays": bays, "labels": 0.0, "bracing": False}


def driven_row(
    seed: int,
    errors: MaskErrors,
    sections: int = 15,
    levels: tuple[int, int] = (5, 11),
    frames_a_section: int = 20,
) -> DrivenRow:
    """A random row and what a camera saw that was pushed along it once, 1.5 m away and 3 m high."""
    rng = np.random.default_rng([seed, 46])
    shelves = rack(rng, sections, levels)
    return driven_along(shelves, seed, rng, errors, frames_a_section)


def driven_along(
    shelves: dict[str, Any],
    seed: int,
    rng: np.random.Generator,
    errors: MaskErrors,
    frames_a_section: int = 20,
    view: ViewSpec = VIEW,
    parts: bool = False,
) -> DrivenRow:
    """A rack and what a camera saw that was pushed along it once; `rng` draws the camera's height. `parts`: of edges,
    each by itself, too."""
    length = sum(bay["width"] + 0.1 for bay in shelves["bays"]) + 0.1
    frames = frames_a_section * (len(shelves["bays"]) + 1)
    scene = parse_scene(
        {
            "seed": seed,
            "hall": {"x": [-8.0, length + 8.0], "z": [-4.0, 5.0], "height": 9.0},
            "goods": {"density": 0.0},
            "cart": cart(length, 1.5, float(rng.normal(3.0, 0.02)), frames),
            "rows": {"A": {"x": 0.0, "z": 0.0}},
            "structures": {"shelves": {"rows": {"A": shelves}}},
        }
    )
    return seen_row(build(scene), "A", drive(scene.cart, seed), view, errors, seed, parts=parts)


def cart(length: float, z: float, height: float, frames: int) -> dict[str, Any]:
    """The camera's drive past a row."""
    ends = {"start": [-1.0, z], "end": [length + 1.0, z]}
    return {**ends, "height": height, "frames": frames, "sway": 0.06, "speed_variation": 0.3}


def seen_row(
    built: Built,
    row: str,
    path: Drive,
    view: ViewSpec,
    errors: MaskErrors,
    seed: int,
    name: str = "A",
    travel: int = 1,
    parts: bool = False,
) -> DrivenRow:
    """What one pass saw of a scene's row, which is called `name`; `travel`: 1 or -1, along the row's x or back."""
    edges, nominal = observe(built, row, path, view, errors, seed), max(errors.sigma_px, 0.3)
    features = [feature for frame in edges for feature in observed_features(frame, view, nominal)]
    features += observed_parts(built, row, path, view, errors, seed, features) if parts else ()
    table = FrameTable(path.stamps_s, ("pass 1",) * len(path.stamps_s))
    facts = RowFacts(name, table, {view.name: view}, {"pass 1": travel})
    facing = {"pass 1": np.diag([travel, 1.0, travel]) @ FACING}
    shelves = frozenset({"shelves"})
    measurements = RowMeasurements(facts, {"shelves": features}, facing, shelves, (), MarkerTracks({}, {}))
    return DrivenRow(built, path, measurements, row)


def given(driven: DrivenRow, rng: np.random.Generator, profiles: bool = True) -> Given:
    """References off by their own sigmas: camera height, the lowest edges, the row's length, and, if asked for, the
    widths of one upright and of one beam."""
    height = float(driven.path.origins[:, 1].mean()) + rng.normal(0, HEIGHT_SIGMA_M)
    uprights = driven.survey["uprights"]
    span = uprights[-1][1] - uprights[0][0] + rng.normal(0, LENGTH_SIGMA_M)
    ends = ("upright 1 / left", f"upright {len(uprights)} / right")
    lengths: tuple[KnownLength, ...] = (KnownLength(*ends, span, LENGTH_SIGMA_M),)
    if profiles:
        lengths += tuple(KnownLength(*ends, 0.1 + rng.normal(0, WIDTH_SIGMA_M), WIDTH_SIGMA_M) for ends in PROFILES)
    lowest = [float(s["beams"][0][0] + rng.normal(0, LOWEST_SIGMA_M)) for s in driven.survey["sections"]]
    return Given(References((CameraHeight(height, HEIGHT_SIGMA_M, 0.02),), lengths), tuple(lowest))


def start_of(driven: DrivenRow, known: Given) -> Trajectory:
    """The pipeline's first path."""
    travel = float(np.ptp(driven.path.origins[:, 0]))
    return initial_path(RowRequest("A", (), (), known.references, round(travel, 0)), driven.measurements)


def tracked(driven: DrivenRow) -> list[Track]:
    """The plugin's tracks: there are no pictures to find objects in, so each feature has the one that it was made of."""
    return track_structures(driven.measurements.features["shelves"], driven.measurements.facts)


def mapped(
    driven: DrivenRow,
    known: Given,
    settings: GridSettings | None = None,
    options: SolveOptions | None = None,
    tracks: list[Track] | None = None,
) -> Mapped:
    """From features to a scored map, as `savmap.pipeline.row` chains it for a plugin."""
    begin = time.perf_counter()
    row_tracks = tracked(driven) if tracks is None else tracks
    first = start_of(driven, known)
    grid = constrain(
        row_tracks, driven.measurements.facts, first, settings=settings or GridSettings(known.lowest_m, LOWEST_SIGMA_M)
    )
    frames = camera_priors(driven.measurements.facts, first, known.references)
    solution = solve(merge(frames, grid), options)
    structures = describe(row_tracks, solution)
    seconds = time.perf_counter() - begin
    return Mapped(row_tracks, solution, structures, evaluate(structures, driven.survey), seconds)


def row_map(name: str, driven: DrivenRow, solution: Solution, structures: Sequence[Structure]) -> RowMap:
    """A solved row as a map has it."""
    table, views = driven.measurements.facts.frames, dict(driven.measurements.facts.views)
    stamps, shelves = FrameTable(table.stamps_s, table.passes), {"shelves": tuple(structures)}
    return RowMap(name, stamps, views, solution.trajectory, shelves, (), dict(solution.report))


def sign(number: int, text: str, corner: Floats, scale: float = 1.0, **attributes: Attribute) -> Structure:
    """A sign of 30 x 20 cm, by its lower left corner (3,) m, as a row might have mapped it whose unit is 1 / `scale` m."""
    quad = corner + scale * np.array([[0, 0.2, 0], [0.3, 0.2, 0], [0.3, 0, 0], [0, 0, 0.0]])
    labels = tuple(f"sign {number} / {part}" for part in range(4))
    covariances = np.tile((scale * SIGN_SIGMA_M) ** 2 * np.eye(3), (4, 1, 1))
    edges = np.array([[0, 1], [1, 2], [2, 3], [3, 0]])
    said: dict[str, Attribute] = {"sign": number, "text": text, "confidence": 0.99, **attributes}
    return Structure(f"sign {number}", "sign", quad, covariances, labels, edges, said)
