"""Two dates of one place: are changes found, and is nothing reported that did not happen?

    python -m bench compare [--set dev] [--pairs 20] [--sections 10] [--errors fine|paper] [--keep DIR]

Pairs of simulated rows at observation level, each date with a drive, masks' errors and references of its own: nothing changed; beams moved by
5, 10 and 50 mm; a bay rebuilt, a post pushed aside by 15 mm and a sign replaced; a bay added at the left, where the row's frame begins. By kind
of change: how many there were, the share that was found, and both for those whose true size is over 3, and over 5, of the test's standard
deviations; and the share of unchanged elements that were reported as changed. Maps in DIR are used again.
"""

import argparse
import copy
import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from bench.baseline import Figures
from bench.observed_rows import (
    ESTIMATED,
    LOWEST_SIGMA_M,
    SIGN_SIGMA_M,
    driven_along,
    given,
    mapped,
    rack,
    row_map,
    sign,
)
from bench.seeds import SETS, seeds
from savmap.apps.dates.comparison.compare import LEVEL, compare_maps
from savmap.apps.dates.comparison.records import CHANGES as CHANGED
from savmap.apps.dates.comparison.records import ElementChange
from savmap.errors import SavmapError
from savmap.files.atomic import write_text
from savmap.lab.sim.observations import PAPER, MaskErrors
from savmap.maps.map_file import read_map, write_map
from savmap.types import Floats, SiteMap
from savmap_shelves.constraints import GridSettings

Rack = dict[str, Any]
ERRORS: Mapping[str, MaskErrors] = {
    "paper": PAPER,
    "fine": MaskErrors(0.25, missed=0.05, incomplete=0.2, outliers=0.02, bias_px=0.2, uneven_px=0.03, drift_px=0.1),
}
"""`paper`: as in the published experiment. `fine`: edges measured in the panorama itself, about a quarter of a pixel."""
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


CHANGES: Mapping[str, Callable[[Rack, np.random.Generator], None]] = {
    "nothing": lambda rack, rng: None,
    "beams": _beams,
    "bay, post, sign": _bay_and_post,
    "bay at the left": lambda rack, rng: rack["bays"].insert(0, {"width": 2.7, "beams": [0.2, 1.7, 3.3, 5.1, 6.4]}),
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
    known = given(driven, rng, profiles=False)
    row = mapped(driven, known, GridSettings(known.lowest_m, LOWEST_SIGMA_M, bias=ESTIMATED))
    site_map = SiteMap({"A": row_map("A", driven, row.solution, row.structures)}, {})
    write_map(site_map, path)
    return site_map, driven.survey


def _with_signs(site_map: SiteMap, shelves: Rack, seed: int, date: int, case: str) -> SiteMap:
    """The map with a sign at 1.5 m in each section, mapped to a centimetre; on the second date one may have another text."""
    rng = np.random.default_rng([seed, date, 6])
    left = np.cumsum([UPRIGHT_M, *(bay["width"] + UPRIGHT_M for bay in shelves["bays"][:-1])])
    other = int(np.random.default_rng([seed, 8]).integers(len(left))) if "sign" in case and date else -1
    signs = []
    first = 0 if "left" in case and date else 1
    for number, x in enumerate(left):
        text = f"A{number + first:02d}" if number != other else f"B{number + 31:02d}"
        corner = np.array([x + 0.4, 1.5, 0.01]) + rng.normal(0, SIGN_SIGMA_M, 3)
        signs.append(sign(number + 1, text, corner, code=""))
    row = site_map.rows["A"]
    return replace(site_map, rows={"A": replace(row, structures={**row.structures, "signs": tuple(signs)})})


NEAR_M = 0.2
SAME_M = 1e-4
FIGURES = ("x", "y", "size x", "size y")


@dataclass(frozen=True)
class Outcome:
    """An element of a pair: the kind of its true change ("" for none), its size in standard deviations, and what was reported."""

    case: str
    seed: int
    kind: str
    sigmas: float
    reported: str
    name: str


def true_boxes(survey: Mapping[str, Any]) -> dict[str, Floats]:
    """Middles and sizes along x and y (n, 4) m of the surveyed elements by label."""
    uprights = np.array(survey["uprights"], dtype=np.float64)
    posts = [[sum(x) / 2, 0.0, x[1] - x[0], 0.0] for x in uprights]
    beams = []
    for number, section in enumerate(survey["sections"]):
        left, right = uprights[number][1], uprights[number + 1][0]
        beams += [[(left + right) / 2, sum(y) / 2, right - left, y[1] - y[0]] for y in section["beams"]]
    return {"upright": np.array(posts), "beam": np.array(beams)}


def outcomes(compared: Pair, level: float) -> Iterator[Outcome]:
    """Each element of the comparison beside the truth; those that the maps missed or invented are left out."""
    old, new = (true_boxes(survey) for survey in compared.surveys)
    shift = 2.8 if "left" in compared.case else 0.0
    row = compare_maps(compared.old, compared.new, level=level).rows[0]
    if row.motion is None or row.motion.ambiguous:
        yield Outcome(compared.case, compared.seed, "row", np.inf, "not aligned", "A")
        return
    maps = [{s.id: s for group in m.rows["A"].structures.values() for s in group} for m in (compared.old, compared.new)]
    for change in row.elements:
        if change.plugin == "signs":
            yield _of_text(compared, change)
            continue
        truths = [
            _nearest(boxes[change.label], maps[k].get(name or ""))
            for k, (boxes, name) in enumerate(zip((old, new), (change.old_id, change.new_id), strict=True))
        ]
        if any(truth is None and name for truth, name in zip(truths, (change.old_id, change.new_id), strict=True)):
            continue  # the map invented it
        yield from _of_element(compared, change, truths, (old, new), shift)


def _of_text(compared: Pair, change: ElementChange) -> Outcome:
    texts = [one for one in change.differences if one.what == "text"]
    other = bool(texts) and texts[0].old != texts[0].new
    kind = "sign replaced" if other else "" if change.old_id and change.new_id else "new bay"
    return Outcome(compared.case, compared.seed, kind, np.inf if kind else 0.0, change.state, change.name)


def _nearest(boxes: Floats, structure: Any) -> Floats | None:
    if structure is None:
        return None
    middle = (structure.vertices.min(axis=0) + structure.vertices.max(axis=0)) / 2
    across = np.array([middle[0], 0.0 if structure.label == "upright" else middle[1]])
    apart = np.linalg.norm(boxes[:, :2] - across, axis=1)
    return boxes[int(apart.argmin())] if apart.min() < NEAR_M else None


def _of_element(
    compared: Pair,
    change: ElementChange,
    truths: Sequence[Floats | None],
    boxes: tuple[Mapping[str, Floats], Mapping[str, Floats]],
    shift: float,
) -> Iterator[Outcome]:
    before, after = truths
    if before is None or after is None:
        present, other = (after, boxes[0]) if before is None else (before, boxes[1])
        sign = -1 if before is None else 1
        place = present + sign * np.array([shift, 0, 0, 0]) if present is not None else np.zeros(4)
        there = np.abs(other[change.label][:, :2] - place[:2]).max(axis=1).min() < SAME_M
        if not there:  # otherwise the other map missed it
            kind = "new bay" if shift else "bay rebuilt"
            yield Outcome(compared.case, compared.seed, kind, np.inf, change.state, change.name)
        return
    moved = after - before - np.array([shift, 0, 0, 0])
    tested = {one.what: one.sigma_m for one in change.differences}
    sigmas = [abs(by) / (tested[what] or np.inf) for what, by in zip(FIGURES, moved, strict=True) if what in tested]
    kind = _kind(compared.case, change.label, moved)
    yield Outcome(compared.case, compared.seed, kind, float(max(sigmas, default=0.0)), change.state, change.name)


def _kind(case: str, label: str, moved: Floats) -> str:
    if np.abs(moved).max() < SAME_M:
        return ""
    by_mm = round(1000 * float(np.abs(moved).max()))
    if case == "beams":
        return f"beam {by_mm} mm"
    if abs(moved[1]) > SAME_M:
        return "bay rebuilt"
    return "post 15 mm" if label == "upright" else "beams at the post"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of this bench."""
    parser.add_argument("--set", choices=SETS, default="dev", help="of seeds")
    parser.add_argument("--pairs", type=int, help="of each case; all of the set")
    parser.add_argument("--sections", type=int, default=10)
    parser.add_argument("--errors", choices=tuple(ERRORS), default="fine")
    parser.add_argument("--level", type=float, default=LEVEL, help="of the false discovery rate")


def run(given: argparse.Namespace) -> Figures:
    """Shares over all pairs."""
    every: list[Outcome] = []
    folder = given.keep
    for seed in seeds("pairs", given.set, given.pairs):
        for case in CHANGES:
            try:
                every += outcomes(pair(case, seed, given.errors, given.sections, folder), given.level)
            except SavmapError as refusal:
                print(f"a pair of the case {case} is left out: {refusal}", flush=True)
    return {**found_changes(every), **false_alarms(every)}


def found_changes(every: Sequence[Outcome]) -> Figures:
    """By kind of change: counts, percent found, and the same over 3 and 5 standard deviations."""
    table = {}
    for kind in (*sorted({outcome.kind for outcome in every if outcome.kind}), "all changes"):
        changes = [outcome for outcome in every if outcome.kind and kind in (outcome.kind, "all changes")]
        table[kind] = {"count": len(changes), "found": _percent(changes)}
        for least in (3, 5):
            over = [outcome for outcome in changes if outcome.sigmas > least]
            table[kind] |= {f"over {least} sigma": len(over), f"found, over {least}": _percent(over)}
    return table


def false_alarms(every: Sequence[Outcome]) -> Figures:
    """By case: unchanged elements, and percent of them that were reported as changed."""
    table = {}
    for case in (*CHANGES, "all"):
        same = [outcome for outcome in every if not outcome.kind and case in (outcome.case, "all")]
        false = sum(outcome.reported in CHANGED for outcome in same)
        table[f"unchanged, {case}"] = {"count": len(same), "false": 100 * false / max(len(same), 1)}
    return table


def _percent(changes: Sequence[Outcome]) -> float:
    hits = sum(
        outcome.reported in CHANGED or (outcome.kind == "new bay" and outcome.reported == "not seen")
        for outcome in changes
    )
    return 100 * hits / len(changes) if changes else float("nan")
