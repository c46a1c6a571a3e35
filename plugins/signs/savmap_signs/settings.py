"""Settings of the plugin in a site file."""

import re
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, field_validator

from savmap.files.validation import ClassNames

Size = tuple[Annotated[float, Field(gt=0)], Annotated[float, Field(gt=0)]]


class Settings(BaseModel):
    """Settings of the plugin in a site file."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)
    model: Path | None = None
    """Another network's ONNX file."""
    class_names: ClassNames = {}
    """What the network's classes (their names, or numbers from 0) are called here, where its own names differ."""
    threshold: Annotated[float, Field(gt=0, lt=1)] = 0.5
    """Confidence above which a pixel belongs to a class."""
    along: bool = True
    """Whether to look along the aisle too, both ways, for signs that hang across it."""
    every: Annotated[int, Field(gt=0)] | None = None
    """Signs are looked for in each so many of the frames used. Default: two in a pass of 200 frames, four from 400 on."""
    read: bool = True
    """Whether texts and codes are read; needs the extra `signs`."""
    read_every: Annotated[int, Field(gt=0)] = 1
    """Texts are read in each so many of the frames in which signs are looked for."""
    pattern: str | None = None
    r"""A regular expression that every text must match as a whole, such as `[A-Z]\d{2}-\d{2}`; others are not believed."""
    least_confidence: Annotated[float, Field(ge=0, le=1)] = 0.6
    """A text in which all readings of a sign agree less than this is left out."""
    shape: Literal["rectangle", "flat"] = "rectangle"
    """What the four corners are held to."""
    shape_sigma_m: Annotated[float, Field(gt=0)] = 0.003
    """How well signs keep to that, metres."""
    sizes_m: tuple[Size, ...] = ()
    """Known sizes, width and height in metres: a sign that is within 15 % of one of them has that size."""
    size_sigma_m: Annotated[float, Field(gt=0)] = 0.002
    """How well the sizes are known, metres."""
    parallel: tuple[Literal["face", "across", "floor"], ...] = ()
    """Planes that signs within 15 degrees of them are parallel to: the face, the plane across the aisle, the floor."""

    @field_validator("pattern")
    @classmethod
    def _compiles(cls, pattern: str | None) -> str | None:
        try:
            re.compile(pattern or "")
        except re.error as error:
            raise ValueError(f"is not a regular expression: {error}") from error
        return pattern
