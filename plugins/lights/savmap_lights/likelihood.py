"""Likelihoods of a ceiling's cells, and the lamp model's parameters."""

import json
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from savmap.plugin import Floats
from savmap.vision.evidence.intervals import Occlusion

FITTED = Path(__file__).parent / "model" / "lamp_model.json"


@dataclass(frozen=True)
class LampParameters:
    """The model's parameters, with their provenance in the file that they are read from. Lengths are shares of the
    lamps' height above the camera.

    scores: mean scores of a cell, rising; light: log-likelihood ratios of a lamp at these scores. hidden, chances:
    shares of a lamp that something hides, and their probabilities. same: over what length pictures say the same. lamp:
    log rate of a lamp at a place along its line. profile: spread of the lamps' lengths about the usual one; unusual:
    the share of lamps that have another. gap: least gap between two lamps, but for those of a line of light. shines:
    how bright, as a share of the brightest that shows above, what is as likely a lamp as not is, and the spread of the
    logistic function.
    """

    scores: tuple[float, ...]
    light: tuple[float, ...]
    hidden: tuple[float, ...]
    chances: tuple[float, ...]
    same: float
    lamp: float
    profile: float
    unusual: float
    gap: float
    shines: tuple[float, float]

    def ratios(self, mean: Floats) -> Floats:
        """Log-likelihood ratios of cells by their mean score."""
        return np.asarray(np.interp(mean, self.scores, self.light))

    def occlusion(self, cell: float) -> Occlusion:
        """Of a lamp, for cells of this side, as a share of the height."""
        same = max(1.0, self.same / cell)
        return Occlusion(self.hidden, self.chances, same, same)


@lru_cache(1)
def fitted() -> LampParameters:
    """The parameters that are shipped."""
    content: dict[str, Any] = json.loads(FITTED.read_text(encoding="utf-8"))["parameters"]
    given: dict[str, Any] = {
        name: tuple(value) if isinstance(value, list) else value for name, value in content.items()
    }
    return LampParameters(**given)
