"""Drawings: what a plugin's `draw` hook returns. They say what is drawn where, not how it is painted."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from savmap.types.common import Floats, array_record

Kind = Literal["polygon", "line", "point"]
Role = Literal["survey", "mapped", "warned", "off"]
Tone = Literal["structure", "fixture"]
Picture = Literal["face", "plan"]


@dataclass(frozen=True, eq=False)
@array_record
class Drawing:
    """A shape of points (n, 3) m in the row's frame, closed where `kind` is "polygon".

    role: surveyed (painted underneath), mapped, mapped and named by a warning, or mapped and further off the survey
    than is shown as right. tone: part of the structure that bounds the picture, or a fixture around it. legend:
    what such shapes are called in the legend. caption: a short text beside it. name: the id of the structure that
    it shows, by which the report finds its standard deviations. Raises ValueError where the points have another
    shape or are not finite."""

    kind: Kind
    points: Floats
    role: Role
    tone: Tone
    legend: str
    pictures: tuple[Picture, ...] = ("face", "plan")
    caption: str = ""
    name: str = ""

    def __post_init__(self) -> None:
        if self.points.ndim != 2 or self.points.shape[1] != 3 or not len(self.points):
            raise ValueError(f"Drawing: points of {self.legend} must be (n, 3), not {self.points.shape}")
        if not np.isfinite(self.points).all():
            raise ValueError(f"Drawing: a point of `{self.name or self.legend}` is not finite")
