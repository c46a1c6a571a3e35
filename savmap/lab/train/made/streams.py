"""Endless labelled pictures for a plugin's network, made by worker processes while it trains.

`painted` ones come from the plugin's hook `practice_picture`, the others from the simulator's random scenes: `face`,
`row`, `ceiling` and `mixed` views of them (`savmap.lab.sim.dataset`). The first pictures of each worker are kept from
training."""

import multiprocessing
import queue
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import count, islice
from typing import Any, cast

import cv2
import numpy as np

from savmap.errors import SavmapError
from savmap.lab.plugins import lab_plugin
from savmap.lab.sim.dataset import Sample, samples
from savmap.lab.sim.drive.views import Kind
from savmap.lab.sim.random_scene import random_scene

PAINTED = "painted"
HELD_OUT = 12
"""Pictures of one kind that a worker makes first, for measuring."""
CHUNK = 8
VIEWS_A_SCENE = 10
"""A scene takes as long as eight views of it."""
MOST_WAITING = 4000
WITHOUT_END = 1 << 30
FIRST_SEED, HELD_OUT_SEED = 20_000, 10_000


@dataclass(frozen=True, eq=False)
class Made:
    """A picture of a kind, whether it only measures, and its mask."""

    kind: str
    held_out: bool
    sample: Sample


def pictures(plugin: str, classes: Sequence[str], kind: str, seed: int) -> Iterator[Sample]:
    """Pictures of a kind without end; the same seed gives the same. Raises SavmapError where a plugin makes none."""
    if kind != PAINTED:
        scene_of, views = partial(random_scene, plugins=[plugin]), cast(Kind, kind)
        for _, picture, mask in samples(seed, WITHOUT_END, views, classes, scene_of, VIEWS_A_SCENE):
            yield picture, mask
        return
    lab = lab_plugin(plugin)
    if lab is None or not lab.has("practice_picture"):
        raise SavmapError(f"plugin `{plugin}` paints no pictures (hook `practice_picture`)")
    yield from (lab.practice_picture(seed, index) for index in count())


def _work(
    outbox: Any, plugin: str, classes: Sequence[str], kinds: Mapping[str, float], worker: int, first: int
) -> None:
    cv2.setNumThreads(1)
    measured = list(kinds)[worker % len(kinds)]
    for sample in islice(pictures(plugin, classes, measured, HELD_OUT_SEED + worker), HELD_OUT):
        outbox.put(Made(measured, True, sample))
    endless = {kind: pictures(plugin, classes, kind, FIRST_SEED + first + worker) for kind in kinds}
    rng = np.random.default_rng([first, worker])
    chances = np.array(list(kinds.values())) / sum(kinds.values())
    while True:
        kind = str(rng.choice(list(kinds), p=chances))
        for sample in islice(endless[kind], CHUNK):
            outbox.put(Made(kind, False, sample))


class Stream:
    """Pictures of some kinds, by their chances, from `workers` processes; `first` sets apart the pictures of runs that
    go on from one another."""

    def __init__(
        self, plugin: str, classes: Sequence[str], kinds: Mapping[str, float], workers: int, first: int = 0
    ) -> None:
        context = multiprocessing.get_context("spawn")
        self._inbox: Any = context.Queue(maxsize=MOST_WAITING)
        self._workers = [
            context.Process(
                target=_work, args=(self._inbox, plugin, list(classes), dict(kinds), worker, first), daemon=True
            )
            for worker in range(workers)
        ]
        for process in self._workers:
            process.start()

    def take(self, wait_s: float = 0.0) -> Made | None:
        """The next picture; None where none comes in time. Raises SavmapError where all workers failed."""
        try:
            made: Made = self._inbox.get(timeout=wait_s) if wait_s else self._inbox.get_nowait()
            return made
        except queue.Empty:
            if not any(worker.is_alive() for worker in self._workers):
                raise SavmapError("no process that makes pictures is left; see the errors above") from None
            return None

    def close(self) -> None:
        """End the workers."""
        for worker in self._workers:
            worker.terminate()
        self._inbox.cancel_join_thread()
