"""The shelves of a survey file's row: uprights and, section by section, beams (metres, row's frame)."""

from collections.abc import Mapping
from itertools import pairwise
from typing import Annotated, Any, Self

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

from savmap.files.validation import checked
from savmap.types import Floats


def _forwards(interval: tuple[float, float]) -> tuple[float, float]:
    if not interval[0] < interval[1]:
        raise ValueError(f"{list(interval)} should be [smaller, larger]")
    return interval


def _in_order(intervals: list[tuple[float, float]]) -> list[tuple[float, float]]:
    for before, after in pairwise(intervals):
        if after[0] < before[1]:
            raise ValueError(f"{list(after)} should lie beyond {list(before)}: elements in order, not overlapping")
    return intervals


Interval = Annotated[tuple[float, float], AfterValidator(_forwards)]
Intervals = Annotated[list[Interval], AfterValidator(_in_order)]


class SurveyedSection(BaseModel):
    """Beams [y_bottom, y_top] of one section, from the bottom up."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    beams: Intervals


class SurveyedRow(BaseModel):
    """Uprights [x_left, x_right] from left to right and the sections between them. Other keys are left alone."""

    model_config = ConfigDict(extra="ignore", frozen=True)

    uprights: Intervals = Field(min_length=2)
    sections: list[SurveyedSection]

    @model_validator(mode="after")
    def _section_between_uprights(self) -> Self:
        count = len(self.uprights)
        if len(self.sections) != count - 1:
            raise ValueError(f"{count} uprights bound {count - 1} sections, not {len(self.sections)}")
        return self

    def upright_intervals(self) -> Floats:
        """x of left and right edges (n, 2)."""
        return np.array(self.uprights, dtype=np.float64)

    def section_intervals(self) -> Floats:
        """x of the sections' free width (n - 1, 2)."""
        uprights = self.upright_intervals()
        return np.column_stack([uprights[:-1, 1], uprights[1:, 0]])

    def beam_intervals(self, section: int) -> Floats:
        """y of bottom and top edges (m, 2) of a section counted from 0."""
        return np.array(self.sections[section].beams, dtype=np.float64).reshape(-1, 2)


def read_row(entry: Mapping[str, Any]) -> SurveyedRow:
    """The shelves of a row's entry. Raises OutputError."""
    return checked(SurveyedRow, entry, "survey")
