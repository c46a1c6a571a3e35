"""A plugin's network trained on until it is killed, and what it is worth along the way."""

import fcntl
import io
import json
import multiprocessing
import os
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch

from savmap.errors import OutputError
from savmap.files.atomic import write_bytes
from savmap.lab.plugins import lab_plugin
from savmap.lab.train.checkpoint import BROKEN, Recipe
from savmap.lab.train.data.augment import HARDER, VARIATIONS, Batch, Bytes, augment
from savmap.lab.train.data.dataset import SIDE, Sample
from savmap.lab.train.data.sets import read_set
from savmap.lab.train.export import export, load_onnx
from savmap.lab.train.made.pictures import HELD_OUT, Kind, make, practice_kinds
from savmap.lab.train.measure import measure
from savmap.lab.train.network import build
from savmap.lab.train.quantise import write_quantised
from savmap.lab.train.trainer import Hyperparameters, Trainer, predictor
from savmap.plugin.manager import load_class

SETTINGS = Hyperparameters(
    batch=8,
    encoder_rate=1e-4,
    decoder_rate=5e-4,
    average_decay=0.9995,
    frozen_statistics=True,
    variation=HARDER,
)
"""A constant rate of half of that with which a network is trained on for minutes; the average is over 16,000 crops."""
WARM_UP_STEPS = 500
DATA_SHARE = 0.2
SAID_EVERY_S, SAVED_EVERY_S = 60.0, 600.0
MEASURED_EVERY = 2_000
"""Crops: to measure takes as long as 120 of them, on a busy machine too."""
LEAST_PICTURES = 100
CHECKPOINT, DECAYED, LOG = "checkpoint.pt", "decayed", "train.log"


@dataclass
class State:
    """How far a training is: steps, crops, seconds spent on them; the steps after which its rate falls and is nothing,
    if it does; and the recipes of what it began with."""

    plugin: str
    classes: Sequence[str]
    history: Sequence[Recipe]
    steps: int = 0
    crops: int = 0
    spent_s: float = 0.0
    falls_from: int | None = None
    ends_at: int | None = None

    @property
    def rate(self) -> float:
        """Of the largest rate, 0..1."""
        if self.falls_from is not None and self.ends_at is not None:
            return max(0.0, (self.ends_at - self.steps) / (self.ends_at - self.falls_from))
        return min(1.0, (1 + self.steps) / WARM_UP_STEPS)


class Pictures:
    """The pictures in a training's folder by kind, as many as there are now."""

    def __init__(self, folder: Path, kinds: Mapping[str, Kind], classes: Sequence[str]) -> None:
        self.folder, self.kinds, self.classes = folder, kinds, classes
        self.sets: dict[str, Sequence[Sample]] = {}
        self.shares: dict[str, float] = {}

    def refresh(self) -> None:
        """See what is there: kinds that are not there yet give their share to the others."""
        made = {name: self.folder / "pictures" / name for name in self.kinds}
        made = {name: path for name, path in made.items() if any((path / "images").glob("*.jpg"))}
        data = {str(path): path for path in (self.folder / "data").glob("*") if path.is_dir()}
        self.sets = {name: read_set(path, self.classes).samples for name, path in {**made, **data}.items()}
        total = sum(self.kinds[name].share for name in made) / (1 - DATA_SHARE * bool(data))
        labelled = sum(len(self.sets[name]) for name in data) / DATA_SHARE
        self.shares = {name: self.kinds[name].share / total for name in made}
        self.shares |= {name: len(self.sets[name]) / labelled for name in data}

    def held_out(self) -> dict[str, Sequence[Sample]]:
        """Kinds and pictures that only measure; none until all are made."""
        folders = {name: self.folder / "pictures" / HELD_OUT / name for name in self.kinds if self.kinds[name].held_out}
        counts = {name: len(list((folder / "images").glob("*.jpg"))) for name, folder in folders.items()}
        if any(count < self.kinds[name].held_out for name, count in counts.items()):
            return {}
        return {name: read_set(folder, self.classes).samples for name, folder in folders.items()}

    def batch(self, number: int) -> Batch:
        """The batch of a number, of what is there now."""
        rng, crops = np.random.default_rng(number), list[tuple[Bytes, Bytes]]()
        chances = np.array([self.shares[name] for name in self.sets])
        while len(crops) < SETTINGS.batch:
            samples = self.sets[str(rng.choice([*self.sets], p=chances / chances.sum()))]
            try:
                image, mask = samples[int(rng.integers(len(samples)))].load()
            except OutputError:  # another picture has taken its place meanwhile
                continue
            crops.append(augment(rng, image, mask, SETTINGS.crop, len(self.classes), VARIATIONS[SETTINGS.variation]))
        return np.stack([image for image, _ in crops]), np.stack([mask for _, mask in crops])


def save(file: Path, state: State, trainer: Trainer) -> None:
    """Write all that `restored` needs to go on, whole or not at all. Raises OutputError."""
    content = io.BytesIO()
    torch.save({"state": json.dumps(asdict(state)), "trainer": trainer.state()}, content)
    write_bytes(file, content.getvalue())


def restored(file: Path) -> tuple[State, Trainer]:
    """The state and the network of a checkpoint. Raises OutputError."""
    try:
        content: dict[str, Any] = torch.load(file, map_location="cpu", weights_only=True)
        state = State(**json.loads(content["state"]))
        trainer = Trainer(build(len(state.classes), None), SETTINGS)
        trainer.restore(content["trainer"])
    except BROKEN as error:
        raise OutputError(f"{file}: is no checkpoint of this training; begin with --init FILE.onnx") from error
    return state, trainer


def begun(plugin: str, init: Path) -> tuple[State, Trainer]:
    """A training that begins with an ONNX file. Raises ModelError, PluginError."""
    lab = lab_plugin(plugin)
    classes = (lab.network_classes if lab is not None else ()) or load_class(plugin).classes
    network, history = load_onnx(init, classes)
    return State(plugin, list(classes), history), Trainer(network, SETTINGS)


def say(folder: Path, text: str) -> None:
    """Print a line, and add it to the folder's log."""
    line = f"{datetime.now(UTC):%Y-%m-%d %H:%M:%S}  {text}"
    print(line, flush=True)
    with (folder / LOG).open("a", encoding="utf-8") as log:
        log.write(f"{line}\n")


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold a folder, so that no two trainings write into it. Raises OutputError."""
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "lock").open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise OutputError(f"{folder}: a training runs there; end it first, or choose another -o") from None
        yield


def train(folder: Path, file: Path, state: State, trainer: Trainer) -> None:
    """Train until killed, or until the rate has fallen to nothing; then write the network. Raises OutputError."""
    crops = multiprocessing.get_context("spawn").Value("q", 0)
    what = (state.plugin, state.classes, folder / "pictures", crops)
    maker = multiprocessing.get_context("spawn").Process(target=make, args=what, daemon=True)
    maker.start()
    kinds = practice_kinds(state.plugin, state.classes)
    pictures = Pictures(folder, kinds, state.classes)
    while sum(map(len, pictures.sets.values())) < LEAST_PICTURES:
        time.sleep(1.0)
        pictures.refresh()
    said = saved = time.monotonic()
    cpu, before, losses = time.process_time(), replace(state), list[float]()
    say(folder, f"going on after {state.crops} crops")
    preparing = ThreadPoolExecutor(1)
    following = preparing.submit(pictures.batch, state.steps)
    while state.ends_at is None or state.steps < state.ends_at:
        began = time.monotonic()
        images, labels = following.result()
        following = preparing.submit(pictures.batch, state.steps + 1)
        losses.append(trainer.step((images, labels), state.rate))
        state.steps, state.crops = state.steps + 1, state.crops + len(images)
        state.spent_s += (now := time.monotonic()) - began
        crops.value += len(images)
        if now - said > SAID_EVERY_S:
            new, used = state.crops - before.crops, time.process_time() - cpu
            rates = f"{new / (now - said):.2f} crops/s, {new / used:.2f} a processor second"
            say(folder, f"{state.crops:9d} crops  {rates}, loss {np.mean(losses):.4f}")
            preparing.submit(pictures.refresh)
            if not maker.is_alive():
                say(folder, "no process makes pictures any more; those that are there are used")
            if state.crops // MEASURED_EVERY > before.crops // MEASURED_EVERY:
                report(state, trainer, pictures)
            if now - saved > SAVED_EVERY_S:
                save(file, state, trainer)
                saved = time.monotonic()
            said, cpu, before, losses = time.monotonic(), time.process_time(), replace(state), []
    save(file, state, trainer)
    report(state, trainer, pictures)
    written(folder / f"{DECAYED}.onnx", state, trainer, pictures)


def written(output: Path, state: State, trainer: Trainer, pictures: Pictures) -> None:
    """Write the averaged network, in float32 and 8-bit integers. Raises OutputError."""
    recipe = {"steps": state.steps, "crops": state.crops, "minutes": state.spent_s / 60, "settings": asdict(SETTINGS)}
    recipe |= {"augmentation": VARIATIONS[SETTINGS.variation].chances(), "kinds": pictures.shares}
    export(trainer.average.network, state.classes, {**recipe, "earlier": state.history}, output)
    write_quantised(output, [s for some in pictures.sets.values() for s in some], output.with_suffix(".int8.onnx"))
    say(output.parent, f"{output} and its 8-bit version are written")


def report(state: State, trainer: Trainer, pictures: Pictures) -> None:
    """Say what the averaged network makes of each kind that is held out: intersection over union and edges' spread of
    the classes that are needed."""
    names = [name for name in state.classes if not name.endswith(SIDE)]
    for kind, samples in pictures.held_out().items():
        scores = measure(predictor(trainer.average.network), samples, state.classes)
        figures = (
            f"{name} IoU {scores[name].get('iou', np.nan):.3f} spread {scores[name].get('spread_px', np.nan):.2f} px"
            for name in names
        )
        say(pictures.folder, f"{state.crops:9d} crops  {kind}: {', '.join(figures)}")


def give_way() -> None:
    """Let all other programs go first. Linux may share processors out by session, not by process (autogroup): then the
    session's share is lowered, too, where nothing but this began in it."""
    os.nice(19)
    if os.getsid(0) == os.getpid():
        with suppress(OSError):
            Path("/proc/self/autogroup").write_text("19", encoding="ascii")


def run(folder: Path, plugin: str | None, init: Path | None, share: float | None) -> None:
    """Begin a training with an ONNX file, or go on; or let the rate fall over the last `share` of all steps, from the
    checkpoint, which stays as it is. Raises SavmapError."""
    give_way()
    cv2.setNumThreads(1)
    with locked(folder):
        file = folder / CHECKPOINT
        if plugin is not None and init is not None:
            state, trainer = begun(plugin, init)
            state.history = [*state.history, {"begins with": init.name, "date": datetime.now(UTC).date().isoformat()}]
            save(file, state, trainer)
        elif share is None:
            state, trainer = restored(file)
        else:
            file = folder / f"{DECAYED}.pt"
            state, trainer = restored(file if file.is_file() else folder / CHECKPOINT)
            if state.falls_from is None:
                ends_at = round(state.steps / (1 - share))
                state = replace(state, falls_from=state.steps, ends_at=ends_at)
        train(folder, file, state, trainer)
        file.unlink()
