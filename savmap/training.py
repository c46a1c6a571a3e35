"""`savmap train`: what was asked for as a task, and the lines to print of what came out."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from savmap.errors import ModelError, SiteError
from savmap.plugin.manager import load_class
from savmap.site.job import prepare

SHIPPED = Path("shipped")
MINUTES, FINE_TUNING_MINUTES = 60.0, 20.0


@dataclass(frozen=True)
class Wish:
    """The command's options, as given."""

    data: Sequence[Path]
    output: Path
    minutes: float | None = None
    seed: int = 0
    init: Path | None = None
    renamed: Sequence[str] = ()
    held_out: Sequence[Path] = ()
    int8: bool = False
    steps: int | None = None


def train(plugin: str, wish: Wish) -> Iterator[str]:
    """A network for a plugin's classes; yields lines for the user. Raises SavmapError's kinds."""
    from savmap.cli.console import Console
    from savmap.train import check
    from savmap.train import train as train_network
    from savmap.train.task import Task

    plugin_class = load_class(plugin)
    init = float_model(plugin_class.model) if wish.init == SHIPPED else wish.init
    task = Task(
        plugin_class.classes,
        wish.data,
        wish.output,
        MINUTES,
        wish.seed,
        init,
        mapping_of(wish.renamed, plugin_class.classes),
        wish.held_out,
        wish.int8,
        wish.steps,
    )
    task = replace(task, minutes=minutes_of(wish.minutes, task.fine_tunes))
    check(task)
    prepare(wish.output.parent)
    with Console(wish.output.with_suffix(".log")) as console, console.meter(f"training {plugin}") as progress:
        recipe = train_network(task, progress)
    yield f"wrote {wish.output}"
    if not task.fine_tunes:
        yield json.dumps(recipe, indent=2)
        return
    from savmap.train.finetune import report_lines

    if wish.int8:
        yield f"wrote {task.integers}"
    yield from report_lines(recipe, plugin_class.classes)
    yield f"{recipe['steps']} steps in {recipe['minutes']} minutes"


def float_model(model: Path) -> Path:
    """The float32 network beside the one that a plugin uses. Raises ModelError where there is none."""
    name = model.name.removesuffix(".int8.onnx").removesuffix(".onnx")
    path = model.with_name(f"{name}.onnx")
    if not path.is_file():
        raise ModelError(f"{path}: no float32 network to fine-tune; give one with --init FILE.onnx")
    return path


def minutes_of(wished: float | None, fine_tunes: bool) -> float:
    """How long to train. Raises SiteError for no time."""
    if wished is None:
        return FINE_TUNING_MINUTES if fine_tunes else MINUTES
    if wished <= 0:
        raise SiteError(f"--minutes {wished:g}: give more than 0")
    return wished


def mapping_of(renamed: Sequence[str], classes: Sequence[str]) -> dict[str, str]:
    """{THEIRS: OURS} of options THEIRS=OURS. Raises SiteError for one that is not like that, or whose OURS is none of the classes."""
    pairs = [one.split("=") for one in renamed]
    for text, pair in zip(renamed, pairs, strict=True):
        if len(pair) != 2 or not all(part.strip() for part in pair):
            raise SiteError(f"--class {text}: give THEIRS=OURS, such as --class pole=column")
        if pair[1].strip() not in classes:
            raise SiteError(f"--class {text}: the network has no class {pair[1].strip()} (it has {', '.join(classes)})")
    return {theirs.strip(): ours.strip() for theirs, ours in pairs}
