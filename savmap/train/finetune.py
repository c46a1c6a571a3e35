"""From an exported network and a few hundred pictures of another style to a network that knows that style too."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import Any

import torch

from savmap.errors import OutputError
from savmap.train.calibrate import logits_of, softmax, temperature_for, with_temperature
from savmap.train.checkpoint import save_checkpoint
from savmap.train.dataset import Sample, held_out, set_name
from savmap.train.export import export, with_recipe
from savmap.train.from_onnx import load_onnx
from savmap.train.judge import Reliability, judge, judge_file
from savmap.train.loop import described, fit, resumed, source_of
from savmap.train.network import SegmentationNetwork
from savmap.train.quantise import write_quantised
from savmap.train.resume import SUFFIX, Resumption, run_print
from savmap.train.sets import read_sets, samples_of
from savmap.train.task import Progress, Task
from savmap.train.trainer import Settings, Trainer, predictor

VALIDATION = "validation"
SHARE = 0.2
"""How many of the pictures are kept to choose, calibrate and measure by."""
LEAST_TO_CALIBRATE = 5


def fine_tune(task: Task, progress: Progress, settings: Settings) -> Mapping[str, Any]:
    """Train on, take the best network by the validation pictures, calibrate, export, measure; returns the recipe.

    Raises OutputError for a data set, ModelError for a network that cannot be used.
    """
    assert task.init is not None
    torch.manual_seed(task.seed)
    datasets = read_sets(task.data, task.classes, task.mapping)
    samples = samples_of(datasets)
    tests = named_tests(task, samples)
    training, validation = held_out(samples, SHARE)
    network, history = load_onnx(task.init, task.classes)
    progress(0.0, f"{len(training)} pictures to train on, {len(validation)} to choose and measure by")
    trainer = Trainer(network, settings)
    print_ = run_print(task.classes, samples, task.seed, task.init, settings)
    kept = Resumption(task.output.with_suffix(SUFFIX), print_)
    course = resumed(kept, trainer, progress)
    recipe: dict[str, Any] = described(datasets, task.seed, task.minutes, settings) | {"from": task.init.name}
    source = source_of(task, training, settings, course)

    def look() -> None:
        averaged = trainer.average.network
        found = judge(predictor(averaged), validation, task.classes, settings.validation_limit)
        course.offer(found.mean, averaged.state_dict())
        progress(task.done(course.steps, course.spent_s), f"validation IoU {found.mean:.3f}")
        kept.save(trainer, course)

    fit(trainer, source, course, task, progress, lambda: kept.save(trainer, course), look)
    chosen = trainer.average.network
    if course.best is not None:
        chosen.load_state_dict(course.best)
    recipe |= {"steps": course.steps, "minutes": round(course.spent_s / 60, 1)}
    recipe |= {"validation IoU along the way": [round(one, 4) for one in course.scores]}
    progress(1.0, "calibrating")
    calibrated, recipe["calibration"] = calibration(chosen, validation)
    save_checkpoint(task.checkpoint, chosen, task.classes, [*history, recipe])
    export(calibrated, task.classes, recipe | {"earlier": history}, task.output)
    files = {"before": task.init, "after": task.output}
    if task.int8:
        files["int8"] = task.integers
        write_quantised(task.output, training, task.integers)
    judged = {VALIDATION: validation, **tests}
    recipe["scores"] = {
        name: {when: verdict_of(file, own, task, progress) for when, file in files.items()}
        for name, own in judged.items()
    }
    for file in files.values():
        if file != task.init:
            with_recipe(file, recipe | {"earlier": history})
    kept.done()
    return recipe


def named_tests(task: Task, samples: Sequence[Sample]) -> dict[str, Sequence[Sample]]:
    """The sets to be measured on by their names. Raises OutputError for one with pictures of `samples`, which are trained on, or two
    of one name."""
    found: dict[str, Sequence[Sample]] = {}
    trained = {one.image_digest for one in samples}
    for source, dataset in zip(task.held_out, read_sets(task.held_out, task.classes, task.mapping), strict=True):
        name = set_name(dataset.folder)
        known = [one.image.name for one in dataset.samples if one.image_digest in trained]
        if known:
            raise OutputError(
                f"--held-out {source}: {known[0]} is also trained on, {len(known)} of {len(dataset.samples)} pictures in all; "
                "give another set, or leave it out"
            )
        if name in found or name == VALIDATION:
            raise OutputError(f"--held-out {source}: two sets would be called {name}; rename its folder")
        found[name] = dataset.samples
    return found


def calibration(
    network: SegmentationNetwork, validation: Sequence[Sample]
) -> tuple[SegmentationNetwork, Mapping[str, float]]:
    """The network with its temperature folded in, and what that is and does to the expected calibration error. Fewer pictures than
    `LEAST_TO_CALIBRATE` tell none: it is 1."""
    logits, labels = logits_of(network, validation)
    temperature = temperature_for(logits, labels) if len(validation) >= LEAST_TO_CALIBRATE else 1.0
    errors = []
    for divisor in (1.0, temperature):
        reliability = Reliability()
        reliability.add(softmax(logits / divisor), labels.numpy().astype("uint8"))
        errors.append(reliability.error)
    figures = {"temperature": temperature, "error before": errors[0], "error after": errors[1]}
    return with_temperature(network, temperature), {name: round(value, 5) for name, value in figures.items()}


def verdict_of(file: Path, samples: Sequence[Sample], task: Task, progress: Progress) -> Mapping[str, object]:
    """What a file makes of pictures."""
    progress(1.0, f"measuring {file.name} on {len(samples)} pictures")
    return judge_file(file, samples, task.classes).as_json()


def report_lines(recipe: Mapping[str, Any], classes: Sequence[str]) -> Iterator[str]:
    """A table of intersection over union and calibration error, before and after, and what integers lose."""
    first = f"{'pictures':24s} {'network':8s}"
    yield first + "".join(f"{name:>12s}" for name in classes) + f"{'mean':>12s}{'calibration error':>20s}"
    for name, files in recipe["scores"].items():
        for when, verdict in files.items():
            known = [verdict["iou"].get(one) for one in classes]
            mean = sum(filter(None, known)) / max(sum(one is not None for one in known), 1)
            cells = "".join(f"{'-':>12s}" if one is None else f"{one:12.3f}" for one in (*known, mean))
            title = f"{name} ({verdict['pictures']})"
            yield f"{title:24s} {when:8s}{cells}{verdict['calibration error']:20.4f}"
    yield _calibrated(recipe)
    if len(recipe["scores"]) == 1:
        yield f"the network and its temperature were chosen by the {VALIDATION} pictures; --held-out SET measures on others"
    lost = dict(chain.from_iterable(_lost(name, files) for name, files in recipe["scores"].items()))
    if lost:
        yield "8-bit integers lose " + ", ".join(f"{loss:+.4f} IoU on {name}" for name, loss in lost.items())


def _calibrated(recipe: Mapping[str, Any]) -> str:
    figures, pictures = recipe["calibration"], recipe["scores"][VALIDATION]["before"]["pictures"]
    if pictures < LEAST_TO_CALIBRATE:
        return f"confidence is not calibrated: {pictures} validation pictures are too few, label more"
    return (
        f"temperature {figures['temperature']:.3f}, fitted to the validation pictures: calibration error on them "
        f"{figures['error before']:.4f} without it, {figures['error after']:.4f} with it"
    )


def _lost(name: str, files: Mapping[str, Any]) -> Iterator[tuple[str, float]]:
    if "int8" in files:
        after, integers = (files[when]["iou"] for when in ("after", "int8"))
        both = [one for one in after if one in integers]
        yield name, sum(after[one] - integers[one] for one in both) / max(len(both), 1)
