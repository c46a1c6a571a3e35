"""What `savmap train` is asked to do: the command's options, and the run that they mean for a plugin's network."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

from savmap.errors import ModelError, OutputError, SiteError
from savmap.lab.plugins import lab_plugin
from savmap.plugin.manager import load_class
from savmap.vision.networks.segmenter import Segmenter

Progress = Callable[[float, str], None]
"""Called with the share done (0..1) and a line to show."""

SHIPPED = Path("shipped")
MINUTES, FINE_TUNING_MINUTES = 60.0, 20.0
VALIDATION = "validation"
"""What the pictures that are kept from training are called among the sets that a network is measured on."""
LEAST_TO_CALIBRATE = 5
USELESS_IOU = 0.3
"""Mean intersection over union below which a network misses more than it sees: no map comes of it."""


@dataclass(frozen=True)
class TrainOptions:
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
    whole: bool = False


@dataclass(frozen=True)
class TrainingPlan:
    """A network for `classes`, to be trained on the data sets `data` for some `minutes` and written to `output` (ONNX).

    `init` is what to begin with: a checkpoint, or an ONNX file for fine-tuning; None for a network from nothing.
    `mapping` gives classes of the data sets the network's names. `held_out` are sets that fine-tuning only measures on;
    `int8`: whether it also writes the network in 8-bit integers. `steps`: how many to make, however long they take.
    `choose_by`: sets by which fine-tuning chooses the best network along the way, instead of the pictures that it sets
    aside. `replay`: further sets to fine-tune on, which are seen seldom, against forgetting; of their pictures every
    one, or every `replay_every`-th. `whole`: a network from an ONNX file is trained on in all its layers, as one from
    nothing, instead of with the care of fine-tuning. `one_site`: a network that is fine-tuned is for a site that is
    painted alike throughout: the colours of pictures are varied less.
    """

    classes: Sequence[str]
    data: Sequence[Path]
    output: Path
    minutes: float
    seed: int = 0
    init: Path | None = None
    mapping: Mapping[str, str] = field(default_factory=dict)
    held_out: Sequence[Path] = ()
    int8: bool = False
    steps: int | None = None
    whole: bool = False
    choose_by: Sequence[Path] = ()
    replay: Sequence[Path] = ()
    replay_every: int = 1
    one_site: bool = False

    def done(self, steps: int, spent_s: float) -> float:
        """The share 0..1 of the run that is done after so many steps and seconds."""
        return min(steps / self.steps if self.steps else spent_s / (60 * self.minutes), 1.0)

    @property
    def checkpoint(self) -> Path:
        """The averaged weights, to go on from."""
        return self.output.with_suffix(".checkpoint.pt")

    @property
    def integers(self) -> Path:
        """The network in 8-bit integers: model.onnx -> model.int8.onnx."""
        return self.output.with_suffix(".int8.onnx")

    @property
    def fine_tunes(self) -> bool:
        """Whether a network that was exported is trained further with care."""
        return self.from_file and not self.whole

    @property
    def from_file(self) -> bool:
        """Whether the run begins with a network that was exported: its normalisations are folded and must stay as they
        are."""
        return self.init is not None and self.init.suffix == ".onnx"


@dataclass(frozen=True)
class TrainedNetwork:
    """A plan that was carried out: the files that it wrote, the float32 network first, and the recipe in their
    metadata."""

    plan: TrainingPlan
    files: tuple[Path, ...]
    recipe: Mapping[str, Any]

    @property
    def warning(self) -> str | None:
        """What is wrong with the network and what to do; None where nothing is."""
        warning: str | None = self.recipe.get("warning")
        return warning


def warning_of(plan: TrainingPlan, iou: float, steps: int) -> dict[str, str]:
    """The recipe's entry `warning` for a network that does too poorly on the validation pictures to be used, or
    none."""
    if iou >= USELESS_IOU:
        return {}
    what = (
        f"WARNING: {plan.output.name} is useless so far: IoU {iou:.3f} on the validation pictures after {steps} steps "
        f"(usable from about {USELESS_IOU:g}, good from 0.8). Train longer (--minutes {MINUTES:g}, or go on with "
        f"--init {plan.checkpoint.name} and another -o), and look whether the labels and --class are right"
    )
    return {"warning": what}


def plan_of(plugin: str, options: TrainOptions) -> TrainingPlan:
    """The run that options mean for a plugin's network. Raises PluginError, ModelError or SiteError for what cannot be
    used."""
    plugin_class = load_class(plugin)
    init = float_model(plugin_class.model) if options.init == SHIPPED else options.init
    fine_tunes = init is not None and init.suffix == ".onnx" and not options.whole
    lab = lab_plugin(plugin)
    defaults = (lab.network_classes if lab is not None else ()) or plugin_class.classes
    classes = trained_classes(plugin_class.classes, defaults, init)
    return TrainingPlan(
        classes,
        options.data,
        options.output,
        minutes_of(options.minutes, fine_tunes),
        options.seed,
        init,
        mapping_of(options.renamed, classes),
        options.held_out,
        options.int8,
        options.steps,
        options.whole,
    )


def trained_classes(needed: Sequence[str], defaults: Sequence[str], init: Path | None) -> tuple[str, ...]:
    """The classes to train a plugin's network for: those of the file to begin with, where it has all that the plugin
    needs, else those that are known of the plugin's network."""
    if init is None or init.suffix != ".onnx":
        return tuple(defaults)
    try:
        theirs = Segmenter(init, providers=("cpu",)).names
    except ModelError:
        return tuple(defaults)
    return theirs if set(needed) <= set(theirs) else tuple(defaults)


def require_possible(plan: TrainingPlan) -> None:
    """Raise OutputError for a plan that cannot be begun, whatever its data."""
    if plan.output.suffix != ".onnx":
        raise OutputError(f"{plan.output}: the model's file name must end in .onnx")
    if plan.whole and not plan.from_file:
        raise OutputError(
            "--whole goes with --init shipped or --init FILE.onnx: without it the whole network is trained anyway"
        )
    if (plan.held_out or plan.int8) and not plan.fine_tunes:
        raise OutputError("--held-out and --int8 go with fine-tuning: say --init shipped, or --init FILE.onnx")
    written = {path.resolve() for path in (plan.output, plan.checkpoint, plan.integers)}
    if plan.init is not None and plan.init.resolve() in written:
        raise OutputError(f"--init {plan.init}: this run would write over it; choose another -o")


def float_model(model: Path) -> Path:
    """The float32 network beside the one that a plugin uses. Raises ModelError where there is none, as in an installed
    wheel."""
    name = model.name.removesuffix(".int8.onnx").removesuffix(".onnx")
    path = model.with_name(f"{name}.onnx")
    if not path.is_file():
        raise ModelError(
            f"{path}: no float32 network to train on is there. Wheels of savmap leave theirs out: take it from the "
            f"source distribution (pip download --no-deps --no-binary savmap savmap=={version('savmap')}) or the "
            "repository, and put it there, or name it with --init FILE.onnx"
        )
    return path


def minutes_of(minutes: float | None, fine_tunes: bool) -> float:
    """How long to train. Raises SiteError for no time."""
    if minutes is None:
        return FINE_TUNING_MINUTES if fine_tunes else MINUTES
    if minutes <= 0:
        raise SiteError(f"--minutes {minutes:g}: give more than 0")
    return minutes


def mapping_of(renamed: Sequence[str], classes: Sequence[str]) -> dict[str, str]:
    """{THEIRS: OURS} of options THEIRS=OURS. Raises SiteError for one that is not like that, or whose OURS is none of
    the classes."""
    pairs = [text.split("=") for text in renamed]
    for text, pair in zip(renamed, pairs, strict=True):
        if len(pair) != 2 or not all(part.strip() for part in pair):
            raise SiteError(f"--class {text}: give THEIRS=OURS, such as --class pole=column")
        if pair[1].strip() not in classes:
            raise SiteError(f"--class {text}: the network has no class {pair[1].strip()} (it has {', '.join(classes)})")
    return {theirs.strip(): ours.strip() for theirs, ours in pairs}
