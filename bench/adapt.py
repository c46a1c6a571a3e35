"""`savmap adapt` on dark, thin racks that the shipped network is poor at, without a label.

    python -m bench adapt [--set train] [--count 2] [--frames 60] [--steps 240] [--both] [--keep DIR]

Drives past such rows are simulated (`bench/dark_pictures.py` makes the style), one row of a site each, or both rows of the aisle; the site teaches
the network of `shelves`. Intersection over union on pictures of other such places (`dark-test`, exact masks), with the network that ships and with
each that was taught, kept or not, and missing and spurious elements of the first and the last map. What is in DIR is used again. 200 labelled
pictures of the style reach 0.657 (docs/training.md).
"""

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

import savmap
from bench.baseline import Figures
from bench.dark_pictures import LABELLED
from bench.rows import ROWS, footage, only_one_row
from bench.seeds import SETS, seeds
from savmap.files.atomic import write_text
from savmap.lab.adapt.records import AdaptOptions
from savmap.lab.adapt.run import adapt
from savmap.lab.commands import adapted_lines
from savmap.lab.sim.dataset import write
from savmap.lab.train.data.dataset import read_dataset
from savmap.lab.train.measure import score_file
from savmap.lab.train.plan import float_model
from savmap.plugin.manager import load_class
from savmap.report.evaluation import as_json
from savmap_shelves.lab.looks import dark_scene

PLUGIN = "shelves"


def site_of(seeds: Sequence[int], frames: int, base: Path, sides: Sequence[str] = ROWS[:1]) -> Path:
    """A site with the row of each seed, or the two of its aisle, each seed with its own footage, and its survey, made unless they are there."""
    rows: dict[str, Any] = {}
    surveyed: dict[str, Any] = {}
    survey: dict[str, Any] = {}
    for seed in seeds:
        folder = base / f"row-{seed}"
        made = footage(seed, frames, folder, "dark rows")
        survey = json.loads((folder / "survey.json").read_text(encoding="utf-8"))
        for side in sides:
            alone = only_one_row(made, side)
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


def scored(network: Path, pictures: Path) -> float:
    """Intersection over union, the mean over the classes."""
    return float(score_file(network, read_dataset(pictures, LABELLED).samples, LABELLED).mean)


def map_figures(site_map: Path, survey: Path) -> dict[str, float]:
    """Missing and spurious elements of a map, and its mean absolute error."""
    figures = as_json(savmap.evaluate(savmap.load_map(site_map), survey))
    counts = {key: sum(figures[key].values()) for key in ("missing", "spurious")}
    return {**counts, "mean cm": 100 * figures["mae_m"]}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of this bench."""
    parser.add_argument("--set", choices=SETS, default="train", help="of seeds")
    parser.add_argument("--count", type=int, default=2, help="of rows")
    parser.add_argument("--frames", type=int, default=60)
    parser.add_argument("--steps", type=int, default=240)
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("--both", action="store_true", help="both rows of each aisle, not only the left one")


def run(given: argparse.Namespace) -> Figures:
    """Figures of each network and of each map."""
    chosen = seeds("dark rows", given.set, given.count)
    base = given.keep
    site, pictures = site_of(chosen, given.frames, base, ROWS if given.both else ROWS[:1]), test_set(base)
    adapted = adapt(site, base / "out", AdaptOptions(PLUGIN, rounds=given.rounds, steps=given.steps, jobs=0))
    print("\n".join(adapted_lines(adapted)))
    folder = base / "out" / "adapted"
    networks = {"shipped": float_model(load_class(PLUGIN).model)}
    networks |= {
        f"round {round_.number}": folder / f"round-{round_.number}" / f"{PLUGIN}.onnx" for round_ in adapted.rounds
    }
    first = next(path for path in (folder / "first" / "map.json", base / "out" / "map.json") if path.is_file())
    maps = {"first map": first}
    if adapted.kept is not None:
        maps["last map"] = folder / "map.json"
    figures = {name: {"IoU": scored(network, pictures)} for name, network in networks.items()}
    return {**figures, **{name: map_figures(path, base / "survey.json") for name, path in maps.items()}}
