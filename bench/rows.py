"""Simulated short rows by random seeds, from footage to scored map: missing, spurious, error, seconds a row.

    python bench/rows.py [--count 20] [--seed 1000] [--frames 40] [--style grey] [--times 6] [--gap 3.2] [--references camera] [--row second] [--keep DIR] [-o bench/results/rows.json]

Nobody looks at a row beforehand; footage already in DIR is used again. Style `grey`: beams and decks of one grey in flat light.
--times: each row's bays so many times over, and so many times the frames, for long rows. --gap: with a bay without beams, so many metres
wide, in the middle: a passage, or a column of the hall between two racks. --references: all that the footage comes with (camera height, lowest beams, a length),
`length` (camera height and length), or `camera` (its height alone), which is what most users have at first.
--row: the row on the left of the drive (`first`), or that on the right, which is another random rack beside the same footage,
where the drive goes past the whole of it.
"""

import argparse
import json
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from row_scenes import greyed, interrupted, lengthened

import savmap
from savmap.errors import SavmapError
from savmap.files.atomic import write_text
from savmap.lab.sim.random_row import random_row
from savmap.lab.sim.simulate import simulate
from savmap.report.evaluation import as_json

ROOT = Path(__file__).parent.parent
ROWS = ("first", "second")
"""The rows of a simulated aisle, left and right of the drive."""
SLACK_M = 0.3


def footage(seed: int, frames: int, folder: Path, style: str = "any", times: int = 1, gap: float = 0.0) -> Path:
    """The site file of a random row's footage, made unless it is there."""
    site = folder / "site.yaml"
    if not site.is_file():
        scene = random_row(seed, frames)
        scene = greyed(scene, seed) if style == "grey" else scene
        scene = lengthened(scene, times) if times > 1 else scene
        simulate(interrupted(scene, gap) if gap else scene, folder)
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


def is_whole(figures: dict[str, Any]) -> bool:
    """Whether a row's map misses nothing and invents nothing, lamps as well as the racks' elements."""
    return "error" not in figures and counted(figures) == (0, 0)


def counted(figures: dict[str, Any]) -> tuple[int, int]:
    """How many elements a row's map misses, and how many it invents."""
    lamps = figures.get("lights", {})
    return (
        sum(figures["missing"].values()) + lamps.get("missing", 0),
        sum(figures["spurious"].values()) + lamps.get("spurious", 0),
    )


def line(seed: int, figures: dict[str, Any]) -> str:
    """One row of the table."""
    if "error" in figures:
        return f"{seed:6d}  {figures['error'][:100]}"
    missing, spurious = counted(figures)
    lamps = figures.get("lights", {})
    lamp_text = f"{100 * lamps['mae_m']:8.2f}" if lamps.get("mae_m") is not None else "       -"
    return f"{seed:6d} {missing:8d} {spurious:9d} {100 * figures['mae_m']:8.2f} {lamp_text} {figures['seconds']:9.1f}  {figures['verdict']}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1000)
    parser.add_argument("--frames", type=int, default=40)
    parser.add_argument("--style", choices=["any", "grey"], default="any")
    parser.add_argument("--times", type=int, default=1)
    parser.add_argument("--gap", type=float, default=0.0)
    parser.add_argument("--references", choices=["all", "length", "camera"], default="all")
    parser.add_argument("--row", choices=ROWS, default=ROWS[0], help="the row on the left or on the right of the drive")
    parser.add_argument("--keep", type=Path, help="keep footage and maps in this folder")
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "bench" / "results" / "rows.json")
    arguments = parser.parse_args()
    results: dict[int, dict[str, Any]] = {}
    print("  seed  missing  spurious  MAE cm  lamps cm  seconds  verdict", flush=True)
    with tempfile.TemporaryDirectory() as temporary:
        base = arguments.keep or Path(temporary)
        for seed in range(arguments.seed, arguments.seed + arguments.count):
            folder = base / (f"row-{seed}" if arguments.style == "any" else f"{arguments.style}-{seed}")
            folder = folder.with_name(f"{folder.name}-x{arguments.times}") if arguments.times > 1 else folder
            folder = folder.with_name(f"{folder.name}-gap{arguments.gap:g}") if arguments.gap else folder
            made = footage(seed, arguments.frames, folder, arguments.style, arguments.times, arguments.gap)
            site = only_one_row(made, arguments.row, arguments.references)
            if site is None:
                print(f"{seed:6d}  no rack on that side, or not driven past from end to end")
                continue
            results[seed] = score(site, folder / ("out" if arguments.row == ROWS[0] else f"out-{arguments.row}"))
            print(line(seed, results[seed]), flush=True)
    whole = sum(is_whole(figures) for figures in results.values())
    print(f"{whole} of {len(results)} rows without a missing or spurious element")
    write_text(arguments.output, json.dumps(results, indent=2) + "\n")


if __name__ == "__main__":
    main()
