"""Pairs of simulated rows, an old and a new one, with known changes: maps at observation level, and what truly changed.

Shared by compare.py. Both dates have a drive, masks' errors and references of their own.
"""

import copy
import json
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from observed_rows import ESTIMATED, LOWEST_SIGMA_M, driven_along, given, mapped, rack

from savmap.files.atomic import write_text
from savmap.lab.sim.observations import PAPER, MaskErrors
from savmap.maps.map_file import read_map, write_map
from savmap.types import Attribute, FrameTable, RowMap, SiteMap, Structure
from savmap_shelves.constraints import GridSettings

Rack = dict[str, Any]
ERRORS: Mapping[str, MaskErrors] = {
    "paper": PAPER,
    "fine": MaskErrors(0.25, missed=0.05, incomplete=0.2, outliers=0.02, bias_px=0.2, uneven_px=0.03, drift_px=0.1),
}
"""`paper`: as in the published experiment. `fine`: edges measured in the panorama itself, about a quarter of a pixel."""
SIGN_SIGMA_M = 0.01
UPRIGHT_M = 0.1


@dataclass(frozen=True)
class Pair:
    """An old and a new map of a row, and both dates' surveys."""

    case: str
    seed: int
    old: SiteMap
    new: SiteMap
    surveys: tuple[Mapping[str, Any], Mapping[str, Any]]


def _beams(rack: Rack, rng: np.random.Generator) -> None:
    """Beams of three bays moved up or down by 5, 10 and 50 mm."""
    bays = rng.choice(len(rack["bays"]), 3, replace=False)
    for number, by_m in zip(bays.tolist(), (0.005, 0.010, 0.050), strict=True):
        beams = rack["bays"][number]["beams"]
        level = int(rng.integers(1, len(beams)))
        beams[level] = round(beams[level] + by_m * float(rng.choice([-1, 1])), 4)


def _bay_and_post(rack: Rack, rng: np.random.Generator) -> None:
    """A bay with all its levels set anew, and another bay's left post pushed aside by 15 mm. A sign is replaced in the map."""
    rebuilt, bent = rng.choice(np.arange(1, len(rack["bays"])), 2, replace=False).tolist()
    bay = rack["bays"][rebuilt]
    count, lowest = len(bay["beams"]) + int(rng.choice([-1, 1])), bay["beams"][0]
    levels = 6.2 / count * (np.arange(1, count) + rng.uniform(-0.1, 0.1))
    bay["beams"] = [lowest, *(lowest + levels).round(4).tolist()]
    by = 0.015 * float(rng.choice([-1, 1]))
    rack["bays"][bent - 1]["width"] += by
    rack["bays"][bent]["width"] -= by


def _left(rack: Rack, rng: np.random.Generator) -> None:
    """A bay more at the left end, where the row's frame begins."""
    rack["bays"].insert(0, {"width": 2.7, "beams": [0.2, 1.7, 3.3, 5.1, 6.4]})


def _nothing(rack: Rack, rng: np.random.Generator) -> None:
    pass


CHANGES: Mapping[str, Callable[[Rack, np.random.Generator], None]] = {
    "nothing": _nothing,
    "beams": _beams,
    "bay, post, sign": _bay_and_post,
    "bay at the left": _left,
}


def pair(case: str, seed: int, errors: str, sections: int, folder: Path) -> Pair:
    """The pair of a case and seed; maps in the folder are used again. Raises SavmapError where a row cannot be mapped."""
    rng = np.random.default_rng([seed, 4646])
    old = rack(rng, sections, (4, 7), bridge=False)
    new = copy.deepcopy(old)
    CHANGES[case](new, rng)
    maps, surveys = [], []
    for date, shelves in enumerate((old, new)):
        name = "-".join(["old"] if date == 0 else re.findall("[a-z]+", case))
        site_map, survey = _mapped(shelves, seed, date, errors, folder / f"{errors}-{sections}-{seed}-{name}.json")
        maps.append(_with_signs(site_map, shelves, seed, date, case))
        surveys.append(survey)
    return Pair(case, seed, maps[0], maps[1], (surveys[0], surveys[1]))


def _mapped(shelves: Rack, seed: int, date: int, errors: str, path: Path) -> tuple[SiteMap, Mapping[str, Any]]:
    sheet = path.with_suffix(".survey")
    if path.is_file() and sheet.is_file():
        return read_map(path), json.loads(sheet.read_text(encoding="utf-8"))
    rng = np.random.default_rng([seed, date, 5])
    driven = driven_along(shelves, 10000 + 2 * seed + date, rng, ERRORS[errors])
    write_text(sheet, json.dumps(driven.survey))
    if path.is_file():
        return read_map(path), driven.survey
    known = given(driven, rng, profiles=False)
    row = mapped(driven, known, GridSettings(known.lowest_m, LOWEST_SIGMA_M, bias=ESTIMATED))
    table = driven.measurements.facts.frames
    row_map = RowMap(
        "A",
        FrameTable(table.stamps_s, table.passes),
        dict(driven.measurements.facts.views),
        row.solution.trajectory,
        {"shelves": tuple(row.structures)},
        (),
        dict(row.solution.report),
    )
    site_map = SiteMap({"A": row_map}, {})
    write_map(site_map, path)
    return site_map, driven.survey


def _with_signs(site_map: SiteMap, shelves: Rack, seed: int, date: int, case: str) -> SiteMap:
    """The map with a sign at 1.5 m in each section, mapped to `SIGN_SIGMA_M`; on the second date one may have another text."""
    rng = np.random.default_rng([seed, date, 6])
    left = np.cumsum([UPRIGHT_M, *(bay["width"] + UPRIGHT_M for bay in shelves["bays"][:-1])])
    other = int(np.random.default_rng([seed, 8]).integers(len(left))) if "sign" in case and date else -1
    signs = []
    first = 0 if "left" in case and date else 1
    for number, x in enumerate(left):
        text = f"A{number + first:02d}" if number != other else f"B{number + 31:02d}"
        corner = np.array([x + 0.4, 1.5, 0.01]) + rng.normal(0, SIGN_SIGMA_M, 3)
        quad = corner + np.array([[0, 0.2, 0], [0.3, 0.2, 0], [0.3, 0, 0], [0, 0, 0.0]])
        labels = tuple(f"sign {number + 1} / {part}" for part in range(4))
        covariances = np.tile(SIGN_SIGMA_M**2 * np.eye(3), (4, 1, 1))
        edges = np.array([[0, 1], [1, 2], [2, 3], [3, 0]])
        attributes: dict[str, Attribute] = {"sign": number + 1, "text": text, "confidence": 0.99, "code": ""}
        signs.append(Structure(f"sign {number + 1}", "sign", quad, covariances, labels, edges, attributes))
    row = site_map.rows["A"]
    return replace(site_map, rows={"A": replace(row, structures={**row.structures, "signs": tuple(signs)})})
