"""Two dates of one place: are known changes found, and is nothing told that is not there?

    python bench/compare.py [--pairs 20] [--sections 10] [--errors fine|paper] [--keep DIR] [-o bench/results/compare.json]

Pairs of simulated rows at observation level, each date with a drive, masks' errors and references of its own: nothing changed; beams moved by
5, 10 and 50 mm; a bay rebuilt, a post pushed aside by 15 mm and a sign replaced; a bay added at the left, where the row's frame begins. Printed
for each kind of change: how many there were, the share that was found, and both for those whose true size is over 3, and over 5, of the
test's own standard deviations; and the share of unchanged elements that were told as changed. Maps in DIR are used again.
"""

import argparse
import json
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from compared_rows import CHANGES, ERRORS, Pair, pair

from savmap.errors import SavmapError
from savmap.files.atomic import write_text
from savmap.maps.comparison import CHANGES as CHANGED
from savmap.maps.comparison import LEVEL, ElementChange, compare_maps
from savmap.types import Floats

ROOT = Path(__file__).parent.parent
NEAR_M = 0.2
SAME_M = 1e-4
FIGURES = ("x", "y", "size x", "size y")


@dataclass(frozen=True)
class Outcome:
    """An element of a pair: the kind of its true change ("" for none), its size in standard deviations, and what was told."""

    case: str
    seed: int
    kind: str
    sigmas: float
    told: str
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


def table(found: Sequence[Outcome]) -> Iterator[str]:
    """Found changes by kind, and false alarms by case."""
    yield f"{'change':20}{'count':>7}{'found':>8}{'over 3 sigma':>15}{'found':>8}{'over 5 sigma':>15}{'found':>8}{'sigmas':>8}"
    kinds = sorted({one.kind for one in found if one.kind})
    for kind in (*kinds, "all"):
        changes = [one for one in found if one.kind and kind in (one.kind, "all")]
        cells = [f"{len(changes):7d}{_share(changes):>8}"]
        for least in (3, 5):
            over = [one for one in changes if one.sigmas > least]
            cells.append(f"{len(over):15d}{_share(over):>8}")
        typical = np.median([one.sigmas for one in changes])
        yield f"{kind:20}" + "".join(cells) + f"{typical:8.1f}"
    yield f"\n{'unchanged in':20}{'count':>7}{'false':>8}{'share':>9}{'rows with any':>16}"
    for case in (*CHANGES, "all"):
        same = [one for one in found if not one.kind and case in (one.case, "all")]
        false = [one for one in same if one.told in CHANGED]
        rows = {(one.case, one.seed) for one in same}
        any_false = f"{len({(one.case, one.seed) for one in false})} of {len(rows)}"
        yield f"{case:20}{len(same):7d}{len(false):8d}{100 * len(false) / max(len(same), 1):7.2f} %{any_false:>16}"


def _share(changes: Sequence[Outcome]) -> str:
    told = sum(one.told in CHANGED or (one.kind == "new bay" and one.told == "not seen") for one in changes)
    return f"{100 * told / len(changes):.0f} %" if changes else "-"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pairs", type=int, default=20, help="of each case")
    parser.add_argument("--first", type=int, default=0, help="seed of the first pair")
    parser.add_argument("--sections", type=int, default=10)
    parser.add_argument("--errors", choices=tuple(ERRORS), default="fine")
    parser.add_argument("--level", type=float, default=LEVEL, help="of the false discovery rate")
    parser.add_argument("--keep", type=Path, help="folder of maps")
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "bench" / "results" / "compare.json")
    arguments = parser.parse_args()
    found: list[Outcome] = []
    with tempfile.TemporaryDirectory() as scratch:
        folder = arguments.keep or Path(scratch)
        for seed in range(arguments.first, arguments.first + arguments.pairs):
            for case in CHANGES:
                try:
                    found += outcomes(pair(case, seed, arguments.errors, arguments.sections, folder), arguments.level)
                except SavmapError as refusal:
                    print(f"pair {seed}, {case}, is left out: {refusal}", flush=True)
    print("\n".join(table(found)))
    write_text(arguments.output, json.dumps([vars(one) for one in found], indent=1, default=str) + "\n")


if __name__ == "__main__":
    main()
