"""Commands that make what maps are made from: footage, passes in it, labelled pictures, networks."""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from savmap.cli.commands.options import Output, Sets, output_option
from savmap.cli.speech import say
from savmap.errors import visible
from savmap.files.urls import where

if TYPE_CHECKING:
    from savmap.split import SplitResult


def split(
    recording: Annotated[Path, typer.Argument(metavar="RECORDING", help="A long panoramic video.")],
    output: Annotated[Path, output_option("The site file to write.")] = Path("site.yaml"),
    into: Annotated[Path | None, typer.Option(help="Add the rows to this site file instead.")] = None,
    sheet: Annotated[Path | None, typer.Option(help="Write a contact sheet of the passes (PNG).")] = None,
) -> None:
    """Find the passes through aisles in a long recording, and write them into a site file to be confirmed."""
    from savmap.cli.console import Console
    from savmap.split import split as find_and_write

    with Console(Path(os.devnull)) as console:
        result = find_and_write(recording, output, into, sheet, monitor=console)
    for line in _passes(result):
        say(line)
    say(f"wrote {into or output}: look through it before mapping")
    if sheet is not None:
        say(f"wrote {sheet}")
    say(
        f"{result.frames_decoded} frames decoded for {result.frame_pairs} pairs of pictures, "
        f"of {result.frames} in the recording"
    )


def _passes(result: "SplitResult") -> Iterator[str]:
    """A table of the passes that were found."""
    from savmap.split.contact_sheet import clock

    yield "pass     start       end   heading  sides        confidence"
    for number, row_pass in enumerate(result.passes, start=1):
        yield (
            f"{number:4d}  {clock(row_pass.start_s):>8}  {clock(row_pass.end_s):>8}  {row_pass.heading_deg:+6.0f}"
            f"    {' and '.join(row_pass.sides):<14} {row_pass.confidence:4.2f}"
        )


def simulate(
    scene: Annotated[Path, typer.Argument(metavar="SCENE", help="A scene file.")],
    output: Output = Path("simulated"),
    mask: Annotated[list[str] | None, typer.Option(help="YAW,PITCH,HFOV: also write class masks of this view.")] = None,
) -> None:
    """Make footage of a made-up place, with its truth."""
    from savmap.cli.console import Console
    from savmap.lab.sim.render.raycast import require_ray_caster
    from savmap.lab.sim.scene.files import load_scene
    from savmap.lab.sim.simulate import mask_view
    from savmap.lab.sim.simulate import simulate as render_footage
    from savmap.site.job import prepare

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
    from savmap.cli.commands.training import network_lines
    from savmap.cli.console import Console
    from savmap.lab.train import check
    from savmap.lab.train import train as train_network
    from savmap.lab.train.plan import TrainOptions, plan_of
    from savmap.site.job import prepare

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
    from savmap.cli.console import Console
    from savmap.lab.label.run import label as choose_and_write
    from savmap.site.overrides import overrides_of

    with Console(Path(os.devnull)) as console:
        labelled = choose_and_write(source, plugin, count, output, overrides_of(sets or [], os.environ), console)
    say(f"wrote {labelled.pictures} pictures with {labelled.outlines} outlines into {labelled.folder}")
    say(
        f"wrote the same as {labelled.coco} (CVAT, Label Studio), {labelled.yolo} (YOLO) and {labelled.images} (LabelMe): "
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
    from savmap.cli.commands.training import adapted_lines
    from savmap.cli.console import Console
    from savmap.lab.adapt.records import AdaptOptions
    from savmap.lab.adapt.run import adapt as teach
    from savmap.lab.train import check_extra
    from savmap.site.job import prepare
    from savmap.site.overrides import overrides_of

    check_extra()
    options = AdaptOptions(plugin, row or (), rounds, minutes, steps, replay or (), jobs=jobs)
    overrides = overrides_of(sets or [], os.environ)
    prepare(output)
    with Console(output / "adapt.log") as console:
        adapted = teach(source, output, options, overrides, console, console.meter)
    for line in adapted_lines(adapted):
        say(line)
