"""Labels of photographs: what was drawn, painted in its order, and the front members that a network should find.

Two formats are read: LabelMe's (`savmap label`), with `flags.front` of each shape, and `{"objects": [{"class", "id", "front", "polygon"}]}`.
In both a shape covers what lay there before, the label `background` stands for goods that hide a member, and `ignore` for what is not judged.
Corners lie between pixels: pixel i reaches from i to i + 1.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, Field

from savmap.errors import OutputError
from savmap.files.atomic import read_json
from savmap.lab.label.polygons import Polygon, filled
from savmap.lab.train.data.dataset import IGNORE
from savmap.lab.train.data.labelme import is_labelme
from savmap.lab.train.data.shapes import checked, polygon_of

Bytes = NDArray[np.uint8]
CUT = {"upright"}
"""Classes whose members are drawn in several pieces, because others cross them: pieces in line are one member."""
LEAST_PIXELS = 12
LEAST_SIDE_PX = 10
GAP_PX = 1


class Shape(BaseModel):
    """A shape of LabelMe's."""

    label: str
    points: list[tuple[float, float]]
    flags: dict[str, bool] = Field(default_factory=dict)


class Shapes(BaseModel):
    """A file of LabelMe's."""

    shapes: list[Shape]


class Thing(BaseModel):
    """An object of the other format."""

    label: str = Field(alias="class")
    front: bool
    polygon: list[tuple[float, float]]


class Things(BaseModel):
    """A file of the other format."""

    objects: list[Thing]


@dataclass(frozen=True, eq=False)
class Piece:
    """What was drawn: its label, whether it belongs to a rack's front, its corners (n, 2) px."""

    label: str
    front: bool
    outline: Polygon


@dataclass(frozen=True, eq=False)
class Member:
    """A front member as far as it is seen: rows and columns of its pixels (n,), and the slice (n,) across its long axis, 1 px
    long, that each pixel lies in. `contrast` is in grey levels, NaN where nothing beside it can be seen."""

    label: str
    rows: NDArray[np.int64]
    columns: NDArray[np.int64]
    slices: NDArray[np.int64]
    contrast: float = np.nan

    @property
    def thickness_px(self) -> float:
        """Median number of its pixels in a slice."""
        counts = np.bincount(self.slices)
        return float(np.median(counts[counts > 0]))


@dataclass(frozen=True, eq=False)
class Truth:
    """Labels of a photograph (H, W): `judged` is 0 background, k a front member of the k-th class, IGNORE also where a rear member is;
    `present` is the same with rear members as members. `members` are those of the front."""

    judged: Bytes
    present: Bytes
    members: Sequence[Member] = field(default_factory=tuple)

    @property
    def thickness_px(self) -> float:
        """Thickness of the median front member, px. Raises OutputError where there is none."""
        if not self.members:
            raise OutputError(
                "no front member is labelled, so that there is no scale; label one, or leave the photograph out"
            )
        return float(np.median([member.thickness_px for member in self.members]))


def read_pieces(path: Path) -> list[Piece]:
    """What was drawn, in order of painting. Raises OutputError for a file that is of neither format."""
    content = read_json(path)
    if is_labelme(content):
        shapes = checked(Shapes, path, content).shapes
        drawn = [(shape.label, shape.flags.get("front", True), shape.points) for shape in shapes]
    else:
        things = checked(Things, path, content).objects
        drawn = [(thing.label, thing.front, thing.polygon) for thing in things]
    return [
        Piece(label, front, polygon_of([number for point in points for number in point], f"{path}: shape {index}"))
        for index, (label, front, points) in enumerate(drawn)
    ]


def truth_of(pieces: Sequence[Piece], image: Bytes, classes: Sequence[str]) -> Truth:
    """What is to be seen in a photograph (H, W, 3) RGB. Raises OutputError for a label that is none of the classes, `background` or
    `ignore`."""
    values = {"background": 0, "ignore": IGNORE, **{name: number for number, name in enumerate(classes, start=1)}}
    unknown = sorted({piece.label for piece in pieces} - values.keys())
    if unknown:
        raise OutputError(f"unknown label {', '.join(unknown)}; labels are {', '.join(values)}")
    owners = painted(pieces, *image.shape[:2])
    present = np.array([0, *(values[piece.label] for piece in pieces)], np.uint8)[owners]
    rear = [piece.label in classes and not piece.front for piece in pieces]
    judged = np.where(np.array([False, *rear])[owners], np.uint8(IGNORE), present)
    grey = np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), np.uint8)
    free = (present == 0) | (present == IGNORE)
    return Truth(judged, present, tuple(members(pieces, owners, grey, free, classes)))


def painted(pieces: Sequence[Piece], height: int, width: int) -> NDArray[np.int32]:
    """The number of the last piece, from 1, that covers each pixel (height, width); 0 where there is none."""
    owners = np.zeros((height, width), np.int32)
    for number, piece in enumerate(pieces, start=1):
        owners[filled(piece.outline, height, width)] = number
    return owners


def members(
    pieces: Sequence[Piece], owners: NDArray[np.int32], grey: Bytes, free: NDArray[np.bool_], classes: Sequence[str]
) -> Iterator[Member]:
    """The front members of which at least some pixels are seen; `free` (H, W) says where no member is."""
    for label in classes:
        own = {n: p.outline for n, p in enumerate(pieces, start=1) if p.front and p.label == label}
        for group in in_line(own) if label in CUT else [[number] for number in own]:
            seen = np.isin(owners, group)
            rows, columns = np.nonzero(seen)
            if len(rows) < LEAST_PIXELS:
                continue
            axis, _ = long_axis(np.concatenate([own[number] for number in group]))
            along = np.floor(columns * axis[0] + rows * axis[1]).astype(np.int64)
            member = Member(label, rows, columns, along - along.min())
            yield Member(label, rows, columns, member.slices, contrast(member, axis, grey, free))


def long_axis(outline: Polygon) -> tuple[NDArray[np.float64], float]:
    """Unit vector along the smallest rectangle around corners (n, 2), and the rectangle's length."""
    corners = cv2.boxPoints(cv2.minAreaRect(outline.astype(np.float32))).astype(np.float64)
    sides = corners[1:3] - corners[:2]
    lengths = np.linalg.norm(sides, axis=1)
    longer = int(np.argmax(lengths))
    return sides[longer] / max(lengths[longer], 1e-9), float(lengths[longer])


def in_line(outlines: Mapping[int, Polygon]) -> list[list[int]]:
    """Groups of pieces: one belongs to a longer one if most of its width lies within that one's, prolonged."""
    groups: list[list[int]] = []
    for number in sorted(outlines, key=lambda n: -long_axis(outlines[n])[1]):
        piece = outlines[number]
        home = next((group for group in groups if any(_prolongs(piece, outlines[other]) for other in group)), None)
        if home is None:
            groups.append([number])
        else:
            home.append(number)
    return groups


def _prolongs(piece: Polygon, longer: Polygon) -> bool:
    axis, _ = long_axis(longer)
    across = np.array([-axis[1], axis[0]])
    (low, high), (first, last) = (((p @ across).min(), (p @ across).max()) for p in (piece, longer))
    return bool(min(high, last) - max(low, first) > (high - low) / 2)


def contrast(member: Member, axis: NDArray[np.float64], grey: Bytes, free: NDArray[np.bool_]) -> float:
    """How far a member's median grey level is from that of what lies beside it, within its own thickness, 1 px left out and members
    left out: the mean over its two sides. NaN where neither side shows 10 px."""
    reach = max(3, round(member.thickness_px)) + GAP_PX
    top, left = np.maximum([member.rows.min() - reach, member.columns.min() - reach], 0)
    window = slice(top, member.rows.max() + reach + 1), slice(left, member.columns.max() + reach + 1)
    own = np.zeros(grey[window].shape, np.uint8)
    own[member.rows - top, member.columns - left] = 1
    near, far = (cv2.dilate(own, np.ones((2 * px + 1, 2 * px + 1), np.uint8)) > 0 for px in (GAP_PX, reach))
    across, along = np.array([-axis[1], axis[0]]), axis
    rows, columns = np.nonzero(far & ~near & free[window])
    ends = np.stack([member.columns, member.rows], axis=1) @ along
    places = np.stack([columns + left, rows + top], axis=1)
    beside = (places @ along >= ends.min()) & (places @ along <= ends.max())
    offset = places @ across - np.mean(np.stack([member.columns, member.rows], axis=1) @ across)
    level = np.median(grey[member.rows, member.columns])
    around = grey[window][rows, columns]
    sides = [around[beside & (offset * sign > 0)] for sign in (-1, 1)]
    found = [abs(float(level - np.median(side))) for side in sides if len(side) >= LEAST_SIDE_PX]
    return float(np.mean(found)) if found else np.nan
