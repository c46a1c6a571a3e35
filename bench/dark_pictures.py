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

from bench.baseline import Figures
from savmap.lab.label.formats import LabelledPicture, write_set
from savmap.lab.label.polygons import outlines
from savmap.lab.sim.dataset import samples, write
from savmap_shelves.lab.looks import dark_scene

LABELLED = ("upright", "beam")


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
