"""Made-up rows from footage to scored map: missing, spurious, error, verdict.

    python -m bench rows [--set dev] [--count 20] [--family "grey rows"] [--references camera] [--row second] [--keep DIR]

Families: `rows` are random short ones; `grey rows` have beams and decks of one grey in flat light; of `long rows` the bays come six times over;
`interrupted rows` have a bay without beams, 3.2 m wide, in the middle. `--references`: all that the footage comes with (camera height, lowest
beams, a length), `length` (camera height and length), or `camera` (its height only), which is what most users have at first. `--row second` maps
the rack on the right of the drive, another random one, where the drive goes past all of it. Footage already in DIR is used again.
"""

import argparse
import json
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml

import savmap
from bench.baseline import Figures
from bench.seeds import SETS, is_test, seeds
from savmap.errors import SavmapError
from savmap.lab.sim.random_row import random_row
from savmap.lab.sim.scene.files import Scene, parse_scene
from savmap.lab.sim.simulate import simulate
from savmap.report.evaluation import as_json

FAMILIES = ("rows", "grey rows", "long rows", "interrupted rows")
ROWS = ("first", "second")
"""The rows of a simulated aisle, left and right of the drive."""
SLACK_M, TIMES, GAP_M = 0.3, 6, 3.2


def footage(seed: int, frames: int, folder: Path, family: str = "rows") -> Path:
    """The site file of a random row's footage, made unless it exists."""
    site = folder / "site.yaml"
    if not site.is_file():
        scene = random_row(seed, frames)
        changed = {
            "grey rows": lambda: greyed(scene, seed),
            "long rows": lambda: lengthened(scene, TIMES),
            "interrupted rows": lambda: interrupted(scene, GAP_M),
        }
        simulate(changed[family]() if family in changed else scene, folder)
    return site


def is_driven_past(site: Path, row: str) -> bool:
    """Whether the camera of a simulated aisle comes past a row from end to end."""
    scene = yaml.safe_load(site.with_name("scene.yaml").read_text(encoding="utf-8"))
    uprights = json.loads(site.with_name("survey.json").read_text(encoding="utf-8"))["rows"][row]["uprights"]
    origin, facing = scene["rows"][row]["x"], scene["rows"][row]["facing"]
    ends = np.array([uprights[0][0], uprights[-1][1]]) * (1 if facing == "+z" else -1) + origin
    drive = sorted((scene["cart"]["start"][0], scene["cart"]["end"][0]))
    return bool(drive[0] - SLACK_M <= ends.min() and ends.max() <= drive[1] + SLACK_M)


def only_one_row(site: Path, which: str = "first", references: str = "all") -> Path | None:
    """A copy of a site file that maps its first or its second row alone, with so many of its references; None where it has no second one, or the
    drive does not go past the whole of that."""
    content = yaml.safe_load(site.read_text(encoding="utf-8"))
    names = list(content["rows"])[ROWS.index(which) :]
    if not names or (which != ROWS[0] and not is_driven_past(site, names[0])):
        return None
    name = names[0]
    row = content["rows"][name]
    content["rows"] = {name: row}
    if references != "all":
        row.pop("plugins", None)
    if references == "camera":
        row.pop("references", None)
    path = site.with_name(f"{which}-row.yaml" if references == "all" else f"{which}-row-{references}.yaml")
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    return path


def score(site: Path, output: Path) -> dict[str, Any]:
    """Map a site and score it; an error counts as everything missing and is named."""
    start = time.perf_counter()
    try:
        site_map = savmap.map_site(site, output=output)
        figures = as_json(savmap.evaluate(site_map, site.with_name("survey.json")))
        wanted = ("mae_m", "missing", "spurious", "lights", "ends of lights")
        figures = {key: figures[key] for key in wanted if key in figures}
        verdict = next(iter(site_map.rows.values())).verdict
        figures["verdict"] = verdict.grade if verdict else "-"
    except SavmapError as error:
        figures = {"error": str(error)}
    return {**figures, "seconds": time.perf_counter() - start}


def is_whole(figures: Mapping[str, Any]) -> bool:
    """Whether a row's map misses nothing and invents nothing, lamps as well as the racks' elements."""
    return "error" not in figures and counted(figures) == (0, 0)


def counted(figures: Mapping[str, Any]) -> tuple[int, int]:
    """How many elements a row's map misses, and how many it invents."""
    lamps = figures.get("lights", {})
    return (
        sum(figures["missing"].values()) + lamps.get("missing", 0),
        sum(figures["spurious"].values()) + lamps.get("spurious", 0),
    )


def line(seed: int, figures: Mapping[str, Any]) -> str:
    """A printed row of the table."""
    if "error" in figures:
        return f"{seed:6d}  {figures['error'][:100]}"
    missing, spurious = counted(figures)
    lamps = figures.get("lights", {}).get("mae_m")
    lamp_text = f"{100 * lamps:8.2f}" if lamps is not None else "       -"
    error, seconds = 100 * figures["mae_m"], figures["seconds"]
    return f"{seed:6d} {missing:8d} {spurious:9d} {error:8.2f} {lamp_text} {seconds:9.1f}  {figures['verdict']}"


def totals(results: Mapping[int, Mapping[str, Any]]) -> Figures:
    """Figures over all rows; errors are those of mapped rows."""
    mapped = [figures for figures in results.values() if "error" not in figures]
    counts = np.array([counted(figures) for figures in mapped], np.int64).reshape(-1, 2).sum(axis=0)
    lamps = [figures["lights"]["mae_m"] for figures in mapped if figures.get("lights", {}).get("mae_m") is not None]
    errors = [100 * figures["mae_m"] for figures in mapped if figures["mae_m"] is not None]
    total: dict[str, float] = {
        "rows": len(results),
        "whole": sum(is_whole(figures) for figures in results.values()),
        "trusted": sum(figures["verdict"] == "trusted" for figures in mapped),
        "refused": len(results) - len(mapped),
        "missing": int(counts[0]),
        "spurious": int(counts[1]),
    }
    if errors:
        total |= {"mean cm": float(np.mean(errors)), "largest cm": max(errors)}
    if lamps:
        total["lamps cm"] = 100 * float(np.mean(lamps))
    return {"total": total | {"seconds a row": float(np.mean([one["seconds"] for one in results.values()]))}}


def lengthened(scene: Scene, times: int) -> Scene:
    """The scene with the first rack's bays so many times over, the others, the hall and the drive longer by as much."""
    content = scene.model_dump(mode="json")
    racks, cart = content["structures"]["shelves"]["rows"], content["cart"]
    more = (times - 1) * _length(next(iter(racks.values())))
    for name, rack in racks.items():
        before, bays = _length(rack), rack["bays"]
        count = max(1, round(len(bays) * (before + more) / before))
        rack["bays"] = [bays[number % len(bays)] for number in range(count)]
        if content["rows"][name]["facing"] == "-z":
            content["rows"][name]["x"] += _length(rack) - before
    content["hall"]["x"][1] += more + 6.0
    cart["start" if cart["start"][0] > cart["end"][0] else "end"][0] += more
    cart["frames"] *= times
    return parse_scene(content, "long row")


def _length(rack: Mapping[str, Any]) -> float:
    """m."""
    return float(sum(bay["width"] for bay in rack["bays"]))


def greyed(scene: Scene, seed: int) -> Scene:
    """The scene with its racks' beams and decks in one grey, under light that comes from everywhere."""
    rng = np.random.default_rng([seed, 9])
    content = scene.model_dump(mode="json")
    for rack in content["structures"]["shelves"]["rows"].values():
        grey = float(rng.uniform(0.3, 0.6))
        post = grey if rng.random() < 0.5 else float(rng.uniform(0.1, 0.7))
        rack |= {"beam_color": [grey] * 3, "deck_color": [grey * float(rng.uniform(0.93, 1.07))] * 3, "deck": "steel"}
        rack |= {"upright_color": [post] * 3, "beam_texture": "plain", "metallic": 0.0, "labels": 0.0}
    content["look"] |= {"ambient": 0.6, "contrast": 0.9}
    return parse_scene(content, f"grey row {seed}")


def interrupted(scene: Scene, gap: float) -> Scene:
    """The scene with a bay without beams, so many metres wide, in the middle of the first rack; the hall and the drive longer by as much.

    Racks behind stay as they are, and are seen through it."""
    content = scene.model_dump(mode="json")
    rack, cart = next(iter(content["structures"]["shelves"]["rows"].values())), content["cart"]
    before, more = abs(cart["end"][0] - cart["start"][0]), gap + rack["upright_width"]
    rack["bays"].insert(len(rack["bays"]) // 2, {"width": gap, "beams": [], "empty": True})
    content["hall"]["x"][1] += more
    cart["start" if cart["start"][0] > cart["end"][0] else "end"][0] += more
    cart["frames"] = round(cart["frames"] * (before + more) / before)
    return parse_scene(content, "interrupted row")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of this bench."""
    parser.add_argument(
        "--set", choices=SETS, default="dev", help="of seeds; rows of `test` are printed as totals only"
    )
    parser.add_argument("--count", type=int, help="of rows; all of the set")
    parser.add_argument("--family", choices=FAMILIES, default=FAMILIES[0])
    parser.add_argument("--frames", type=int, default=40)
    parser.add_argument("--references", choices=["all", "length", "camera"], default="all")
    parser.add_argument("--row", choices=ROWS, default=ROWS[0], help="the row on the left or on the right of the drive")
    parser.add_argument("--keep", type=Path, help="keep footage and maps in this folder")


def run(given: argparse.Namespace) -> Figures:
    """Map each row of the set."""
    results: dict[int, dict[str, Any]] = {}
    print("  seed  missing  spurious  MAE cm  lamps cm  seconds  verdict", flush=True)
    with tempfile.TemporaryDirectory() as temporary:
        base = given.keep or Path(temporary)
        for seed in seeds(given.family, given.set, given.count):
            folder = base / f"{given.family.replace(' ', '-')[:-1]}-{seed}"
            made = footage(seed, given.frames, folder, given.family)
            site = only_one_row(made, given.row, given.references)
            if site is None:
                continue  # no rack on that side, or not driven past from end to end
            results[seed] = score(site, folder / ("out" if given.row == ROWS[0] else f"out-{given.row}"))
            if not is_test(given.family, seed):
                print(line(seed, results[seed]), flush=True)
    return totals(results) if results else {}
