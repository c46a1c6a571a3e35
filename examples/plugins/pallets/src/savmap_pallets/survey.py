"""The pallets of a survey file's row: their middles on the floor, m, and turns in degrees, counter-clockwise as seen from above."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict

from savmap.files.validation import checked
from savmap.types import Floats
from savmap_pallets.outline import corners


class SurveyedPallet(BaseModel):
    """One pallet: x and z of its middle, its long side's turn from the row's x axis, and its length, width and height."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    x: float
    z: float
    turn_deg: float
    size: tuple[float, float, float] = (1.2, 0.8, 0.144)

    def corners(self) -> Floats:
        """Its corners (8, 3) m."""
        long, wide, high = self.size
        return corners(np.array([self.x, -self.z, np.radians(self.turn_deg)]), np.array([long, high, wide]))


class SurveyedRow(BaseModel):
    """The pallets of a row. Other plugins' keys are left alone."""

    model_config = ConfigDict(extra="ignore", frozen=True)

    pallets: list[SurveyedPallet]


def read_row(entry: Mapping[str, Any]) -> SurveyedRow:
    """The pallets of a row's entry. Raises OutputError."""
    return checked(SurveyedRow, entry, "survey")
