"""The commands `simulate`, `train`, `label` and `adapt`, and what they print of a network."""

import json
import os
from collections.abc import Iterator, Mapping
from itertools import chain
from pathlib import Path
from typing import Annotated, Any

import typer

from savmap.cli.commands.options import Output, Sets, output_option
from savmap.cli.console import Console
from savmap.cli.speech import say
from savmap.errors import visible
from savmap.files.urls import where
from savmap.lab.adapt.records import Adapted, AdaptOptions, RoundResult, mean
from savmap.lab.train import LEAST_TO_CALIBRATE, VALIDATION, TrainedNetwork, check, check_extra
from savmap.site.job import prepare
from savmap.site.overrides import overrides_of


def simulate(
    scene: Annotated[Path, typer.Argument(metavar="SCENE", help="A scene file.")],
    output: Output = Path("simulated"),
    mask: Annotated[list[str] | None, typer.Option(help="YAW,PITCH,HFOV: also write class masks of this view.")] = None,
) -> None:
    """Make footage of a made-up place, with its truth."""
    from savmap.lab.sim.render.raycast import require_ray_caster
    from savmap.lab.sim.scene.files import load_scene
    from savmap.lab.sim.simulate import mask_view
    from savmap.lab.sim.simulate import simulate as render_footage

    loaded, views = load_scene(scene), [mask_view(number, text) for number, text in enumerate(mask or [], start=1)]
    require_ray_caster()
    prepare(output)
    with Console(output / "savmap.log") as console:
        footage = render_footage(loaded, output, console, masks=views)
    for path in footage.files:
        say(f"wrote {path}")


def train(
    plugin: Annotated[str, typer.Argument(metavar="PLUGIN", help="The plugin whose network is to be trained.")],
    data: Annotated[list[Path], typer.Option(help="Labelled pictures: a folder, or its file; may be repeated.")],
    output: Annotated[Path, output_option("The ONNX file to write.")] = Path("model.onnx"),
    minutes: Annotated[
        float | None, typer.Option(min=0, help="How long to train (60; fine-tuning: 20).", show_default=False)
    ] = None,
    steps: Annotated[int | None, typer.Option(min=1, help="How many steps, instead of how long.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of everything random.")] = 0,
    init: Annotated[
        Path | None, typer.Option(help="What to begin with: a checkpoint; or `shipped` or an ONNX file, to fine-tune.")
    ] = None,
    renamed: Annotated[
        list[str] | None,
        typer.Option("--class", metavar="THEIRS=OURS", help="What a class of the data is called here."),
    ] = None,
    held_out: Annotated[list[Path] | None, typer.Option(help="Fine-tuning: a data set only to measure on.")] = None,
    int8: Annotated[bool, typer.Option("--int8", help="Fine-tuning: also write it in 8-bit integers.")] = False,
    whole: Annotated[
        bool, typer.Option("--whole", help="With --init: train all layers at full rates, for thousands of pictures.")
    ] = False,
) -> None:
    """Train or fine-tune a plugin's network (needs the `train` extra). The same command goes on with a run that was
    stopped."""
    from savmap.lab.train import train as train_network
    from savmap.lab.train.plan import TrainOptions, plan_of

    options = TrainOptions(data, output, minutes, seed, init, renamed or (), held_out or (), int8, steps, whole)
    plan = plan_of(plugin, options)
    check(plan)
    prepare(output.parent)
    with Console(output.with_suffix(".log")) as console, console.meter(f"training {plugin}") as progress:
        network = train_network(plan, progress)
    for line in network_lines(network):
        say(line)
    if network.warning is not None:
        typer.secho(visible(network.warning), fg=typer.colors.RED, bold=True, err=True)


def label(
    source: Annotated[Path, typer.Argument(metavar="SOURCE", parser=where, help="A site file, or a panoramic video.")],
    plugin: Annotated[
        str | None, typer.Option(help="Whose views and classes; default: the site's first plugin.")
    ] = None,
    count: Annotated[int, typer.Option(min=1, help="How many pictures.")] = 100,
    output: Output = Path("labels"),
    sets: Sets = None,
) -> None:
    """Choose the views most worth labelling, and write them with the network's own masks to start from."""
    from savmap.lab.label.formats import COCO, IMAGES
    from savmap.lab.label.run import label as choose_and_write

    with Console(Path(os.devnull)) as console:
        labelled = choose_and_write(source, plugin, count, output, overrides_of(sets or [], os.environ), console)
    say(f"wrote {labelled.pictures} pictures with {labelled.outlines} outlines into {labelled.folder}")
    say(
        f"wrote the same as {labelled.folder / COCO} (CVAT, Label Studio) and {labelled.folder / IMAGES} (LabelMe): "
        "correct one of them, and train on that one"
    )


def adapt(
    source: Annotated[Path, typer.Argument(metavar="SITE", parser=where, help="A site file, or a panoramic video.")],
    output: Output = Path("out"),
    plugin: Annotated[str | None, typer.Option(help="Whose network to teach; default: the site's only plugin.")] = None,
    row: Annotated[list[str] | None, typer.Option(help="Learn from this row alone; may be repeated.")] = None,
    rounds: Annotated[int, typer.Option(min=1, help="Learn and map again at most so many times.")] = 2,
    minutes: Annotated[
        float | None, typer.Option(min=0, help="How long to train in each round (20).", show_default=False)
    ] = None,
    steps: Annotated[int | None, typer.Option(min=1, help="How many steps in each round, instead of how long.")] = None,
    replay: Annotated[
        list[Path] | None,
        typer.Option(help="Labelled pictures of other places, against forgetting; may be repeated."),
    ] = None,
    jobs: Annotated[
        int | None, typer.Option(min=0, help="Rows mapped at a time, as for `savmap map`.", show_default=False)
    ] = None,
    sets: Sets = None,
) -> None:
    """Let a site teach a plugin's network: its map labels its own footage (needs the `train` extra). A second call goes
    on."""
    from savmap.lab.adapt.run import adapt as teach

    check_extra()
    options = AdaptOptions(plugin, row or (), rounds, minutes, steps, replay or (), jobs=jobs)
    overrides = overrides_of(sets or [], os.environ)
    prepare(output)
    with Console(output / "adapt.log") as console:
        adapted = teach(source, output, options, overrides, console, console.meter)
    for line in adapted_lines(adapted):
        say(line)


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
            ious = [score["iou"].get(label) for label in classes]
            mean = sum(filter(None, ious)) / max(sum(iou is not None for iou in ious), 1)
            cells = "".join(f"{'-':>12s}" if iou is None else f"{iou:12.3f}" for iou in (*ious, mean))
            title = f"{name} ({score['pictures']})"
            yield f"{title:24s} {when:8s}{cells}{score['calibration error']:20.4f}"
    yield _calibrated(recipe)
    if len(recipe["scores"]) == 1:
        yield (
            f"the network and its temperature were chosen by the {VALIDATION} pictures; "
            "--held-out SET measures on others"
        )
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


def _elsewhere(result: RoundResult) -> str:
    """What a round made of other places: whether the network forgets."""
    if not result.others_before:
        return "other places: not measured; "
    return f"on other places {mean(result.others_before):.3f} before, {mean(result.others_after):.3f} after; "


def adapted_lines(adapted: Adapted) -> Iterator[str]:
    """What was learned from what, before and after, and how the network is used."""
    for result in adapted.rounds:
        yield (
            f"round {result.number}: learned from {result.views} views; on {result.held_out} held out IoU with the map "
            f"{mean(result.iou_before):.3f} before, {mean(result.iou_after):.3f} after; {_elsewhere(result)}"
            f"{'kept' if result.kept else 'not kept'}: {result.why}"
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
