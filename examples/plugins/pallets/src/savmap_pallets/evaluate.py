"""Mapped pallets against a survey: how far their middles and turns are off."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from savmap.types import Distances, Score, Structure
from savmap_pallets.survey import SurveyedPallet, read_row

GATE_M = 0.5


@dataclass(frozen=True)
class Match:
    """A mapped pallet with the surveyed one it is: distance of their middles, m, and estimate - truth of the turn, degrees."""

    mapped: Structure
    surveyed: SurveyedPallet
    distance_m: float
    turn_deg: float


def evaluate(structures: Sequence[Structure], survey: Mapping[str, Any]) -> Score:
    """Pallets matched one to one. Empty where the survey has none. Raises OutputError where they are malformed."""
    if "pallets" not in survey:
        return Score()
    truth, pallets = read_row(survey).pallets, [one for one in structures if one.label == "pallet"]
    found = matches(pallets, truth)
    distances = {match.mapped.id: match.distance_m for match in found}
    spurious = {one.id: float("inf") for one in pallets if one.id not in distances}
    apart = Distances(np.array(list(distances.values())), len(truth) - len(found), len(spurious))
    return Score(distances={"pallets": apart}, deviations=distances | spurious)


def matches(pallets: Sequence[Structure], truth: Sequence[SurveyedPallet]) -> list[Match]:
    """One to one, as many as there can be within `GATE_M`, then the least sum of distances; along the row."""
    mapped = np.array([[one.attributes["x_m"], one.attributes["z_m"]] for one in pallets], float).reshape(-1, 2)
    surveyed = np.array([[one.x, one.z] for one in truth]).reshape(-1, 2)
    away = np.linalg.norm(mapped[:, None] - surveyed[None], axis=-1)
    rows, columns = linear_sum_assignment(np.where(away < GATE_M, away, GATE_M * (1 + len(truth))))
    return [
        Match(
            pallets[i],
            truth[j],
            float(away[i, j]),
            off_deg(float(pallets[i].attributes["turn_deg"]), truth[j].turn_deg),
        )
        for i, j in zip(rows.tolist(), columns.tolist(), strict=True)
        if away[i, j] < GATE_M
    ]


def off_deg(turn_deg: float, true_deg: float) -> float:
    """The difference of two turns, which mean the same half a turn on: -90..90."""
    return (turn_deg - true_deg + 90.0) % 180.0 - 90.0
