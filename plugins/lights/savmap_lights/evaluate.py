"""Mapped lamps against a survey: the distance between centres."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from savmap.geometry.matching import matched
from savmap.types import Distances, Floats, Score, Structure
from savmap_lights.survey import read_row

GATE_M = 1.0


def evaluate(structures: Sequence[Structure], survey: Mapping[str, Any]) -> Score:
    """Lamps whose centre lies between the row's ends, matched one to one within `GATE_M`.

    Empty where the survey has no lamps. Raises OutputError where they are malformed.
    """
    if "lights" not in survey:
        return Score()
    surveyed = read_row(survey)
    lamps = [own for own in structures if own.label == "light"]
    centres = np.array([own.vertices.mean(axis=0) for own in lamps]).reshape(-1, 3)
    truth, (left, right) = surveyed.centres(), surveyed.ends_x()
    partner = match(truth, centres)
    wanted = (truth[:, 0] >= left) & (truth[:, 0] <= right)
    inside = (centres[:, 0] >= left) & (centres[:, 0] <= right)
    distances = {j: float(np.linalg.norm(truth[i] - centres[j])) for i, j in partner.items() if wanted[i]}
    spurious = [j for j in range(len(lamps)) if inside[j] and j not in partner.values()]
    found = Distances(np.array(list(distances.values())), int(wanted.sum()) - len(distances), len(spurious))
    deviations = {lamps[j].id: distance for j, distance in distances.items()}
    return Score(apart={"lights": found}, deviations=deviations | {lamps[j].id: float("inf") for j in spurious})


def match(truth: Floats, estimate: Floats) -> dict[int, int]:
    """Estimate (m, 3) of each truth (n, 3) that has one nearer than `GATE_M`: one to one, as many as there can be, then
    the least sum of distances."""
    return matched(np.linalg.norm(truth[:, None] - estimate[None], axis=-1), GATE_M)
