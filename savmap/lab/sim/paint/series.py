"""Labelled sets, picture by picture: those that are there are kept, so a run that was stopped goes on."""

import argparse
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from savmap.lab.sim.dataset import write_samples

Sample = tuple[NDArray[np.uint8], NDArray[np.uint8]]
"""A picture (h, w, 3) RGB and its mask (h, w)."""


def write_series(
    folder: Path, classes: Sequence[str], renderer: str, names: Sequence[str], make: Callable[[int], Sample]
) -> None:
    """Writes the pictures that a folder lacks of a series; `make` gives the k-th. Raises OutputError as
    `write_samples`."""

    def missing() -> Iterator[tuple[str, NDArray[np.uint8], NDArray[np.uint8]]]:
        for index, name in enumerate(names):
            if not (folder / "images" / f"{name}.jpg").is_file():
                yield name, *make(index)

    write_samples(folder, classes, renderer, missing())


def parsed(parser: argparse.ArgumentParser, arguments: Sequence[str] | None) -> argparse.Namespace:
    """The options of a parser, with those of every series: `count`, `seed` and `output`. Exits where they are out of
    range."""
    parser.add_argument("--count", type=int, required=True)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("-o", "--output", type=Path, required=True)
    options = parser.parse_args(arguments)
    if options.seed < 0 or options.count < 1:
        parser.error("--seed is 0 or more, --count 1 or more")
    return options
