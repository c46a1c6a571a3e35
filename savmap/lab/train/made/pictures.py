"""Labelled pictures of several kinds on disk, made ahead of training by a process of its own.

Each kind is a data set in the folder `pictures/KIND`. The newest stay, so that a training that is begun again has
pictures at once. Kinds come from the plugin (`practice_kinds`), or else are its painted pictures and random scenes."""

import os
import threading
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from multiprocessing import parent_process
from pathlib import Path
from typing import Any

import cv2

from savmap.errors import SavmapError
from savmap.lab.plugins import lab_plugin
from savmap.lab.sim.dataset import Sample, samples, write_samples
from savmap.lab.sim.random_scene import random_scene

FIRST_NUMBER, HELD_OUT_NUMBER = 20_000, 10_000
"""Of batches that are trained on, and of those that only measure: apart from the seeds of bench/seeds.py, whose scenes
are other ones even where a number is the same. Kinds have numbers of their own, so that they show other places."""
CAPACITY = 6_000
USES = 20
"""How often a picture is shown on average before another takes its place; training gains from steps, not pictures."""
IDLE_S = 5.0
HELD_OUT = "held-out"


@dataclass(frozen=True)
class Kind:
    """A kind of pictures: its share of what is trained on, what makes the few pictures of a number, the same for the
    same number, and how many only measure."""

    share: float
    batch: Callable[[int], Iterable[Sample]]
    held_out: int = 0


def practice_kinds(plugin: str, classes: Sequence[str]) -> Mapping[str, Kind]:
    """The kinds of a plugin's pictures by name. Raises SavmapError for a plugin that makes none."""
    lab = lab_plugin(plugin)
    if lab is None:
        raise SavmapError(f"plugin `{plugin}` has no part in the laboratory that makes pictures (docs/hooks.md)")
    if lab.practice_kinds:
        return lab.practice_kinds
    kinds = {"mixed": Kind(0.4, partial(views, "mixed", partial(random_scene, plugins=[plugin]), classes), 24)}
    if lab.has("practice_picture"):
        kinds["painted"] = Kind(0.6, lambda number: (lab.practice_picture(number, index) for index in range(20)), 24)
    return kinds


def views(kind: Any, scene_of: Callable[[int], Any], classes: Sequence[str], number: int) -> Iterable[Sample]:
    """Eight views of the random place of a number: to make a place takes as long as that many views of it."""
    yield from (sample[1:] for sample in samples(number, 8, kind, classes, scene_of, views=8))


def newest(folder: Path) -> int:
    """The number of the last batch that lies in a folder; -1 where there is none."""
    return max((int(path.stem.split("-")[-2]) for path in (folder / "images").glob("*.jpg")), default=-1)


def add(folder: Path, kind: Kind, number: int, classes: Sequence[str], most: int) -> int:
    """Put the pictures of a number into a folder, and take the oldest away; how many were made."""
    made = list(kind.batch(number))
    named = ((f"{folder.name}-{number:08d}-{index:03d}", *sample) for index, sample in enumerate(made))
    write_samples(folder, classes, "savmap.lab.train.made", named)
    for image in sorted((folder / "images").glob("*.jpg"))[:-most]:
        image.unlink()
        (folder / "masks" / f"{image.stem}.png").unlink(missing_ok=True)
    return len(made)


def make(plugin: str, classes: Sequence[str], folder: Path, crops: Any) -> None:
    """Make pictures until the process that asked for them is gone: a few of each kind, those to measure, as many as
    are held, then as many as are used up. `crops` counts how many were trained on (a shared value)."""
    os.nice(19)
    threading.Thread(target=_end_with, args=[parent_process()], daemon=True).start()
    cv2.setNumThreads(1)
    kinds, begun = practice_kinds(plugin, classes), crops.value
    whole = sum(kind.share for kind in kinds.values())
    made = {name: len(list((folder / name / "images").glob("*.jpg"))) for name in kinds}
    measure = {name: len(list((folder / HELD_OUT / name / "images").glob("*.jpg"))) for name in kinds}
    while True:
        name = min(kinds, key=lambda name: made[name] / kinds[name].share)
        short = next((name for name, kind in kinds.items() if measure[name] < kind.held_out), None)
        if made[name] and short is not None:
            number = newest(folder / HELD_OUT / short) + 1 or HELD_OUT_NUMBER
            measure[short] += add(folder / HELD_OUT / short, kinds[short], number, classes, kinds[short].held_out)
        elif sum(made.values()) > CAPACITY + (crops.value - begun) / USES:
            time.sleep(IDLE_S)
        else:
            number = max(newest(folder / name) + 1, FIRST_NUMBER * (1 + [*kinds].index(name)))
            most = round(CAPACITY * kinds[name].share / whole)
            made[name] += add(folder / name, kinds[name], number, classes, most)


def _end_with(parent: Any) -> None:
    """A process that is killed cannot end those that work for it."""
    parent.join()
    os._exit(1)
