"""One network, from nothing or a checkpoint to ONNX files, within a budget of seconds."""

import copy
import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from savmap.lab.train.data.augment import Crop
from savmap.lab.train.data.dataset import SIDE
from savmap.lab.train.data.sets import read_sets
from savmap.lab.train.export import export, set_metadata
from savmap.lab.train.made import measure
from savmap.lab.train.made.learn import Learner
from savmap.lab.train.made.network import TwoScaleNetwork, exported, start
from savmap.lab.train.made.pool import Pool, acceptance
from savmap.lab.train.made.streams import PAINTED, Stream
from savmap.lab.train.made.vary import Variety, homographies, varied, warped
from savmap.lab.train.quantise import write_quantised

DATA = "data"
SAVED_EVERY_S = 60.0
SAID_EVERY_S = 10.0
TAKEN_A_STEP = 200
Say = Callable[[str], None]


@dataclass(frozen=True)
class Budget:
    """When to end: seconds on the clock `time.monotonic` or steps, whichever comes first; and sizes of what is held and
    of a batch."""

    until: float
    steps: int | None = None
    batch: int = 64
    capacity: int = 30_000
    at_least: int = 300
    crop: Crop = field(default_factory=lambda: Crop(512, 384))


@dataclass(frozen=True)
class Task:
    """A plugin's network, its classes, the kinds of made-up pictures with their shares, data sets of labelled pictures
    with theirs together, sets that only measure, and what to begin with."""

    plugin: str
    classes: tuple[str, ...]
    kinds: Mapping[str, float]
    data: Sequence[Path] = ()
    held_out: Sequence[Path] = ()
    data_share: float = 0.3
    begin: Path | None = None


def accepted_rows(classes: Sequence[str], kinds: Sequence[str]) -> dict[str, NDArray[np.float32]]:
    """Where members' sides are not told from their fronts or from the background, sides may be seen: of photographs the
    labels hold whole members, so that a front is better and a side right by half."""
    rows = {}
    for kind in kinds:
        table = np.eye(len(classes) + 1, dtype=np.float32)
        for name in classes:
            side = f"{name}{SIDE}"
            if side in classes:
                at = classes.index(side) + 1
                if kind == DATA:
                    table[classes.index(name) + 1, at] = 0.5
                elif kind != PAINTED:
                    table[0, at] = 1
        rows[kind] = table
    return rows


class Training:
    """A task under way."""

    def __init__(
        self, task: Task, budget: Budget, device: torch.device, published: Mapping[str, Any] | None, say: Say
    ) -> None:
        self.task, self.budget, self.device, self.say = task, budget, device, say
        self.learner = Learner(start(len(task.classes), published), device)
        if task.begin is not None:
            self.learner.restore(torch.load(task.begin, map_location=device, weights_only=True))
        self.pool = Pool(budget.capacity, [DATA, *task.kinds], device)
        self.held: dict[str, measure.HeldOut] = {}
        self.rows = accepted_rows(task.classes, [DATA, *task.kinds])
        self.rng = np.random.default_rng(0)
        self.steps = 0
        self._read()

    def _read(self) -> None:
        samples = [sample for dataset in read_sets(self.task.data, self.task.classes) for sample in dataset.samples]
        sizes: dict[str, int] = {}
        for sample in samples:
            sizes[sample.group] = sizes.get(sample.group, 0) + 1
        for sample in samples:
            self.pool.add(DATA, [sample.load()], sizes[sample.group] ** -0.5, keep=True)
        for dataset in read_sets(self.task.held_out, self.task.classes):
            for sample in dataset.samples:
                self.held.setdefault(DATA, measure.HeldOut()).add(*sample.load())

    @property
    def shares(self) -> dict[str, float]:
        """Of the kinds in a batch."""
        total = sum(self.task.kinds.values())
        made = {kind: (1 - self.task.data_share) * share / total for kind, share in self.task.kinds.items()}
        return {DATA: self.task.data_share, **made}

    def collect(self, stream: Stream, wait_s: float = 0.0) -> None:
        """Take over what workers have made."""
        for _ in range(TAKEN_A_STEP if not wait_s else 20):
            made = stream.take(wait_s)
            if made is None:
                return
            if made.held_out:
                self.held.setdefault(made.kind, measure.HeldOut()).add(*made.sample)
            else:
                self.pool.add(made.kind, [made.sample])

    def step(self, done: float) -> torch.Tensor:
        """One batch."""
        crop, classes = self.budget.crop, len(self.task.classes)
        images, masks, kinds = self.pool.draw(self.budget.batch, self.shares, self.rng)
        with torch.no_grad():
            places = homographies(len(kinds), crop, images.shape[3], images.shape[2], self.rng).to(self.device)
            crops, labels = warped(images, masks, places, crop, classes)
            seen = varied(crops, labels, classes, Variety())
        accepted = acceptance(kinds, self.rows, classes, self.device)
        self.steps += 1
        return self.learner.step(seen, labels, accepted, done)

    def fit(self, stream: Stream, save: Callable[[], None]) -> None:
        """Train until the budget is spent."""
        before = self.pool.added
        while self.pool.added < before + self.budget.at_least:
            self.collect(stream, 1.0)
        began = said = saved = time.monotonic()
        while True:
            now = time.monotonic()
            done = min(1.0, (now - began) / max(self.budget.until - began, 1e-3))
            if self.budget.steps is not None:
                done = max(done, self.steps / self.budget.steps)
            if done >= 1.0:
                return
            self.collect(stream)
            loss = self.step(done)
            if now - said > SAID_EVERY_S or self.steps < 3:
                rate = self.steps / max(time.monotonic() - began, 1e-3)
                self.say(
                    f"step {self.steps}, {done:.0%}, loss {float(loss):.4f}, {rate:.2f} steps/s, "
                    f"pictures {self.pool.counts()}"
                )
                said = now
            if now - saved > SAVED_EVERY_S:
                save()
                saved = now

    def scores(self) -> tuple[dict[str, dict[str, float]], dict[str, tuple[torch.Tensor, torch.Tensor]]]:
        """IoU of the averaged network by kind, and pixels to calibrate by."""
        ious, pixels = {}, {}
        for kind, held in self.held.items():
            logits = held.logits(self.learner.average, self.device)
            ious[kind] = measure.ious(logits, held.masks, self.rows[kind], self.task.classes) | {
                "pictures": len(logits)
            }
            pixels[kind] = measure.pixels(logits, held.masks, self.rows[kind])
        return ious, pixels


@dataclass(frozen=True, eq=False)
class Held:
    """A picture in memory, as quantisation reads it."""

    image: NDArray[np.uint8]
    mask: NDArray[np.uint8]

    def load(self) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        return self.image, self.mask


def some_pictures(training: Training, count: int = 48) -> list[Held]:
    """Pictures that were trained on, for the ranges of activations."""
    images, masks, _ = training.pool.draw(count, training.shares, training.rng)
    pairs = zip(images.permute(0, 2, 3, 1).cpu().numpy(), masks.cpu().numpy(), strict=True)
    return [Held(np.ascontiguousarray(image), mask) for image, mask in pairs]


def calibrated(training: Training) -> tuple[TwoScaleNetwork, dict[str, object], str]:
    """The averaged network with its temperature folded in, what is known of it, and its calibration (JSON)."""
    ious, pixels = training.scores()
    least = min(len(labels) for _, labels in pixels.values())
    steps = {kind: max(1, len(labels) // least) for kind, (_, labels) in pixels.items()}
    divided_by = measure.temperature(
        torch.cat([pixels[kind][0][::step] for kind, step in steps.items()]),
        torch.cat([pixels[kind][1][::step] for kind, step in steps.items()]),
    )
    network = copy.deepcopy(training.learner.average).cpu()
    with torch.no_grad():
        for part in network.logits.parameters():
            part /= divided_by
    training.say(f"{training.task.plugin}: {json.dumps(ious)}, temperature {divided_by:.3f}")
    about = {"steps": training.steps, "made": training.pool.added, "validation": ious, "temperature": divided_by}
    return network, about, measure.calibration(pixels, training.task.classes, divided_by)


def write(
    weights: Mapping[str, NDArray[np.float32]],
    classes: Sequence[str],
    recipe: Mapping[str, object],
    table: str,
    pictures: Sequence[Any],
    output: Path,
) -> None:
    """Write `output` (ONNX, float32) and its 8-bit version."""
    network = TwoScaleNetwork(len(classes))
    network.load_state_dict({name: torch.from_numpy(np.array(value)) for name, value in weights.items()})
    export(exported(network), classes, recipe, output)
    set_metadata(output, {"savmap.calibration": table})
    write_quantised(output, pictures, output.with_suffix(".int8.onnx"), count=len(pictures))


def save_weights(training: Training, path: Path) -> None:
    """Averaged weights, halved in precision, and the network's, to go on from."""
    parts = {"average": training.learner.average.state_dict(), "network": training.learner.network.state_dict()}
    small = {
        part: {k: v.detach().half().cpu() if v.is_floating_point() else v.cpu() for k, v in state.items()}
        for part, state in parts.items()
    }
    partial = path.with_name(f".{path.name}")
    torch.save({**small, "updates": training.learner.updates}, partial)
    partial.replace(path)
