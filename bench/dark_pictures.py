"""Labelled pictures of a rack style that the shipped network is poor at, for the fine-tuning run of docs/training.md.

    python -m bench dark-pictures --count 200 --seed 61 --keep data/dark
    python -m bench dark-pictures --count 60 --seed 62 --exact --keep data/dark-test

Dark galvanised racks of thin profiles with mesh decks and dark goods, in a dark hall, with a noisy camera. The pictures are
written as a set of polygons, as a labelling tool gives them, or, for measuring, with masks that are exact to the pixel and in
which what is more than 14 m away does not count.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from bench.baseline import Figures
from savmap.lab.label.formats import LabelledPicture, write_set
from savmap.lab.label.polygons import outlines
from savmap.lab.sim.dataset import samples, write
from savmap.lab.sim.random_row import random_row
from savmap.lab.sim.random_scene import random_scene
from savmap.lab.sim.scene.files import Scene, parse_scene

LABELLED = ("upright", "beam")


def dark_scene(seed: int) -> Scene:
    """The random scene of a seed with its racks thin and galvanised, and everything dark."""
    return darkened(random_scene(seed), seed)


def dark_row(seed: int, frames: int) -> Scene:
    """The random row of a seed in the same style, with the drive past it."""
    return darkened(random_row(seed, frames), seed)


def darkened(scene: Scene, seed: int) -> Scene:
    """A scene with its racks thin and galvanised, and everything dark."""
    rng = np.random.default_rng([seed, 5])

    def grey(low: float, high: float) -> list[float]:
        return [float(rng.uniform(low, high))] * 3

    content = scene.model_dump(mode="json")
    for rack in content["structures"]["shelves"]["rows"].values():
        steel = grey(0.05, 0.12)
        rack |= {f"{part}_color": steel for part in ("upright", "beam", "rear", "deck")}
        rack |= {"deck": "wire", "metallic": 0.7, "roughness": 0.3}
        rack |= {"upright_texture": "scratches", "beam_texture": "scratches"}
        rack |= {"upright_width": float(rng.uniform(0.035, 0.05)), "beam_height": float(rng.uniform(0.04, 0.06))}
    content["hall"] |= {f"{part}_color": grey(0.03, 0.09) for part in ("floor", "wall", "ceiling", "steel")}
    content["goods"]["colors"] = [grey(0.03, 0.15) for _ in range(4)]
    content["look"] |= {"ambient": 0.03, "exposure": float(rng.uniform(0.25, 0.5)), "noise": 0.03, "contrast": 1.2}
    return parse_scene(content, f"dark scene {seed}")


def labelled(seed: int, count: int) -> Iterator[LabelledPicture]:
    """Named pictures with the outlines of what they show."""
    for name, picture, mask in samples(seed, count, "face", scene_of=dark_scene):
        yield LabelledPicture(name, picture, {label: outlines(mask == k) for k, label in enumerate(LABELLED, 1)})


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of this tool."""
    parser.add_argument("--count", type=int, required=True)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--exact", action="store_true", help="masks instead of polygons")
    parser.add_argument("--keep", type=Path, required=True, help="the folder of the set")


def run(given: argparse.Namespace) -> Figures:
    """Write the set."""
    if given.exact:
        write(given.keep, given.seed, given.count, "face", scene_of=dark_scene)
    else:
        written = write_set(given.keep, LABELLED, labelled(given.seed, given.count))
        print(f"wrote {written.pictures} pictures with {written.outlines} outlines into {written.folder}")
    return {}
