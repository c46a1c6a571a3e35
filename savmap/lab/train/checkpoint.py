"""Checkpoints: averaged weights with the classes they are for and how they came about; and a run's whole state.

With that state a run which was killed goes on with the same command.
"""

import hashlib
import io
import json
import pickle
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from savmap.errors import OutputError
from savmap.files.atomic import sha256, write_bytes
from savmap.lab.train.data.dataset import Sample
from savmap.lab.train.network import SegmentationNetwork, build
from savmap.lab.train.trainer import Hyperparameters, Trainer

SUFFIX = ".resume.pt"

LAST_LAYER = "finish.logits."
"""Prefix of the weights that depend on the classes."""

BROKEN = (OSError, RuntimeError, LookupError, TypeError, ValueError, EOFError, pickle.UnpicklingError)
"""What reading a file that torch did not write, or not this way, raises."""

Recipe = Mapping[str, object]
"""How one run of training went, as JSON holds it."""


def save_checkpoint(
    path: Path, network: SegmentationNetwork, classes: Sequence[str], history: Sequence[Recipe]
) -> None:
    """Averaged weights, class names and the recipes so far; written whole or not at all. Raises OutputError."""
    content = io.BytesIO()
    torch.save(
        {"network": network.state_dict(), "classes": list(classes), "history": json.dumps(list(history))}, content
    )
    write_bytes(path, content.getvalue())


def load_checkpoint(path: Path, classes: Sequence[str], same: bool = False) -> tuple[SegmentationNetwork, list[Recipe]]:
    """Network and history of a checkpoint. If it was made for other classes, the last layer is new.

    Raises OutputError for a file that is not a checkpoint, or, where the classes must be the `same`, one for others.
    """
    network = build(len(classes), None)
    try:
        content = torch.load(path, map_location="cpu", weights_only=True)
        weights = dict(content["network"])
        if content["classes"] != list(classes):
            if same:
                raise OutputError(f"{path}: is for {', '.join(content['classes'])}, not for {', '.join(classes)}")
            weights |= {name: value for name, value in network.state_dict().items() if name.startswith(LAST_LAYER)}
        network.load_state_dict(weights)
        return network, json.loads(content["history"])
    except BROKEN as error:
        raise OutputError(f"{path}: not a checkpoint of `savmap train`; start without it") from error


@dataclass
class TrainingState:
    """How far a run is: steps, seconds spent, the loss (a running mean), validation scores so far, and the best one's
    weights."""

    steps: int = 0
    spent_s: float = 0.0
    loss: float = 0.0
    scores: list[float] = field(default_factory=list)
    best: dict[str, Tensor] | None = None

    def record(self, score: float, weights: dict[str, Tensor]) -> None:
        """Note a validation score and keep the weights if it is the best so far."""
        if self.best is None or score > max(self.scores):
            self.best = {name: value.clone() for name, value in weights.items()}
        self.scores.append(score)


def run_key(
    classes: Sequence[str],
    samples: Sequence[Sample],
    seed: int,
    init: Path | None,
    settings: Hyperparameters,
    replayed: Collection[str] = (),
) -> str:
    """A digest of all inputs of a run, pictures and labels included, and the origins that are replayed: if one changes,
    the same command begins a new run."""
    parts = [
        list(classes),
        [[sample.image_digest, sample.labels.digest, sample.group, sample.origin] for sample in samples],
        seed,
        sha256(init) if init is not None else None,
        asdict(settings),
        sorted(replayed),
    ]
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()


@dataclass(frozen=True)
class ResumeFile:
    """The file with a run's state, and the key of that run."""

    path: Path
    key: str

    def save(self, trainer: Trainer, state: TrainingState) -> None:
        """Keep the state, whole or not at all. Raises OutputError."""
        content = io.BytesIO()
        torch.save({"key": self.key, "trainer": trainer.state(), "state": vars(state)}, content)
        write_bytes(self.path, content.getvalue())

    def load(self, trainer: Trainer) -> TrainingState | None:
        """Restore the trainer to the saved state. Returns None and changes nothing if there is none of this run."""
        try:
            content: dict[str, Any] = torch.load(self.path, map_location="cpu", weights_only=True)
            if content["key"] != self.key:
                return None
            state = TrainingState(**content["state"])
            trainer.restore(content["trainer"])
        except BROKEN:
            return None
        return state

    def done(self) -> None:
        """Delete the state of a finished run, so that the same command begins a new one."""
        self.path.unlink(missing_ok=True)
