"""What `savmap train` and `savmap adapt` print of a network."""

import json
from collections.abc import Iterator, Mapping
from itertools import chain
from typing import Any

from savmap.lab.adapt.records import Adapted, RoundResult, mean
from savmap.lab.train import LEAST_TO_CALIBRATE, VALIDATION, TrainedNetwork


def network_lines(network: TrainedNetwork) -> Iterator[str]:
    """The files, then the recipe; or, of a network that was fine-tuned, its scores before and after."""
    yield from (f"wrote {file}" for file in network.files)
    if not network.plan.fine_tunes:
        yield json.dumps(network.recipe, indent=2)
        return
    yield from score_lines(network)
    yield f"{network.recipe['steps']} steps in {network.recipe['minutes']} minutes"


def score_lines(network: TrainedNetwork) -> Iterator[str]:
    """A table of intersection over union and calibration error, before and after, and what integers lose."""
    recipe, classes = network.recipe, network.plan.classes
    first = f"{'pictures':24s} {'network':8s}"
    yield first + "".join(f"{name:>12s}" for name in classes) + f"{'mean':>12s}{'calibration error':>20s}"
    for name, files in recipe["scores"].items():
        for when, score in files.items():
            known = [score["iou"].get(label) for label in classes]
            mean = sum(filter(None, known)) / max(sum(iou is not None for iou in known), 1)
            cells = "".join(f"{'-':>12s}" if iou is None else f"{iou:12.3f}" for iou in (*known, mean))
            title = f"{name} ({score['pictures']})"
            yield f"{title:24s} {when:8s}{cells}{score['calibration error']:20.4f}"
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
        both = [label for label in after if label in integers]
        yield name, sum(after[label] - integers[label] for label in both) / max(len(both), 1)


def _elsewhere(one: RoundResult) -> str:
    """What a round made of other places: whether the network forgets."""
    if not one.others_before:
        return "other places: not measured; "
    return f"on other places {mean(one.others_before):.3f} before, {mean(one.others_after):.3f} after; "


def adapted_lines(adapted: Adapted) -> Iterator[str]:
    """What was learned from what, before and after, and how the network is used."""
    for one in adapted.rounds:
        yield (
            f"round {one.number}: learned from {one.views} views; on {one.held_out} held out IoU with the map "
            f"{mean(one.iou_before):.3f} before, {mean(one.iou_after):.3f} after; {_elsewhere(one)}"
            f"{'kept' if one.kept else 'not kept'}: {one.why}"
        )
    before, after = adapted.iou_before, adapted.iou_after
    if adapted.kept is not None:
        yield "IoU with the map: " + ", ".join(
            f"{name} {before.get(name, 0.0):.3f} -> {iou:.3f}" for name, iou in after.items()
        )
    yield f"structures in the map: {adapted.structures_before} before, {adapted.structures_after} after"
    yield from (f"wrote {file}" for file in (*adapted.files, adapted.report))
    if adapted.kept is None:
        yield "the network stays as it is"
    else:
        model = next((file for file in adapted.files if file.name.endswith(".int8.onnx")), adapted.files[0])
        yield f"to use it, say in the site file: plugins: {{{adapted.plugin}: {{model: {model}}}}}"
