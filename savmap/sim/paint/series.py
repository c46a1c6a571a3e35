"""Labelled sets, picture by picture: those that are there are kept, so a run that was stopped goes on."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from savmap.sim.dataset import write_samples

Sample = tuple[NDArray[np.uint8], NDArray[np.uint8]]
"""A picture (h, w, 3) RGB and its mask (h, w)."""


def write_series(
    folder: Path, classes: Sequence[str], renderer: str, names: Sequence[str], make: Callable[[int], Sample]
) -> None:
    """Writes the pictures that a folder lacks of a series; `make` gives the k-th. Raises OutputError as `write_samples`."""

    def missing() -> Iterator[tuple[str, NDArray[np.uint8], NDArray[np.uint8]]]:
        for index, name in enumerate(names):
            if not (folder / "images" / f"{name}.jpg").is_file():
                yield name, *make(index)

    write_samples(folder, classes, renderer, missing())
