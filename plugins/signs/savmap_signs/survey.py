"""The signs of a survey file's row: their corners (metres, row's frame) and what stands on them."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from savmap.files.validation import checked
from savmap.types import Floats

Point = tuple[float, float, float]


class SurveyedSign(BaseModel):
    """Corners from the upper left one clockwise as one reads it; text and code, "" where there is none."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    corners: tuple[Point, Point, Point, Point]
    text: str = ""
    code: str = ""
    bay: int | None = None


class SurveyedRow(BaseModel):
    """Signs. Other plugins' keys are left alone."""

    model_config = ConfigDict(extra="ignore", frozen=True)

    signs: list[SurveyedSign] = Field(default_factory=list)

    def corners(self) -> Floats:
        """The signs' corners (n, 4, 3)."""
        return np.array([sign.corners for sign in self.signs], dtype=np.float64).reshape(-1, 4, 3)


def read_row(entry: Mapping[str, Any]) -> SurveyedRow:
    """The signs of a row's entry. Raises OutputError."""
    return checked(SurveyedRow, entry, "survey")
