"""What a plugin's `draw` hook gives: figures in the row's frame, without a word on how they are painted."""

from dataclasses import dataclass
from typing import Literal

from savmap.types import Floats

Kind = Literal["polygon", "line", "point"]
Role = Literal["survey", "mapped", "off"]
Tone = Literal["structure", "fixture"]
Picture = Literal["face", "plan"]


@dataclass(frozen=True)
class Drawing:
    """One figure: points (n, 3) m in the row's frame, closed where `kind` is "polygon".

    role: surveyed (painted underneath), mapped, or mapped and off by more than is shown as right. tone: part of the
    structure that bounds the picture, or a fixture around it. legend: what such figures are called in the legend.
    caption: a short text beside it. name: the id of the structure that it shows, by which a page finds its sigmas.
    """

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
