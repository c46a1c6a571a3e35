"""Mapped signs beside a survey: the signs of a survey file, scores, drawings, and a survey's entry out of what somebody
measured: four corners, or the eight of a plate."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from savmap.errors import OutputError
from savmap.files.validation import checked
from savmap.geometry.matching import matched
from savmap.types import Distances, Drawing, Floats, Score, Structure, SurveyEntry

GATE_M = 0.3  # mean distance of the corners of signs that are matched
OFF_M = 0.03  # deviation from which a drawing marks a sign
Point = tuple[float, float, float]


class SurveyedSign(BaseModel):
    """Corners (x, y, z) m in the row's frame, clockwise from the upper left as one reads it; text and code, "" if there
    is none."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    corners: tuple[Point, Point, Point, Point]
    text: str = ""
    code: str = ""
    bay: int | None = None


class SurveyedRow(BaseModel):
    """The signs of a row's entry in a survey file. Other plugins' keys are left alone."""

    model_config = ConfigDict(extra="ignore", frozen=True, allow_inf_nan=False)

    signs: list[SurveyedSign] = Field(default_factory=list)

    def corners(self) -> Floats:
        """The signs' corners (n, 4, 3) m."""
        return np.array([sign.corners for sign in self.signs], dtype=np.float64).reshape(-1, 4, 3)


def read_row(entry: Mapping[str, Any]) -> SurveyedRow:
    """The signs of a row's entry. Raises OutputError."""
    return checked(SurveyedRow, entry, "survey")


def evaluate(structures: Sequence[Structure], survey: Mapping[str, Any]) -> Score:
    """Scores of signs matched one to one within `GATE_M`. Under "signs": how far each sign's worst corner is off, m.

    A surveyed text that the map does not have is missing; a mapped text that is not on the sign is spurious. Empty if
    the survey has no signs. Raises OutputError if they are malformed.
    """
    if "signs" not in survey:
        return Score()
    surveyed = read_row(survey)
    corners = surveyed.corners()
    signs = _signs(structures)
    matches = match_signs(corners, signs)
    deviations = {
        signs[j].id: float(np.linalg.norm(corners[i] - signs[j].vertices, axis=1).max()) for i, j in matches.items()
    }
    spurious = {sign.id: float("inf") for sign in signs if sign.id not in deviations}
    read = {i: j for i, j in matches.items() if same_text(surveyed.signs[i], signs[j])}
    unread = [sign for i, sign in enumerate(surveyed.signs) if sign.text and i not in read]
    misread = [sign for j, sign in enumerate(signs) if sign.attributes.get("text") and j not in read.values()]
    distances = Distances(np.array(list(deviations.values())), len(corners) - len(matches), len(spurious))
    return Score(
        missing={"sign text": len(unread)},
        spurious={"sign text": len(misread)},
        distances={"signs": distances},
        deviations=deviations | spurious,
    )


def match_signs(corners: Floats, signs: Sequence[Structure]) -> dict[int, int]:
    """Surveyed signs (corners (n, 4, 3) m) to mapped ones by index, one to one, whose corners are within `GATE_M` on
    average."""
    vertices = np.array([sign.vertices for sign in signs]).reshape(-1, 4, 3)
    return matched(np.linalg.norm(corners[:, None] - vertices[None], axis=-1).mean(axis=-1), GATE_M)


def same_text(surveyed: SurveyedSign, sign: Structure) -> bool:
    """Whether a mapped sign has exactly the surveyed one's text, whose line breaks count as spaces."""
    return " ".join(surveyed.text.split()) == sign.attributes.get("text", "")


def draw(
    structures: Sequence[Structure], survey: Mapping[str, Any] | None, deviations: Mapping[str, float]
) -> tuple[Drawing, ...]:
    """Signs with their text over those of the survey, if any; marked if their deviation (m, by id) exceeds `OFF_M`."""
    corners = read_row(survey).corners() if survey and "signs" in survey else ()
    surveyed = [Drawing("polygon", quad, "survey", "fixture", "signs") for quad in corners]
    mapped = [_drawing(sign, deviations.get(sign.id, 0.0) > OFF_M) for sign in _signs(structures)]
    return (*surveyed, *mapped)


def _drawing(sign: Structure, off: bool) -> Drawing:
    text = str(sign.attributes.get("text", ""))
    return Drawing("polygon", sign.vertices, "off" if off else "mapped", "fixture", "signs", caption=text, name=sign.id)


def _signs(structures: Sequence[Structure]) -> list[Structure]:
    return [structure for structure in structures if structure.label == "sign"]


UP = np.array([0.0, 1.0, 0.0])
FACING = 0.7
"""Of a sign's normal, the share along z from which the sign is one of the face, and so read from before it."""


def survey_entry(structures: Sequence[Structure]) -> SurveyEntry:
    """The signs with their corners, clockwise from the upper left one as one reads them, and their texts. Either side
    of a sign that is not in the face may be the one that is read: its four corners stay in the order in which they were
    given, and a plate is read where its first corner is. Raises OutputError."""
    return SurveyEntry({"signs": [_sign_entry(sign) for sign in structures]})


def _sign_entry(structure: Structure) -> dict[str, object]:
    text = structure.attributes.get("text", "")
    return {"corners": _corners(structure).tolist(), "text": text if isinstance(text, str) else str(text)}


def _corners(structure: Structure) -> Floats:
    points = structure.vertices
    if len(points) not in (4, 8):
        raise OutputError(f"{structure.id}: a sign has four corners, or eight as a plate: there are {len(points)}")
    normal = _plate_normal(points)
    if normal[2] < FACING and len(points) == 4:
        return points
    if normal[2] < FACING and (points[0] - points.mean(axis=0)) @ normal < 0:
        normal = -normal
    front = points[np.sort(np.argsort(-(points @ normal), kind="stable")[:4])]
    arms = front - front.mean(axis=0)
    across, up = arms @ np.cross(UP, normal), arms @ UP
    clockwise = np.argsort(-np.arctan2(up, across), kind="stable")
    first = int(np.argmax((up - across)[clockwise]))
    ordered: Floats = front[np.roll(clockwise, -first)]
    return ordered


def _plate_normal(points: Floats) -> Floats:
    """The direction (3,) in which a plate is thinnest, towards +z."""
    normal: Floats = np.linalg.svd(points - points.mean(axis=0))[2][-1]
    return normal if normal[2] >= 0 else -normal
