"""The lamps of a survey file's row: the two ends of each one's long axis (metres, row's frame)."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from savmap.files.validation import checked
from savmap.types import Floats

Point = tuple[float, float, float]


class SurveyedLamp(BaseModel):
    """The two ends of a lamp's long axis; they coincide for a compact lamp."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    ends: tuple[Point, Point]


class SurveyedRow(BaseModel):
    """Lamps, and the uprights' x, of which the outermost are the row's ends. Other plugins' keys are left alone."""

    model_config = ConfigDict(extra="ignore", frozen=True)

    lights: list[SurveyedLamp]
    uprights: list[tuple[float, float]] = Field(default_factory=list)

    def ends(self) -> Floats:
        """The lamps' ends (n, 2, 3)."""
        return np.array([lamp.ends for lamp in self.lights], dtype=np.float64).reshape(-1, 2, 3)

    def centres(self) -> Floats:
        """The lamps' centres (n, 3)."""
        centres: Floats = self.ends().mean(axis=1)
        return centres

    def ends_x(self) -> tuple[float, float]:
        """x of the row's ends; without uprights the row has no end."""
        if not self.uprights:
            return float("-inf"), float("inf")
        return min(min(x) for x in self.uprights), max(max(x) for x in self.uprights)


def read_row(entry: Mapping[str, Any]) -> SurveyedRow:
    """The lamps of a row's entry. Raises OutputError."""
    return checked(SurveyedRow, entry, "survey")
