"""Ways to be wrong about a row, and how mapping it ends: `trusted` and right, `check`, or refused. Never silently wrong.

    python bench/physics.py [--rows demo 5000 5003] [--keep DIR] [--only WORDS] [--part 1/4] [--resume] [-o bench/results/physics.json]

A case changes what is said of a row: its site file's content, or which clip it names (`physics_footage.py` has more of what may be wrong
with a clip). A map is wrong where the change put an edge further from the truth than 3 of its sigmas and 1 cm. It is silent about that
unless the row ends as `check` or refused. A number as a row is the seed of a random one; another row's references are those of the next row,
or of one of the usual rows where there is no next.
The results are written after each case; `--resume` leaves those as they are that are in the output file, and `--part 2/4` runs the second of
four parts of each row's cases.
"""

import argparse
import copy
import json
import re
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from physics_cases import NOTHING, PLUGIN, ROW, Case, Content, Filmed, more_reference_cases, reference_cases, unit_cases
from physics_clips import clip_cases, mast_cases, other_clip_cases
from rows import footage

from savmap.errors import SavmapError
from savmap.files.atomic import write_text
from savmap.jobs.cache import FolderCache
from savmap.jobs.scheduler import RunOptions, map_rows_of
from savmap.site.job import Job
from savmap.site.load import draft_of, site_of
from savmap.site.locations import SourceMap
from savmap.types import RowMap
from savmap.types.progress import SilentMonitor

ROOT = Path(__file__).parent.parent
DEMO = ROOT / "savmap" / "demo"
WRONG_SIGMA, WRONG_M = 3.0, 0.01
ROWS = ("demo", "5000", "5003")


@dataclass(frozen=True)
class Unchanged:
    """How a row is mapped without any change: its errors, as `errors` gives them, and its doubts about elements that are wrong indeed, by
    kind and ids."""

    errors: Mapping[str, tuple[float, float]]
    doubts: Set[tuple[str, tuple[str, ...]]]

    @classmethod
    def of(cls, row: RowMap, survey: Mapping[str, Any]) -> "Unchanged":
        """From the row's map."""
        assert row.verdict is not None
        found = errors(row, survey)
        wrong = [label for label, (error, sigma) in found.items() if _is_wrong(error, sigma)]
        doubts = {
            (doubt.kind, doubt.structures)
            for doubt in row.verdict.doubts
            if any(label.startswith(f"{name} / ") for label in wrong for name in doubt.structures)
        }
        return cls(found, doubts)


@dataclass(frozen=True)
class Ending:
    """How a row ended: `trusted`, `check` or `refused`, why as far as it is about the case, the largest error that the change made, m, whether
    the map told how large an error of this reference nobody would notice, and doubts about other things, other than the unchanged row's."""

    grade: str
    reason: str
    worst_m: float = 0.0
    told: bool = False
    others: str = ""


PARTS: tuple[Callable[[Filmed], Iterator[Case]], ...] = (
    reference_cases,
    more_reference_cases,
    unit_cases,
    clip_cases,
    other_clip_cases,
    mast_cases,
)
"""What may be wrong: each part gives the cases for a row."""


def mapped(content: Content, folder: Path, output: Path) -> tuple[RowMap | None, str]:
    """A row's map by its rack alone, or why there is none."""
    content = {
        **content,
        "plugins": {PLUGIN: content.get("plugins", {}).get(PLUGIN, {})},
        "rows": {ROW: content["rows"][ROW]},
    }
    try:
        job = Job(site_of(draft_of(content, SourceMap("case"), folder)), folder / "case", [PLUGIN], output)
        return map_rows_of(job, RunOptions(jobs=0), SilentMonitor(), FolderCache(output)).rows[ROW], ""
    except SavmapError as error:
        return None, str(error)


def errors(row: RowMap, survey: Mapping[str, Any]) -> dict[str, tuple[float, float]]:
    """Errors of uprights' edges along the aisle and of beams' heights, with their standard deviations, m, by vertex."""
    found = {}
    for structure in row.structures[PLUGIN]:
        for label, vertex, covariance in zip(
            structure.vertex_labels, structure.vertices, structure.covariances, strict=True
        ):
            words = label.replace(" /", "").split()
            try:
                if words[0] == "upright":
                    truth, axis = survey["uprights"][int(words[1]) - 1][("left", "right").index(words[2])], 0
                else:
                    truth, axis = (
                        survey["sections"][int(words[1]) - 1]["beams"][int(words[3]) - 1][words[4] == "upper"],
                        1,
                    )
            except (IndexError, ValueError):
                continue
            found[label] = float(vertex[axis] - truth), float(np.sqrt(covariance[axis, axis]))
    return found


def made_wrong(after: Mapping[str, tuple[float, float]], before: Mapping[str, tuple[float, float]]) -> float:
    """The largest error beyond its sigmas, m, among vertices that had none before."""
    worst = [
        abs(error)
        for label, (error, sigma) in after.items()
        if _is_wrong(error, sigma) and not _is_wrong(*before.get(label, (0.0, 1.0)))
    ]
    return max(worst, default=0.0)


def _is_wrong(error: float, sigma: float) -> bool:
    return abs(error) > max(WRONG_SIGMA * sigma, WRONG_M)


def ending(case: Case, row: Filmed, output: Path, before: Unchanged) -> Ending:
    """How a case ends."""
    found, reason = mapped(*case.change(row), output)
    if found is None:
        return Ending("refused", reason)
    worst = made_wrong(errors(found, row.survey), before.errors)
    assert found.verdict is not None
    told = any(_unnoticed(note, case.words) >= case.off_m for note in found.verdict.notes)
    doubts = [doubt for doubt in found.verdict.doubts if (doubt.kind, doubt.structures) not in before.doubts]
    true = "; ".join("; ".join((doubt.line, *doubt.details)) for doubt in doubts if doubt.kind in case.kinds)
    others = "; ".join(f"({doubt.line})" for doubt in doubts if doubt.kind not in case.kinds)
    return Ending(found.verdict.grade, true, worst, told, others)


def _unnoticed(note: str, words: Sequence[str]) -> float:
    """The error of a reference that a note says nobody would notice, m."""
    if note.startswith(("one reference gives", "nothing checks")):
        return np.inf if any(word and word in note for word in words) else 0.0
    sizes = re.findall(r"of ([\d.]+) m in ([^;]+?)(?=;|$)", note)
    return max((float(size) for size, name in sizes if any(word and word in name for word in words)), default=0.0)


def judged(case: Case, found: Ending) -> str:
    """In a word: `right`, `uncheckable` where the map says that such an error would not be noticed, or what is bad. A doubt about something
    else is no excuse for a wrong map."""
    if case.name == NOTHING:
        return "FALSE ALARM" if found.reason or found.others else "right"
    if found.reason and any(word in found.reason for word in case.words):
        return "right"
    if found.worst_m:
        return "uncheckable" if found.told else "SILENTLY WRONG"
    return "OTHER REASON" if found.grade == "refused" or found.reason or found.others else "right"


def filmed(name: str, folder: Path, other: str) -> Filmed:
    """A row's site file and survey; a number is the seed of a random one."""
    place, next_place = (DEMO if one == "demo" else folder / f"row-{one}" for one in (name, other))
    for one in (name, other):
        if one != "demo":
            footage(int(one), 40, folder / f"row-{one}")
    content, following = (yaml.safe_load((at / "site.yaml").read_text(encoding="utf-8")) for at in (place, next_place))
    survey = json.loads((place / "survey.json").read_text(encoding="utf-8"))["rows"][ROW]
    scratch = folder / "physics" / name
    scratch.mkdir(parents=True, exist_ok=True)
    return Filmed(name, place, content, survey, following, next_place, scratch)


def chosen(row: Filmed, only: str, part: tuple[int, int]) -> list[Case]:
    """The cases of a row whose names contain `only`, every so many of them: `part` is (1, 4) for the first of four parts."""
    cases = [case for part in PARTS for case in part(row) if only in case.name]
    return cases[part[0] - 1 :: part[1]]


def run(
    rows: Sequence[str], folder: Path, only: str, part: tuple[int, int], done: Set[tuple[str, str]]
) -> Iterator[dict[str, Any]]:
    """All chosen cases of all rows, but those that are `done`, by row and case; printed as they end."""
    others = [*rows[1:], rows[0]] if len(rows) > 1 else [next(one for one in ROWS if one not in rows)]
    for name, other in zip(rows, others, strict=True):
        row = filmed(name, folder, other)
        output = row.scratch
        if all((name, case.name) in done for case in chosen(row, only, part)):
            continue
        whole, reason = mapped(copy.deepcopy(row.content), row.folder, output)
        if whole is None:
            raise SystemExit(f"row {name} cannot be mapped at all: {reason}")
        before = Unchanged.of(whole, row.survey)
        for case in (case for case in chosen(row, only, part) if (name, case.name) not in done):
            found = ending(case, row, output, before)
            word = judged(case, found)
            print(
                f"{name:6} {case.name:36} {found.grade:8} {100 * found.worst_m:7.1f} cm  {word:15} {(found.reason or found.others)[:150]}",
                flush=True,
            )
            yield {"row": name, "case": case.name, "judged": word, **vars(found)}


def _part(text: str) -> tuple[int, int]:
    number, count = map(int, text.split("/"))
    if not 0 < number <= count:
        raise ValueError(text)
    return number, count


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", nargs="+", default=ROWS)
    parser.add_argument("--keep", type=Path, help="keep footage and what was measured in this folder")
    parser.add_argument("--only", default="", help="cases whose name contains this")
    parser.add_argument(
        "--part", default="1/1", type=_part, help="such as 2/4: the second of four parts of each row's cases"
    )
    parser.add_argument("--resume", action="store_true", help="keep the results that are in the output file")
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "bench" / "results" / "physics.json")
    arguments = parser.parse_args()
    resumed = arguments.resume and arguments.output.is_file()
    results = json.loads(arguments.output.read_text(encoding="utf-8")) if resumed else []
    with tempfile.TemporaryDirectory() as temporary:
        done = {(one["row"], one["case"]) for one in results}
        for result in run(arguments.rows, arguments.keep or Path(temporary), arguments.only, arguments.part, done):
            results.append(result)
            write_text(arguments.output, json.dumps(results, indent=2) + "\n")
    for word in ("FALSE ALARM", "OTHER REASON", "uncheckable"):
        print(f"{word.lower()}: {sum(one['judged'] == word for one in results)}")
    print(f"silently wrong: {sum(one['judged'] == 'SILENTLY WRONG' for one in results)}")


if __name__ == "__main__":
    main()
