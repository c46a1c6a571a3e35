"""Coming back to mapped rows: is the place right or refused, and are changes found that another pass shows?

    python -m bench against [--set dev] [--passes 50] [--errors fine|paper]

Ten simulated rows of ten bays at observation level make a map: in five of them bays differ in their levels, in five all bays are alike but for a
few millimetres of installation, two of these alike one another, and two with a sign in each bay. A pass shows three to six bays of a row, or a
whole row; a beam was moved, taken out or put in since. It has a drive and masks' errors of its own, and no reference. By kind of row: passes whose
place is right, which are refused since several places are as likely, and which are taken for another place; the share of changes that are found,
and of unchanged elements that are told as changed; how far places in the map are from the truth before and after.
"""

import argparse
import copy
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from bench.baseline import Figures
from bench.compare import ERRORS, true_boxes
from bench.observed_rows import (
    ESTIMATED,
    LOWEST_SIGMA_M,
    SIGN_SIGMA_M,
    Given,
    driven_along,
    given,
    mapped,
    rack,
    row_map,
    sign,
    start_of,
    tracked,
)
from bench.seeds import SETS, is_test, seeds
from savmap.apps.dates.comparison.records import CHANGES, ElementChange
from savmap.apps.dates.returning.recognition import SURE, likely_places
from savmap.apps.dates.returning.update import in_row, updated
from savmap.errors import SavmapError
from savmap.graph import References, camera_priors, locate_camera, merge, solve
from savmap.pipeline.recognising import assumed_length, frame_references
from savmap.pipeline.row import FIRST_SOLVE
from savmap.types import Floats, RowMap, SiteMap
from savmap_shelves.constraints import GridSettings, constrain
from savmap_shelves.mapping import describe

Rack = dict[str, Any]
ROWS, BAYS = 10, 10
POST_M, INSTALLED_M = 0.1, 0.002
MOVES_M = (-0.1, -0.05, 0.05, 0.1)


@dataclass(frozen=True)
class Scene:
    """A mapped row: its rack, the kind of it, and its survey and map."""

    kind: str
    shelves: Rack
    survey: Mapping[str, Any]
    row: RowMap


@dataclass(frozen=True)
class Outcome:
    """What became of a pass: the kind of its row; `right`, `ambiguous` or `wrong`; changes there were and found, unchanged elements and those that
    are told as changed; absolute errors, m, of places before and after."""

    kind: str
    place: str
    changes: int = 0
    detected: int = 0
    unchanged: int = 0
    false: int = 0
    before: tuple[float, ...] = ()
    after: tuple[float, ...] = ()


def racks(rng: np.random.Generator) -> Iterator[tuple[str, Rack]]:
    """The ten rows: kind and rack."""
    for _ in range(ROWS // 2):
        yield "bays differ", rack(rng, BAYS, (4, 7), bridge=False)
    levels: Sequence[float] = ()
    for number in range(ROWS // 2):
        if number != 1:  # the second has the levels of the first
            levels = rack(rng, 1, (4, 7), bridge=False)["bays"][0]["beams"]
        bays = [
            {
                "width": float(rng.normal(3.55, INSTALLED_M)),
                "beams": (np.array(levels) + rng.normal(0, INSTALLED_M, len(levels))).round(4).tolist(),
            }
            for _ in range(BAYS)
        ]
        yield "bays alike" if number < 3 else "bays alike, signs", {**rack(rng, 1, (4, 4), bridge=False), "bays": bays}


def scene(number: int, kind: str, shelves: Rack, seed: int, errors: str) -> Scene:
    """A row and its map, made with references."""
    name = f"R{number}"
    rng = np.random.default_rng([seed, number, 5])
    driven = driven_along(shelves, 20000 + 100 * seed + number, rng, ERRORS[errors])
    measured = given(driven, rng, profiles=False)
    solved = mapped(driven, measured, GridSettings(measured.lowest_m, LOWEST_SIGMA_M, bias=ESTIMATED))
    row = row_map(name, driven, solved.solution, solved.structures)
    return Scene(kind, shelves, driven.survey, with_signs(row, shelves, name, 0, rng) if "signs" in kind else row)


def with_signs(
    row: RowMap, shelves: Rack, name: str, first: int, rng: np.random.Generator, scale: float = 1.0, low: float = 0.0
) -> RowMap:
    """The row with a sign at the left in each bay, half of whose error is its own, as in real maps, and whose text numbers the bays from `first`; one more where a pass ends within the row, for it
    shows that of the next bay."""
    left = np.cumsum([POST_M, *(bay["width"] + POST_M for bay in shelves["bays"])])
    left = left[: BAYS - first]
    signs = []
    for number, x in enumerate(left):
        corner = scale * (np.array([x + 0.4, 1.5, 0.01]) + rng.normal(0, SIGN_SIGMA_M / 2, 3)) + np.array([0, low, 0])
        signs.append(sign(number + 1, f"{name}-{first + number:02d}", corner, scale))
    return replace(row, structures={**row.structures, "signs": tuple(signs)})


def changed(shelves: Rack, rng: np.random.Generator) -> tuple[Rack, int]:
    """A rack in which a beam or two were moved, taken out or put in, and how many."""
    other, count = copy.deepcopy(shelves), int(rng.integers(1, 3))
    for bay in rng.choice(len(other["bays"]), count, replace=False).tolist():
        beams = other["bays"][bay]["beams"]
        level = int(rng.integers(1, len(beams)))
        match str(rng.choice(["moved", "taken out", "put in"])):
            case "moved":
                beams[level] = round(beams[level] + float(rng.choice(MOVES_M)), 4)
            case "taken out":
                del beams[level]
            case _:
                beams.insert(level, round((beams[level - 1] + beams[level]) / 2, 4))
    return other, count


def outcome(number: int, seed: int, scenes: Mapping[str, Scene], errors: str) -> Outcome:
    """A pass of one of the rows."""
    rng = np.random.default_rng([seed, number, 9])
    name = f"R{number % ROWS}"
    row = scenes[name]
    count = BAYS if rng.random() < 0.2 else int(rng.integers(3, 7))
    first = int(rng.integers(0, BAYS - count + 1))
    passed = {**row.shelves, "bays": row.shelves["bays"][first : first + count]}
    after, changes = changed(passed, rng)
    driven = driven_along(after, 30000 + 100 * seed + number, rng, ERRORS[errors])
    tracks = tracked(driven)
    start = start_of(driven, Given(References(), None))
    settings = GridSettings(None, LOWEST_SIGMA_M, bias=ESTIMATED)
    grid = constrain(tracks, driven.measurements.facts, start, settings=settings)
    frames = camera_priors(driven.measurements.facts, start, References())
    located = locate_camera(merge(frames, grid, partial=True))
    frames = replace(frames, references=assumed_length(located.points.values()))
    solution = solve(merge(frames, grid, partial=True), FIRST_SOLVE)
    seen = row_map("1", driven, solution, describe(tracks, solution))
    if "signs" in row.kind:
        seen = with_signs(seen, after, name, first, rng, *_frame_of(seen, driven.survey))
    places = likely_places(seen, {key: other.row for key, other in scenes.items()})
    if not places or places[0][1] <= SURE:
        return Outcome(row.kind, "ambiguous")
    place = places[0][0]
    left = row.survey["uprights"][first][0] - row.survey["uprights"][0][0]
    if place.row != name or abs(float(place.shift_m[0]) - left) > 0.5:
        return Outcome(row.kind, "wrong")
    references = frame_references(place, row.row, seen.structures, solution)
    final = mapped(driven, Given(references, None), settings, tracks=tracks)
    pass_map = row_map("1", driven, final.solution, final.structures)
    pass_map = with_signs(pass_map, after, name, first, rng) if "signs" in row.kind else pass_map
    return _compared(row, in_row(pass_map, place, row.row), (first, passed, after), changes)


def _frame_of(row: RowMap, survey: Mapping[str, Any]) -> tuple[float, float]:
    """The scale of a row that was solved in any, and the height of its origin, by its survey."""
    x = np.concatenate([part.vertices[:, 0] for part in row.structures["shelves"]])
    lowest = min((part for part in row.structures["shelves"] if part.label == "beam"), key=lambda part: part.id)
    scale = float(np.ptp(x)) / float(survey["uprights"][-1][1] - survey["uprights"][0][0])
    return scale, float(lowest.vertices[:, 1].mean()) - scale * float(np.mean(survey["sections"][0]["beams"][0]))


def _compared(row: Scene, pass_map: RowMap, bays: tuple[int, Rack, Rack], count: int) -> Outcome:
    """What the comparison of a pass with its row tells of true changes, and what it tells beside. `bays`: number of the first bay that the pass
    shows, and the bays before and after the changes."""
    site_map, comparison = updated(SiteMap({pass_map.name: row.row}, {}), {pass_map.name: pass_map}, {})
    elements = comparison.rows[0].elements
    true = [*_true_changes(row, *bays)]
    told = [change for change in elements if change.state in CHANGES]
    detected = sum(any(_is_of(change, place) for change in told) for place in true)
    false = [change for change in told if not any(_is_of(change, place) for place in true)]
    same = [change for change in elements if change.state == "same"]
    before = _errors(row.row, [change.old_id or "" for change in same], row.survey)
    after = _errors(site_map.rows[pass_map.name], [change.old_id or "" for change in same], row.survey)
    assert len(true) >= count
    return Outcome(row.kind, "right", len(true), detected, len(same) + len(false), len(false), before, after)


def _true_changes(row: Scene, first: int, before: Rack, after: Rack) -> Iterator[Floats]:
    """Ranges (2, 2) m of x and y of the row in which a beam changed."""
    uprights = row.survey["uprights"]
    for number, (old, new) in enumerate(zip(before["bays"], after["bays"], strict=True)):
        x = uprights[first + number][1], uprights[first + number + 1][0]
        lost, added = (sorted(set(a["beams"]) - set(b["beams"])) for a, b in ((old, new), (new, old)))
        for y in [*lost, *added][:1] if lost and added else [*lost, *added]:
            others = [*lost, *added] if lost and added else [y]
            yield np.array([x, (min(others), max(others) + before["beam_height"])])


def _is_of(change: ElementChange, place: Floats) -> bool:
    """Whether a told change lies in the range of a true one."""
    x, y, _ = change.position_m.tolist()
    return bool(change.label == "beam" and place[0, 0] < x < place[0, 1] and place[1, 0] < y < place[1, 1])


def _errors(row: RowMap, names: Sequence[str], survey: Mapping[str, Any]) -> tuple[float, ...]:
    """How far, m, posts are off along x, and beams along y."""
    boxes, errors = true_boxes(survey), list[float]()
    for structure in row.structures["shelves"]:
        if structure.id in names:
            middle = (structure.vertices.min(axis=0) + structure.vertices.max(axis=0)) / 2
            axis = 0 if structure.label == "upright" else 1
            true = boxes[structure.label]
            place = np.array([middle[0], 0.0 if axis == 0 else middle[1]])
            nearest = true[int(np.linalg.norm(true[:, :2] - place, axis=1).argmin())]
            errors.append(abs(float(middle[axis] - nearest[axis])))
    return tuple(errors)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of this bench."""
    parser.add_argument("--set", choices=SETS, default="dev", help="of seeds")
    parser.add_argument("--passes", type=int, default=50)
    parser.add_argument("--errors", choices=tuple(ERRORS), default="fine")


def run(given: argparse.Namespace) -> Figures:
    """Shares over all passes."""
    seed = seeds("passes", given.set)[0]
    rng = np.random.default_rng([seed, 4747])
    scenes = {f"R{n}": scene(n, kind, shelves, seed, given.errors) for n, (kind, shelves) in enumerate(racks(rng))}
    outcomes = []
    for number in range(given.passes):
        try:
            result = outcome(number, seed, scenes, given.errors)
        except SavmapError as refusal:
            result = Outcome(scenes[f"R{number % ROWS}"].kind, "refused")
            print(f"pass {number}: {refusal}", flush=True)
        outcomes.append(result)
        if not is_test("passes", seed):
            told = f"{result.detected} of {result.changes} changes, {result.false} false"
            print(f"{number:4d} {result.kind:18s} {result.place:10s} {told}", flush=True)
    kinds = list(dict.fromkeys(result.kind for result in outcomes))
    return {kind: _figures([r for r in outcomes if kind in (r.kind, "all")]) for kind in (*kinds, "all")}


def _figures(outcomes: Sequence[Outcome]) -> dict[str, float]:
    changes, unchanged = (sum(getattr(r, name) for r in outcomes) for name in ("changes", "unchanged"))
    before, after = (np.concatenate([getattr(r, name) for r in outcomes]) for name in ("before", "after"))
    return {
        "passes": len(outcomes),
        **{place: sum(r.place == place for r in outcomes) for place in ("right", "ambiguous", "wrong", "refused")},
        "changes": changes,
        "found %": 100 * sum(r.detected for r in outcomes) / changes if changes else float("nan"),
        "unchanged": unchanged,
        "false %": 100 * sum(r.false for r in outcomes) / max(unchanged, 1),
        "before mm": 1000 * float(before.mean()) if len(before) else float("nan"),
        "after mm": 1000 * float(after.mean()) if len(after) else float("nan"),
    }
