"""Mapped pillars beside a survey, in pictures, and as what another row sees too."""

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict

from savmap.files.validation import checked
from savmap.geometry.matching import matched
from savmap.types import CrossRowLandmark, Distances, Drawing, Floats, Score, Structure

GATE_M = 0.5
OFF_M = 0.05
Point = tuple[float, float, float]


class Surveyed(BaseModel):
    """The pillars of a row in a survey file: foot and top of each front, m in the row's frame. Other plugins' keys are left alone."""

    model_config = ConfigDict(extra="ignore", frozen=True)
    pillars: list[tuple[Point, Point]] = []

    @property
    def points(self) -> Floats:
        """(n, 2, 3)."""
        return np.array(self.pillars, dtype=np.float64).reshape(-1, 2, 3)


def shared(structures: Sequence[Structure]) -> list[CrossRowLandmark]:
    """Every pillar's foot: the row across the aisle sees it at the same place."""
    return [CrossRowLandmark(own.id, own.label, own.vertices[0], own.covariances[0]) for own in structures]


def evaluate(structures: Sequence[Structure], survey: Mapping[str, Any]) -> Score:
    """How far feet and tops are from the survey's, m; pillars further away than `GATE_M` have no partner, and as many as can have one.

    Empty where the survey has none. Raises OutputError where it is malformed.
    """
    if "pillars" not in survey:
        return Score()
    truth = checked(Surveyed, survey, "survey").points
    mapped = np.array([own.vertices for own in structures]).reshape(-1, 2, 3)
    apart = np.linalg.norm(truth[:, None] - mapped[None], axis=-1)
    pairs = matched(apart.max(axis=-1), GATE_M).items()
    distances = np.array([apart[i, j] for i, j in pairs]).ravel()
    deviations = {own.id: float("inf") for own in structures}
    deviations |= {structures[j].id: float(apart[i, j].max()) for i, j in pairs}
    scores = Distances(distances, len(truth) - len(pairs), len(mapped) - len(pairs))
    return Score(apart={"pillars": scores}, deviations=deviations)


def draw(
    structures: Sequence[Structure], survey: Mapping[str, Any] | None, deviations: Mapping[str, float]
) -> tuple[Drawing, ...]:
    """A line from foot to top; the survey's underneath, and those marked that are off it by more than `OFF_M`."""
    truth = checked(Surveyed, survey or {}, "survey").points
    return (
        *(Drawing("line", points, "survey", "fixture", "pillars") for points in truth),
        *(
            Drawing("line", own.vertices, _role(own, deviations), "fixture", "pillars", name=own.id)
            for own in structures
        ),
    )


def _role(own: Structure, deviations: Mapping[str, float]) -> Literal["mapped", "off"]:
    return "off" if deviations.get(own.id, 0.0) > OFF_M else "mapped"
