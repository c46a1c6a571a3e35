"""Mapped signs against a survey: the mean distance of their corners, and what was read."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from savmap.geometry.matching import matched
from savmap.types import Distances, Floats, Score, Structure
from savmap_signs.survey import SurveyedSign, read_row

GATE_M = 0.3


def evaluate(structures: Sequence[Structure], survey: Mapping[str, Any]) -> Score:
    """Signs matched one to one by their corners within `GATE_M`. Under "signs": how far each one's worst corner is off. Of the
    texts, those that the survey has and the map has not are missing, those in the map that are not on the sign spurious.

    Empty where the survey has no signs. Raises OutputError where they are malformed.
    """
    if "signs" not in survey:
        return Score()
    surveyed = read_row(survey)
    signs = [own for own in structures if own.label == "sign"]
    partner = match(surveyed.corners(), np.array([own.vertices for own in signs]).reshape(-1, 4, 3))
    worst = {
        j: float(np.linalg.norm(surveyed.corners()[i] - signs[j].vertices, axis=1).max()) for i, j in partner.items()
    }
    unread = sum(
        bool(sign.text) and (i not in partner or not said(sign, signs[partner[i]]))
        for i, sign in enumerate(surveyed.signs)
    )
    true = {j: surveyed.signs[i] for i, j in partner.items()}
    invented = sum(
        bool(own.attributes.get("text")) and not (j in true and said(true[j], own)) for j, own in enumerate(signs)
    )
    spurious = {signs[j].id: float("inf") for j in range(len(signs)) if j not in worst}
    return Score(
        missing={"sign text": unread},
        spurious={"sign text": invented},
        apart={"signs": Distances(np.array(list(worst.values())), len(surveyed.signs) - len(worst), len(spurious))},
        deviations={signs[j].id: distance for j, distance in worst.items()} | spurious,
    )


def said(sign: SurveyedSign, own: Structure) -> bool:
    """Whether a mapped sign has exactly the surveyed one's text, line breaks being spaces."""
    return " ".join(sign.text.split()) == own.attributes.get("text", "")


def match(truth: Floats, estimate: Floats) -> dict[int, int]:
    """Estimate (m, 4, 3) of each truth (n, 4, 3) whose corners are nearer than `GATE_M` on average: one to one."""
    return matched(np.linalg.norm(truth[:, None] - estimate[None], axis=-1).mean(axis=-1), GATE_M)
