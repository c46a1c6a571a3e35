"""Likelihoods of a face's cells: what the network's mean scores say of them, and what paint says."""

import json
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from savmap.types import Bools, Floats
from savmap.vision.evidence.intervals import Occlusion

FITTED = Path(__file__).parent / "model" / "face_model.json"


@dataclass(frozen=True)
class FaceParameters:
    """The model's parameters, with their provenance in the file that they are read from. Lengths are shares of the
    camera's distance.

    scores: mean scores of a cell, rising; upright, beam: log-likelihood ratios of that class at these scores.
    hidden, chances: shares of a member that goods may hide, and their probabilities. along, across: over what lengths
    pictures say the same. post, level: log rates of a member at a place. shared: log ratio of a level that all other
    sections have to one that none has. profile: spread of the members' thickness about the usual one. gap: least gap
    between two beams.
    paint, paint_limit: weight of what paint says, and its greatest log ratio.
    """

    scores: tuple[float, ...]
    upright: tuple[float, ...]
    beam: tuple[float, ...]
    hidden: tuple[float, ...]
    chances: tuple[float, ...]
    along: float
    across: float
    post: float
    level: float
    shared: float
    profile: float
    gap: float
    paint: float
    paint_limit: float

    def ratios(self, label: str, mean: NDArray[np.float32], seen: Bools) -> Floats:
        """Log-likelihood ratios of cells by their mean score; 0 where nothing was seen."""
        table = self.upright if label == "upright" else self.beam
        return np.where(seen, np.interp(mean, self.scores, table), 0.0)

    def occlusion(self, cell: float) -> Occlusion:
        """For cells of this side, as a share of the camera's distance."""
        return Occlusion(self.hidden, self.chances, max(1.0, self.along / cell), max(1.0, self.across / cell))


def fitted() -> FaceParameters:
    """The parameters that are shipped."""
    return stored("parameters")


@lru_cache
def stored(name: str) -> FaceParameters:
    """The "parameters" of the file, or the "first guess" that they were fitted from."""
    content: dict[str, Any] = json.loads(FITTED.read_text(encoding="utf-8"))[name]
    given: dict[str, Any] = {key: tuple(value) if isinstance(value, list) else value for key, value in content.items()}
    return FaceParameters(**given)
