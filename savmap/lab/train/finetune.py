"""From an exported network and a few hundred pictures of another style to a network that knows that style too.

Its confidence is calibrated by one temperature for all logits, fitted to pictures that were not trained on (Guo et al.,
On Calibration of Modern Neural Networks, 2017). That changes no decision between classes, only how sure they are.
"""

import copy
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from torch import Tensor
from torch.nn import functional

from savmap.errors import OutputError
from savmap.lab.train.checkpoint import SUFFIX, ResumeFile, run_key, save_checkpoint
from savmap.lab.train.data.dataset import IGNORE, Sample, held_out, set_name
from savmap.lab.train.data.sets import read_sets, samples_of
from savmap.lab.train.export import export, load_onnx, with_recipe
from savmap.lab.train.loop import described, fit, resumed, source_of
from savmap.lab.train.measure import Reliability, score_file, score_network
from savmap.lab.train.network import SegmentationNetwork
from savmap.lab.train.plan import LEAST_TO_CALIBRATE, VALIDATION, Progress, TrainedNetwork, TrainingPlan, warning_of
from savmap.lab.train.quantise import write_quantised
from savmap.lab.train.trainer import Hyperparameters, Trainer, predictor

SHARE = 0.2
"""How many of the pictures are kept to choose, calibrate and measure by, where no set is given for that."""
EVERY_PX = 5
LEAST, MOST = 0.25, 4.0
"""Range of temperatures that are tried."""


def fine_tune(plan: TrainingPlan, progress: Progress, settings: Hyperparameters) -> TrainedNetwork:
    """Train an exported network further, keep the best one by the validation pictures, calibrate, export and measure
    it.

    Raises OutputError for a data set, ModelError for a network that cannot be used.
    """
    assert plan.init is not None
    torch.manual_seed(plan.seed)
    replay = read_sets(plan.replay, plan.classes, plan.mapping, plan.replay_every)
    datasets = [*read_sets(plan.data, plan.classes, plan.mapping), *replay]
    samples = samples_of(datasets)
    tests = named_tests(plan, samples)
    choosing = samples_of(read_sets(plan.choose_by, plan.classes, plan.mapping))
    training, validation = (samples, choosing) if choosing else held_out(samples, SHARE)
    network, history = load_onnx(plan.init, plan.classes)
    progress(0.0, f"{len(training)} pictures to train on, {len(validation)} to choose and to calibrate by")
    trainer = Trainer(network, settings)
    progress(0.0, f"computing on {trainer.device.type}")
    replayed = {sample.origin for dataset in replay for sample in dataset.samples}
    key = run_key(plan.classes, samples, plan.seed, plan.init, settings, replayed)
    kept = ResumeFile(plan.output.with_suffix(SUFFIX), key)
    state = resumed(kept, trainer, progress)
    recipe: dict[str, Any] = described(datasets, plan.seed, plan.minutes, settings) | {"from": plan.init.name}
    source = source_of(plan, training, settings, state, replayed)

    def validate() -> None:
        averaged = trainer.average.network
        score = score_network(predictor(averaged), validation, plan.classes, settings.validation_limit)
        state.record(score.mean, averaged.state_dict())
        progress(plan.done(state.steps, state.spent_s), f"validation IoU {score.mean:.3f}")
        kept.save(trainer, state)

    fit(trainer, source, state, plan, progress, lambda: kept.save(trainer, state), validate)
    chosen = trainer.average.network.cpu()
    if state.best is not None:
        chosen.load_state_dict(state.best)
    recipe |= {"steps": state.steps, "minutes": round(state.spent_s / 60, 1)}
    recipe |= {"validation IoU along the way": [round(score, 4) for score in state.scores]}
    progress(1.0, "calibrating")
    calibrated, recipe["calibration"] = calibration(chosen, validation)
    save_checkpoint(plan.checkpoint, chosen, plan.classes, [*history, recipe])
    export(calibrated, plan.classes, recipe | {"earlier": history}, plan.output)
    if plan.int8:
        write_quantised(plan.output, training, plan.integers)
    recipe |= measured(plan, {VALIDATION: validation, **tests}, progress)
    after = recipe["scores"][VALIDATION]["after"]["iou"].values()
    recipe |= warning_of(plan, sum(after) / max(len(after), 1), state.steps)
    files = (plan.output, plan.integers) if plan.int8 else (plan.output,)
    for file in files:
        with_recipe(file, recipe | {"earlier": history})
    kept.done()
    return TrainedNetwork(plan, files, recipe)


def measured(plan: TrainingPlan, sets: Mapping[str, Sequence[Sample]], progress: Progress) -> dict[str, Any]:
    """The recipe's entry `scores`: of each set, what the network was before, is after, and is in integers."""
    assert plan.init is not None
    files = {"before": plan.init, "after": plan.output} | ({"int8": plan.integers} if plan.int8 else {})
    return {
        "scores": {
            name: {when: score_of_file(file, samples, plan, progress) for when, file in files.items()}
            for name, samples in sets.items()
        }
    }


def named_tests(plan: TrainingPlan, samples: Sequence[Sample]) -> dict[str, Sequence[Sample]]:
    """The sets to be measured on by their names. Raises OutputError for one with pictures of `samples`, which are
    trained on, or two of one name."""
    tests: dict[str, Sequence[Sample]] = {}
    trained = {sample.image_digest for sample in samples}
    for source, dataset in zip(plan.held_out, read_sets(plan.held_out, plan.classes, plan.mapping), strict=True):
        name = set_name(dataset.folder)
        shared = [sample.image.name for sample in dataset.samples if sample.image_digest in trained]
        if shared:
            raise OutputError(
                f"--held-out {source}: {shared[0]} is also trained on, {len(shared)} of {len(dataset.samples)} "
                "pictures in all; give another set, or leave it out"
            )
        if name in tests or name == VALIDATION:
            raise OutputError(f"--held-out {source}: two sets would be called {name}; rename its folder")
        tests[name] = dataset.samples
    return tests


def calibration(
    network: SegmentationNetwork, validation: Sequence[Sample]
) -> tuple[SegmentationNetwork, Mapping[str, float]]:
    """The network with its temperature folded in; the temperature, and the expected calibration error without it and
    with it.

    With fewer pictures than `LEAST_TO_CALIBRATE` the temperature is 1."""
    logits, labels = logits_of(network, validation)
    temperature = temperature_for(logits, labels) if len(validation) >= LEAST_TO_CALIBRATE else 1.0
    errors = []
    for divisor in (1.0, temperature):
        reliability = Reliability()
        reliability.add(softmax(logits / divisor), labels.numpy().astype("uint8"))
        errors.append(reliability.error)
    figures = {"temperature": temperature, "error before": errors[0], "error after": errors[1]}
    return with_temperature(network, temperature), {name: round(value, 5) for name, value in figures.items()}


def score_of_file(
    file: Path, samples: Sequence[Sample], plan: TrainingPlan, progress: Progress
) -> Mapping[str, object]:
    """How well the network in a file does on pictures."""
    progress(1.0, f"measuring {file.name} on {len(samples)} pictures")
    return score_file(file, samples, plan.classes).as_json()


def logits_of(network: SegmentationNetwork, samples: Sequence[Sample]) -> tuple[Tensor, Tensor]:
    """Logits (n, classes) and labels (n,) of every fifth pixel in both directions that is judged."""
    logits, labels = [], []
    for sample in samples:
        image, truth = sample.load()
        with torch.inference_mode():
            maps = network.eval()(torch.from_numpy(np.ascontiguousarray(image.transpose(2, 0, 1))[None]).float())[0]
        chosen = truth[::EVERY_PX, ::EVERY_PX]
        valid = torch.from_numpy(chosen != IGNORE)
        logits.append(maps[:, ::EVERY_PX, ::EVERY_PX].permute(1, 2, 0)[valid])
        labels.append(torch.from_numpy(chosen.astype(np.int64))[valid])
    return torch.cat(logits), torch.cat(labels)


def temperature_for(logits: Tensor, labels: Tensor) -> float:
    """The temperature under which the labels (n,) are most likely, given logits (n, classes)."""

    def cost(log_temperature: float) -> float:
        return float(functional.cross_entropy(logits / float(np.exp(log_temperature)), labels))

    optimum = minimize_scalar(cost, bounds=(np.log(LEAST), np.log(MOST)), method="bounded", options={"xatol": 1e-3})
    return float(np.exp(optimum.x))


def with_temperature(network: SegmentationNetwork, temperature: float) -> SegmentationNetwork:
    """A copy whose logits are divided by a temperature, in the weights of its last layer."""
    cooled = copy.deepcopy(network)
    with torch.no_grad():
        cooled.finish.logits.weight /= temperature
        assert cooled.finish.logits.bias is not None
        cooled.finish.logits.bias /= temperature
    return cooled


def softmax(logits: Tensor) -> NDArray[np.float32]:
    """Probabilities (classes, n) of logits (n, classes)."""
    return np.asarray(torch.softmax(logits, dim=1).T.numpy(), np.float32)
