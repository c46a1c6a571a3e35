"""`savmap train`: what was asked for as a task, and the lines to print of what came out."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from savmap.errors import ModelError, SiteError
from savmap.job import prepare
from savmap.rooms import load_class

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
    from savmap.console import Console
    from savmap.train import check_extra
    from savmap.train import train as train_network
    from savmap.train.task import Task

    plugin_class = load_class(plugin)
    init = float_model(plugin_class.model) if wish.init == SHIPPED else wish.init
    fine_tunes = init is not None and init.suffix == ".onnx"
    minutes = wish.minutes or (FINE_TUNING_MINUTES if fine_tunes else MINUTES)
    task = Task(
        plugin_class.classes,
        wish.data,
        wish.output,
        minutes,
        wish.seed,
        init,
        mapping_of(wish.renamed),
        wish.held_out,
        wish.int8,
        wish.steps,
    )
    check_extra()
    prepare(wish.output.parent)
    with Console(wish.output.with_suffix(".log")) as console, console.meter(f"training {plugin}") as progress:
        recipe = train_network(task, progress)
    yield f"wrote {wish.output}"
    if not fine_tunes:
        yield json.dumps(recipe, indent=2)
        return
    from savmap.train.finetune import int8_beside, report_lines

    if wish.int8:
        yield f"wrote {int8_beside(wish.output)}"
    yield from report_lines(recipe, plugin_class.classes)
    yield f"{recipe['steps']} steps in {recipe['minutes']} minutes"


def float_model(model: Path) -> Path:
    """The float32 network beside the one that a plugin uses. Raises ModelError where there is none."""
    name = model.name.removesuffix(".int8.onnx").removesuffix(".onnx")
    path = model.with_name(f"{name}.onnx")
    if not path.is_file():
        raise ModelError(f"{path}: no float32 network to fine-tune; give one with --init FILE.onnx")
    return path


def mapping_of(renamed: Sequence[str]) -> dict[str, str]:
    """{THEIRS: OURS} of options THEIRS=OURS. Raises SiteError for one that is not like that."""
    pairs = [one.split("=") for one in renamed]
    for text, pair in zip(renamed, pairs, strict=True):
        if len(pair) != 2 or not all(part.strip() for part in pair):
            raise SiteError(f"--class {text}: give THEIRS=OURS, such as --class pole=column")
    return {theirs.strip(): ours.strip() for theirs, ours in pairs}
