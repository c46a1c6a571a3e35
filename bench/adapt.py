"""`savmap adapt` on dark, thin racks that the shipped network is poor at, without a label.

    python bench/adapt.py [--seeds 7001 7002] [--frames 60] [--steps 240] [--both] [--keep DIR] [-o bench/results/adapt.json]

Drives past such rows are simulated (`bench/fine_tuning.py` makes the style), one row of a site each, or both rows of the aisle; the site teaches the network of
`shelves`. Printed: intersection over union on pictures of other such places (`dark-test`, exact masks), with the network that ships and
with each that was taught, kept or not, and missing and spurious elements of the first and the last map. What is in DIR is used again.
"""

import argparse
import json
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml
from fine_tuning import LABELLED, dark_row, dark_scene
from rows import ROWS, only_one_row

import savmap
from savmap.files.atomic import write_text
from savmap.lab.adapt.records import AdaptOptions
from savmap.lab.adapt.run import adapt
from savmap.lab.commands import adapted_lines
from savmap.lab.sim.dataset import write
from savmap.lab.sim.simulate import simulate
from savmap.lab.train.data.dataset import read_dataset
from savmap.lab.train.measure import score_file
from savmap.lab.train.plan import float_model
from savmap.plugin.manager import load_class
from savmap.report.evaluation import as_json

ROOT = Path(__file__).parent.parent
PLUGIN = "shelves"
GOAL = 0.657
"""What 200 labelled pictures of the style reach (docs/training.md)."""


def site_of(seeds: Sequence[int], frames: int, base: Path, sides: Sequence[str] = ROWS[:1]) -> Path:
    """A site with the row of each seed, or the two of its aisle, each seed with its own footage, and its survey, made unless they are there."""
    rows: dict[str, Any] = {}
    surveyed: dict[str, Any] = {}
    survey: dict[str, Any] = {}
    for seed in seeds:
        folder = base / f"row-{seed}"
        if not (folder / "site.yaml").is_file():
            simulate(dark_row(seed, frames), folder)
        survey = json.loads((folder / "survey.json").read_text(encoding="utf-8"))
        for side in sides:
            alone = only_one_row(folder / "site.yaml", side)
            if alone is None:
                continue
            content = yaml.safe_load(alone.read_text(encoding="utf-8"))
            name, row = next(iter(content["rows"].items()))
            row["passes"] = [{**one, "video": f"row-{seed}/{one['video']}"} for one in row["passes"]]
            row["references"] = {**content["references"], **row["references"]}
            rows[f"{seed}-{name}"], surveyed[f"{seed}-{name}"] = row, survey["rows"][name]
    write_text(base / "survey.json", json.dumps({**survey, "rows": surveyed}))
    site = base / "site.yaml"
    content = {"plugins": {PLUGIN: {}}, "survey": "survey.json", "rows": rows}
    write_text(site, yaml.safe_dump(content))
    return site


def test_set(base: Path) -> Path:
    """Sixty pictures of other places in the same style, with exact masks; docs/training.md's."""
    folder = base / "dark-test"
    if not folder.is_dir():
        write(folder, 62, 60, "face", scene_of=dark_scene)
    return folder


def scored(network: Path, pictures: Path) -> dict[str, float]:
    """Intersection over union by class, and their mean."""
    score = score_file(network, read_dataset(pictures, LABELLED).samples, LABELLED)
    return {**score.iou, "mean": score.mean}


def map_figures(site_map: Path, survey: Path) -> dict[str, Any]:
    """Missing and spurious elements of a map, and its mean absolute error."""
    figures = as_json(savmap.evaluate(savmap.load_map(site_map), survey))
    return {key: figures[key] for key in ("mae_m", "missing", "spurious")}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, nargs="+", default=[7001, 7002])
    parser.add_argument("--frames", type=int, default=60)
    parser.add_argument("--steps", type=int, default=240)
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("--both", action="store_true", help="both rows of each aisle, not the left one alone")
    parser.add_argument("--keep", type=Path, help="keep footage, pictures and results in this folder")
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "bench" / "results" / "adapt.json")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        base = given.keep or Path(temporary)
        site, pictures = site_of(given.seeds, given.frames, base, ROWS if given.both else ROWS[:1]), test_set(base)
        adapted = adapt(site, base / "out", AdaptOptions(PLUGIN, rounds=given.rounds, steps=given.steps, jobs=0))
        print("\n".join(adapted_lines(adapted)))
        networks = {"shipped": float_model(load_class(PLUGIN).model)}
        folder = base / "out" / "adapted"
        maps = {
            "first map": next(
                path for path in (folder / "first" / "map.json", base / "out" / "map.json") if path.is_file()
            )
        }
        for one in adapted.rounds:
            networks[f"round {one.number}"] = folder / f"round-{one.number}" / f"{PLUGIN}.onnx"
        if adapted.kept is not None:
            maps["last map"] = folder / "map.json"
        iou = {name: scored(network, pictures) for name, network in networks.items()}
        maps_figures = {name: map_figures(path, base / "survey.json") for name, path in maps.items()}
    for name, figures in iou.items():
        print(f"{name:10s}" + "".join(f"  {label} {value:.3f}" for label, value in figures.items()))
    print(f"goal on dark-test: {GOAL}")
    for name, figures in maps_figures.items():
        print(f"{name}: missing {figures['missing']}, spurious {figures['spurious']}, {100 * figures['mae_m']:.2f} cm")
    write_text(given.output, json.dumps({"dark_test": iou, "maps": maps_figures, **adapted.as_json()}, indent=2) + "\n")


if __name__ == "__main__":
    main()
