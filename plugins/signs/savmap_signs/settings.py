"""Settings of the plugin in a site file."""

import re
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, field_validator

from savmap.files.validation import ClassNames
from savmap.plugin.inspection import InspectionLimits

Size = tuple[Annotated[float, Field(gt=0)], Annotated[float, Field(gt=0)]]


class Settings(BaseModel):
    """Settings of the plugin in a site file."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True, allow_inf_nan=False)
    model: Path | None = None
    """An ONNX file of another network."""
    class_names: ClassNames = {}
    """What the network's classes (their names, or numbers from 0) are called here, where its own names differ."""
    threshold: Annotated[float, Field(gt=0, lt=1)] = 0.5
    """Confidence above which a pixel belongs to a class."""
    along: bool = True
    """Whether views along the aisle, both ways, are searched too, for signs that hang across it."""
    every: Annotated[int, Field(gt=0)] = 1
    """Signs are searched for in every n-th key frame."""
    read: bool = True
    """Whether texts and codes are read. Needs the extra `signs`."""
    read_every: Annotated[int, Field(gt=0)] = 1
    """Texts and codes are read in every n-th of the frames in which signs are searched for."""
    pattern: str | None = None
    r"""A regular expression that every text must match as a whole, such as `[A-Z]\d{2}-\d{2}`. Other texts are
    ignored."""
    least_confidence: Annotated[float, Field(ge=0, le=1)] = 0.6
    """A text of less confidence, voted from all readings of a sign, is left out."""
    shape: Literal["rectangle", "flat"] = "rectangle"
    """The shape that the four corners are constrained to."""
    shape_sigma_m: Annotated[float, Field(gt=0)] = 0.003
    """Standard deviation of that shape, metres."""
    sizes_m: tuple[Size, ...] = ()
    """Known sizes, width and height in metres. A sign within 15 % of one of them gets that size."""
    size_sigma_m: Annotated[float, Field(gt=0)] = 0.002
    """Standard deviation of the known sizes, metres."""
    parallel: tuple[Literal["face", "across", "floor"], ...] = ()
    """A sign within 15 degrees of one of these planes is parallel to it: the face, the plane across the aisle, the
    floor."""

    @field_validator("pattern")
    @classmethod
    def _pattern_compiles(cls, pattern: str | None) -> str | None:
        try:
            re.compile(pattern or "")
        except re.error as error:
            raise ValueError(f"is not a regular expression: {error}") from error
        return pattern


LABEL_GROUPS = ("bay", "level", "position")
"""Of a pattern of location labels."""


class SignsLimits(InspectionLimits):
    """What an inspection expects of signs."""

    pattern: str | None = None
    r"""A regular expression for whole texts of location labels, with a group `bay`, and, where labels have them,
    `level` and `position`, such as `A21-(?P<bay>\d{2})-(?P<level>\d)(?P<position>[A-Z])`. Default: labels are not
    checked."""

    @field_validator("pattern")
    @classmethod
    def _pattern_has_groups(cls, pattern: str | None) -> str | None:
        try:
            groups = re.compile(pattern or "(?P<bay>)").groupindex
        except re.error as error:
            raise ValueError(f"is not a regular expression: {error}") from error
        if "bay" not in groups or not set(groups) <= set(LABEL_GROUPS):
            raise ValueError(f"should have a group `bay`, and no other than {', '.join(LABEL_GROUPS)}: (?P<bay>...)")
        return pattern
