"""A run's state on disk, so that one which was killed goes on with the same command."""

import hashlib
import io
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from savmap.files.atomic import sha256, write_bytes
from savmap.train.checkpoint import BROKEN
from savmap.train.dataset import Sample
from savmap.train.trainer import Settings, Trainer

SUFFIX = ".resume.pt"


@dataclass
class Course:
    """How far a run is: steps, seconds spent, the loss (a running mean), validation scores so far, and the best one's weights."""

    steps: int = 0
    spent_s: float = 0.0
    loss: float = 0.0
    scores: list[float] = field(default_factory=list)
    best: dict[str, Tensor] | None = None

    def offer(self, score: float, weights: dict[str, Tensor]) -> None:
        """Note a validation score and keep the weights if it is the best so far."""
        if self.best is None or score > max(self.scores):
            self.best = {name: value.clone() for name, value in weights.items()}
        self.scores.append(score)


def run_print(
    classes: Sequence[str], samples: Sequence[Sample], seed: int, init: Path | None, settings: Settings
) -> str:
    """A digest of what a run is made of, pictures and labels included: what changes it makes a new run of the same command."""
    parts = [
        list(classes),
        [[sample.image_digest, sample.labels.digest, sample.group, sample.origin] for sample in samples],
        seed,
        sha256(init) if init is not None else None,
        asdict(settings),
    ]
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()


@dataclass(frozen=True)
class Resumption:
    """Where a run's state is kept, and what run that is."""

    path: Path
    print_: str

    def save(self, trainer: Trainer, course: Course) -> None:
        """Keep the state, whole or not at all. Raises OutputError."""
        content = io.BytesIO()
        torch.save({"print": self.print_, "trainer": trainer.state(), "course": vars(course)}, content)
        write_bytes(self.path, content.getvalue())

    def load(self, trainer: Trainer) -> Course | None:
        """Bring the trainer to the state that was kept; None, and nothing done, where there is none of this run."""
        try:
            content: dict[str, Any] = torch.load(self.path, map_location="cpu", weights_only=True)
            if content["print"] != self.print_:
                return None
            course = Course(**content["course"])
            trainer.restore(content["trainer"])
        except BROKEN:
            return None
        return course

    def done(self) -> None:
        """The run is finished: the same command begins a new one."""
        self.path.unlink(missing_ok=True)
