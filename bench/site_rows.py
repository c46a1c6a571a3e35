"""Aisles of a whole site at observation level: two faces each, seen on one drive or on one drive each; racks with two faces; lamps.

The masks' errors and the way from features to maps are those of `observed_rows`.
"""

from collections.abc import Hashable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from observed_rows import ESTIMATED, FACING, LOWEST_SIGMA_M, VIEW, DrivenRow, Mapped, given, mapped, rack

from savmap.lab.sim.drive.cart import drive
from savmap.lab.sim.observations import PAPER
from savmap.lab.sim.scene.build import build
from savmap.lab.sim.scene.files import parse_scene
from savmap.pipeline.records import RowMeasurements
from savmap.types import Floats, FrameTable, Placement, RowFacts, RowMap, Structure, ViewSpec
from savmap.vision.markers import MarkerTracks
from savmap_shelves.constraints import GridSettings
from savmap_shelves.lab.observed import observe, observed_features

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
    scene = parse_scene(
        {
            "seed": task.aisle,
            "hall": {"x": [-8.0, length + 8.0], "z": [-4.0, AISLE_M + 4.0], "height": 9.0},
            "goods": {"density": 0.0},
            "cart": cart(length, task, seed),
            "rows": {"L": {"x": 0.0, "z": 0.0}, "R": {"x": length, "z": AISLE_M, "facing": "-z"}},
            "structures": {"shelves": {"rows": racks}},
        }
    )
    built, path = build(scene), drive(scene.cart, seed)
    right = task.side == "R"
    view = replace(VIEW, yaw_deg=90.0) if right else VIEW
    edges = observe(built, task.side, path, view, PAPER, 1000 + task.number)
    features = [feature for frame in edges for feature in observed_features(frame, view, PAPER.sigma_px)]
    measurements = observations(task.name, path.stamps_s, view, features, -1 if right else 1)
    return DrivenRow(built, path, measurements, task.side)


def observations(name: str, stamps_s: Floats, view: ViewSpec, features: list[Any], travel: int) -> RowMeasurements:
    """What one pass saw of a row in which the camera went along x or back."""
    facts = RowFacts(name, FrameTable(stamps_s, ("pass 1",) * len(stamps_s)), {view.name: view}, {"pass 1": travel})
    facing = np.diag([travel, 1.0, travel]) @ FACING
    return RowMeasurements(
        facts, {"shelves": features}, {"pass 1": facing}, frozenset({"shelves"}), (), MarkerTracks({}, {})
    )


def cart(length: float, task: Task, seed: int) -> dict[str, Any]:
    """The drive through the aisle."""
    return {
        "start": [-1.0, AISLE_M / 2],
        "end": [length + 1.0, AISLE_M / 2],
        "height": float(np.random.default_rng([seed, 46]).normal(3.0, 0.02)),
        "frames": task.frames_a_section * (task.sections + 1),
        "sway": 0.06,
        "speed_variation": 0.3,
    }


def hash_of(recording: Hashable) -> int:
    """A seed that is the same for all rows of a drive."""
    return int.from_bytes(str(recording).encode()[-6:], "big")


def mapped_row(task: Task, driven: DrivenRow) -> tuple[Mapped, RowMap]:
    """The row's map by the program's way, with lamps beside the shelves."""
    known = given(driven, np.random.default_rng([task.number, 7]))
    row = mapped(driven, known, GridSettings(known.lowest_m, LOWEST_SIGMA_M, bias=ESTIMATED))
    facts, solution = driven.measurements.facts, row.solution
    structures = {"shelves": tuple(row.structures), "lights": tuple(lamps(task))}
    return row, RowMap(
        task.name, facts.frames, facts.views, solution.trajectory, structures, solution.references, solution.report
    )


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
