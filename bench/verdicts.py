"""Are the verdicts of maps true? Which doubts name something wrong, which none, and what is wrong that no doubt names.

    python bench/verdicts.py MAP ... [-o bench/results/verdicts.json]

MAP is a map's folder beside its survey.json, as bench/rows.py --keep leaves it. A doubt is true where an element that it names is more than 1 cm
or two of its standard deviations off or is none, or where its bay (for lamps, the space around it) lacks one. Unnamed is what is both more
than 1 cm and two standard deviations off, or none, or missing, between the row's ends, and in no doubt.
"""

import argparse
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from sigmas import Figure, figures_of

import savmap
from savmap.files.atomic import write_text
from savmap.maps.survey import read_survey
from savmap.pipeline.trust.ends import beyond_ends
from savmap.types import Doubt, RowMap, Structure

ROOT = Path(__file__).parent.parent
WRONG_M, SIGMAS = 0.01, 2.0
NEAR_M, LAMP_NEAR_M = 0.5, 1.0


@dataclass(frozen=True)
class Told:
    """A doubt, and what is wrong with what it names; nothing where it is false."""

    doubt: str
    wrong: str


def truth_of(row: RowMap, survey: Mapping[str, Any], deviations: Mapping[str, float]) -> dict[str, tuple[bool, str]]:
    """What is wrong by name, and whether that is more than 1 cm as well as two standard deviations: elements, and what a bay lacks."""
    worst: dict[str, Figure] = {}
    for name, figure in figures_of(row, survey):
        if name not in worst or badness(figure) > badness(worst[name]):
            worst[name] = figure
    wrong = {
        name: (
            abs(error) > WRONG_M and abs(error) > SIGMAS * sigma,
            f"{kind} {1e3 * error:+.0f} +- {1e3 * sigma:.0f} mm",
        )
        for name, (kind, error, sigma) in worst.items()
        if abs(error) > WRONG_M or abs(error) > SIGMAS * sigma
    }
    wrong |= {name: (True, "is none") for name, deviation in deviations.items() if np.isinf(deviation)}
    return wrong | dict.fromkeys((*missing_beams(row, survey), *missing_lamps(row, survey)), (True, "missing"))


def badness(figure: Figure) -> tuple[float, float]:
    """By how much a figure breaks both limits, and the more generous one."""
    _, error, sigma = figure
    limits = abs(error) / WRONG_M, abs(error) / (SIGMAS * sigma)
    return min(limits), max(limits)


def missing_beams(row: RowMap, survey: Mapping[str, Any]) -> Iterator[str]:
    """ "bay N lacks 1.23 m" for each surveyed beam that no mapped one is near."""
    posts = np.array(survey["uprights"]).mean(axis=1)
    beams = [one.vertices.mean(axis=0) for one in row.structures.get("shelves", ()) if one.label == "beam"]
    for number, section in enumerate(survey["sections"]):
        own = np.array([y for x, y, _ in beams if posts[number] < x < posts[number + 1]])
        for level in np.array(section["beams"]).reshape(-1, 2).mean(axis=1).tolist():
            if not len(own) or np.abs(own - level).min() > 0.15:
                yield f"bay {number + 1} lacks {level:.2f} m"


def missing_lamps(row: RowMap, survey: Mapping[str, Any]) -> Iterator[str]:
    """ "lamp at x = 1.23 m" for each surveyed lamp over the aisle, between the row's ends, that no mapped one is near."""
    lamps = [one.vertices.mean(axis=0) for one in row.structures.get("lights", ())]
    ends = np.array([lamp["ends"] for lamp in survey.get("lights", [])]).reshape(-1, 2, 3)
    first, last = survey["uprights"][0][0], survey["uprights"][-1][1]
    line = float(np.median([lamp[2] for lamp in lamps])) if lamps else np.inf
    for middle in ends.mean(axis=1):
        over = abs(middle[2] - line) < LAMP_NEAR_M and first < middle[0] < last
        if over and np.linalg.norm(np.array(lamps) - middle, axis=1).min() > LAMP_NEAR_M:
            yield f"lamp at x = {middle[0]:.2f} m"


def judged(doubt: Doubt, structures: Mapping[str, Structure], wrong: Mapping[str, tuple[bool, str]]) -> list[str]:
    """What of that which is wrong a doubt names: by its structures; by what it says of what is near one; all where it names none."""
    named = [
        *doubt.structures,
        *(name for name in structures if not doubt.structures and f"{name} " in f"{doubt.line} "),
    ]
    if not named:
        return [*wrong]
    own = [name for name in named if name in wrong]
    if "missing" in doubt.line or "shines" in doubt.line:
        sections = {name.split(" / ")[0] for name in named}
        own += [name for name in wrong if " lacks " in name and name.split(" lacks ")[0] in sections]
        own += [
            name for name in wrong if name.startswith("lamp at") and _beside(float(name.split()[-2]), named, structures)
        ]
    return own


def _beside(x: float, named: Sequence[str], structures: Mapping[str, Structure]) -> bool:
    """Whether x is between named structures."""
    places = [float(structures[name].vertices[:, 0].mean()) for name in named if name in structures]
    return bool(places) and min(places) - NEAR_M < x < max(places) + NEAR_M


def verdict_of(folder: Path) -> dict[str, Any]:
    """The verdict on a map's first row, its doubts, and what is wrong that none names."""
    site, survey = savmap.load_map(folder / "map.json"), folder.parent / "survey.json"
    name, row = next(iter(site.rows.items()))
    evaluation = savmap.evaluate(site, survey)
    deviations = {key: value for part in evaluation.deviations.get(name, {}).values() for key, value in part.items()}
    wrong = truth_of(row, read_survey(survey).rows[name], deviations)
    structures = {one.id: one for of_plugin in row.structures.values() for one in of_plugin}
    doubts = row.verdict.doubts if row.verdict else ()
    told = [(doubt, judged(doubt, structures, wrong)) for doubt in doubts]
    named = {one for _, own in told for one in own} | beyond_ends(row.structures, frozenset({"shelves"}))
    return {
        "verdict": row.verdict.grade if row.verdict else "-",
        "doubts": [
            asdict(Told(f"{d.kind}: {d.line}", "; ".join(f"{n}: {wrong[n][1]}" for n in own))) for d, own in told
        ],
        "unnamed": {one: what for one, (gross, what) in wrong.items() if gross and one not in named},
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("maps", nargs="+", type=Path)
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "bench" / "results" / "verdicts.json")
    arguments = parser.parse_args()
    results = {folder.absolute().parent.name: verdict_of(folder) for folder in arguments.maps}
    for name, result in results.items():
        print_row(name, result)
    print(summary([*results.values()]))
    write_text(arguments.output, json.dumps(results, indent=2) + "\n")


def print_row(name: str, result: Mapping[str, Any]) -> None:
    """A row's verdict, doubts, and what none names."""
    print(f"{name}: {result['verdict']}")
    for doubt in result["doubts"]:
        print(
            f"  {'true ' if doubt['wrong'] else 'FALSE'} {doubt['doubt']}"
            + (f" [{doubt['wrong']}]" if doubt["wrong"] else "")
        )
    for one, what in result["unnamed"].items():
        print(f"  UNNAMED {one}: {what}")


def summary(results: Sequence[Mapping[str, Any]]) -> str:
    """Counts over all rows."""
    doubts = [doubt for result in results for doubt in result["doubts"]]
    trusted, true = (
        sum(map(bool, parts)) for parts in ([r["verdict"] == "trusted" for r in results], [d["wrong"] for d in doubts])
    )
    false_rows = sum(bool(r["doubts"]) and not any(d["wrong"] for d in r["doubts"]) for r in results)
    unnamed = sum(len(result["unnamed"]) for result in results)
    return (
        f"{trusted} of {len(results)} rows trusted; {true} doubts true, {len(doubts) - true} false; "
        f"{false_rows} rows to be checked for false ones alone; {unnamed} wrong and not named"
    )


if __name__ == "__main__":
    main()
