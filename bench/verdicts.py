"""Are the verdicts of maps true? Which warnings name something wrong, which none, and what is wrong that no warning names.

    python -m bench verdicts MAP ...

MAP is a map's folder beside its survey.json, as `python -m bench rows --keep` leaves it (`out` in each row's folder). A warning is true where an
element that it names is more than 1 cm or two of its standard deviations off or does not exist, or where its bay (for lamps, the space around it)
lacks one. Unnamed is what is both more than 1 cm and two standard deviations off, or does not exist, or is missing, between the row's ends, and in
no warning. Maps of test seeds count in the totals only.
"""

import argparse
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import savmap
from bench.baseline import Figures
from bench.seeds import SEEDS, is_test
from bench.sigmas import Figure, figures_of
from savmap.maps.survey import read_survey
from savmap.types import MapWarning, RowMap, Structure

WRONG_M, SIGMAS = 0.01, 2.0
NEAR_M, LAMP_NEAR_M = 0.5, 1.0


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


def wrong_of(
    warning: MapWarning, structures: Mapping[str, Structure], wrong: Mapping[str, tuple[bool, str]]
) -> list[str]:
    """What of that which is wrong a warning names: by its subjects; all where it names none."""
    named = warning.subjects
    if not named:
        return [*wrong]
    own = [name for name in named if name in wrong]
    if warning.code in ("uncertain-element", "incomplete-map"):
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


def beyond_ends(row: RowMap) -> set[str]:
    """The ids of what is wholly beyond the row's ends."""
    face = np.concatenate([one.vertices[:, 0] for one in row.structures.get("shelves", ())] or [np.zeros(0)])
    every = [one for of_plugin in row.structures.values() for one in of_plugin] if len(face) else []
    return {one.id for one in every if one.vertices[:, 0].max() < face.min() or one.vertices[:, 0].min() > face.max()}


def verdict_of(folder: Path) -> dict[str, Any]:
    """The verdict on a map's first row, its warnings, and what is wrong that none names."""
    site, survey = savmap.load_map(folder / "map.json"), folder.parent / "survey.json"
    name, row = next(iter(site.rows.items()))
    evaluation = savmap.evaluate(site, survey)
    deviations = {key: value for part in evaluation.deviations.get(name, {}).values() for key, value in part.items()}
    wrong = truth_of(row, read_survey(survey).rows[name], deviations)
    structures = {one.id: one for of_plugin in row.structures.values() for one in of_plugin}
    warnings = row.verdict.warnings if row.verdict else ()
    named_by = [(warning, wrong_of(warning, structures, wrong)) for warning in warnings]
    named = {name for _, names in named_by for name in names} | beyond_ends(row)
    return {
        "verdict": row.verdict.grade if row.verdict else "-",
        "warnings": [
            {
                "warning": warning.line,
                "wrong": "; ".join(f"{name}: {wrong[name][1]}" for name in names),
            }
            for warning, names in named_by
        ],
        "unnamed": {one: what for one, (gross, what) in wrong.items() if gross and one not in named},
    }


def print_row(name: str, result: Mapping[str, Any]) -> None:
    """A row's verdict, warnings, and what none names."""
    print(f"{name}: {result['verdict']}")
    for warning in result["warnings"]:
        print(f"  {'true ' if warning['wrong'] else 'FALSE'} {warning['warning']} [{warning['wrong']}]")
    for one, what in result["unnamed"].items():
        print(f"  UNNAMED {one}: {what}")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of this bench."""
    parser.add_argument("maps", nargs="+", type=Path)


def run(given: argparse.Namespace) -> Figures:
    """Figures over all maps."""
    results = {folder.absolute().parent.name: verdict_of(folder) for folder in given.maps}
    for name, result in results.items():
        seed = name.rpartition("-")[2]
        if not (seed.isdigit() and any(is_test(family, int(seed)) for family in SEEDS)):
            print_row(name, result)
    warnings = [[bool(warning["wrong"]) for warning in result["warnings"]] for result in results.values()]
    return {
        "total": {
            "rows": len(results),
            "trusted": sum(result["verdict"] == "trusted" for result in results.values()),
            "true": sum(map(sum, warnings)),
            "false": sum(map(len, warnings)) - sum(map(sum, warnings)),
            "rows with false warnings only": sum(bool(row) and not any(row) for row in warnings),
            "unnamed": sum(len(result["unnamed"]) for result in results.values()),
        }
    }
