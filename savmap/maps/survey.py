"""Survey files: a surveyor's measurements of each row, in the row's frame (metres).

A row's entry belongs to the plugins: each reads its own keys in its hooks.
"""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, field_validator

from savmap.files.atomic import read_json, write_text
from savmap.files.urls import where
from savmap.files.validation import checked
from savmap.maps.schema import require_format
from savmap.types import Survey
from savmap.types.written import FARTHEST_M

FORMAT = "savmap-survey"
VERSION = 1


class SurveyFile(BaseModel):
    """A survey file: rows by name, each a mapping of plugins' keys."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    format: Literal["savmap-survey"]
    version: Literal[1]
    units: Literal["m"]
    rows: dict[str, dict[str, Any]] = Field(min_length=1)

    @field_validator("rows")
    @classmethod
    def _bounded(cls, rows: dict[str, dict[str, Any]]) -> dict[str, dict[str, Any]]:
        for number in _numbers(rows):
            if abs(number) > FARTHEST_M:
                raise ValueError(f"{number:g} is too large: lengths are metres, and below {FARTHEST_M:g}")
        return rows


def _numbers(rows: dict[str, dict[str, Any]]) -> Iterator[float]:
    """All numbers of the rows' entries, however deep."""
    left: list[object] = [rows]
    while left:
        value = left.pop()
        if isinstance(value, dict):
            left += value.values()
        elif isinstance(value, list):
            left += value
        elif isinstance(value, int | float):
            yield value


def read_survey(path: Path) -> Survey:
    """A survey file. Raises OutputError with one line: file, place, problem."""
    content = read_json(path)
    require_format(content, str(path), "survey", FORMAT, VERSION)
    return Survey(checked(SurveyFile, content, str(path)).rows)


def write_survey(survey: Survey, path: str | Path) -> None:
    """Write a survey file. Raises OutputError."""
    content = {"format": FORMAT, "version": VERSION, "units": "m", "rows": survey.rows}
    write_text(where(path), json.dumps(content, indent=1, allow_nan=False) + "\n")
