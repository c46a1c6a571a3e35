"""Figures as records: paths in whole units (millimetres or pixels), labels, a legend, and the frame that shows them.

The page puts them into its HTML as SVG, `picture.py` into files.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from savmap.report.numbers import MINUS
from savmap.types import Floats, Ints

MM = 1000.0
Frame = tuple[int, int, int, int]


@dataclass(frozen=True)
class Shape:
    """A path (the `d` of SVG), and the hint that the page shows under the pointer."""

    path: str
    hint: str = ""


@dataclass(frozen=True)
class Layer:
    """Shapes of one style (classes of figure.css), and where a click on them leads."""

    style: str
    shapes: tuple[Shape, ...]
    link: str = ""


@dataclass(frozen=True)
class Label:
    """A text at (x, y), moved by (dx, dy) of its own size; `style`: classes of figure.css."""

    x: int
    y: int
    text: str
    style: str = ""
    link: str = ""
    dx: float = 0.0
    dy: float = 0.0


@dataclass(frozen=True)
class Backdrop:
    """A picture under a figure: its address, and the frame (left, top, width, height) that it fills."""

    href: str
    frame: Frame


@dataclass(frozen=True)
class Figure:
    """A figure of this frame (left, top, width, height), painted in the order of its layers; `legend`: styles and their
    names.

    `axes`: the names of the two axes and whether the second one points down the page (1) or up (-1), for figures that
    can be zoomed; they are drawn in millimetres. Others are in pixels. `note`: a line beside the title. `backdrop`: a
    picture beneath all layers.
    """

    id: str
    title: str
    description: str
    frame: Frame
    layers: tuple[Layer, ...]
    labels: tuple[Label, ...] = ()
    legend: tuple[tuple[str, str], ...] = ()
    axes: tuple[str, str, int] | None = None
    note: str = ""
    backdrop: Backdrop | None = None


def path(points: Floats, closed: bool = False) -> str:
    """The path through points (n, 2), rounded to whole units, in steps relative to the one before; a dot for one
    point."""
    whole: Ints = np.round(points).astype(np.int64)
    steps = np.diff(whole, axis=0)
    moves = [f"h{x}" if y == 0 else f"v{y}" if x == 0 else f"l{x} {y}" for x, y in steps.tolist()] or ["h0"]
    return f"M{whole[0, 0]} {whole[0, 1]}{''.join(moves)}" + ("z" if closed else "")


def joined(outlines: Iterable[tuple[Floats, bool]]) -> str:
    """One path of several, each of points (n, 2) and whether it is closed."""
    return "".join(path(points, closed) for points, closed in outlines)


HATCH_MM = 60.0
"""Between two strokes of a hatching, along either axis."""


def hatching(points: Floats) -> list[Floats]:
    """Strokes (2, 2) that fill the upright rectangle around points (n, 2) mm, rising to the right; none where it has no
    area."""
    low, high = points.min(axis=0), points.max(axis=0)
    width, height = high - low
    if min(width, height) <= 0:
        return []
    starts = np.arange(HATCH_MM / 2, width + height, HATCH_MM)
    x, y = np.minimum(starts, width), np.maximum(starts - width, 0.0)
    ends = np.stack([np.maximum(starts - height, 0.0), np.minimum(starts, height)], axis=1)
    return [low + np.array([start, end]) for start, end in zip(np.stack([x, y], axis=1), ends, strict=True)]


def swatch(style: str, unit: float = 1.0, x: float = 0.0, y: float = 0.0) -> str:
    """The path that shows a style in a legend: 26 by 14 units, its left top corner at (x, y)."""
    kinds = style.split()
    corner = np.array([x, y])
    if "point" in kinds:
        return path(unit * np.array([[13.0, 7.0]]) + corner)
    if "polygon" in kinds or style == "box":
        return path(unit * np.array([[2.0, 3.0], [24.0, 3.0], [24.0, 11.0], [2.0, 11.0]]) + corner, closed=True)
    if style == "assumed":
        return "".join(path(unit * np.array([[4.0 + k, 11.0], [12.0 + k, 3.0]]) + corner) for k in (0, 5, 10))
    if style == "failed":
        strokes = np.array([[[9.0, 3.0], [17.0, 11.0]], [[9.0, 11.0], [17.0, 3.0]]])
        return "".join(path(unit * stroke + corner) for stroke in strokes)
    return path(unit * np.array([[2.0, 7.0], [24.0, 7.0]]) + corner)


def frame_of(points: Floats, margin: float, parts: tuple[float, float]) -> Frame:
    """Left, top, width, height around points (n, 2) with a margin on every side; on the left and right, and above and
    below, of these parts of the width where that is more."""
    margins = np.maximum(margin, np.ptp(points[:, 0]) * np.array(parts))
    low, high = points.min(axis=0) - margins, points.max(axis=0) + margins
    left, top, width, height = (round(float(value)) for value in (*low, *(high - low)))
    return left, top, max(width, 1), max(height, 1)


def ticks(low: float, high: float, parts: int) -> list[float]:
    """Round numbers between two others: multiples of 1, 2 or 5 times a power of ten, about `parts` of them."""
    rough = (high - low) / parts
    power = 10.0 ** np.floor(np.log10(rough))
    step = power * next(factor for factor in (1, 2, 5, 10) if factor * power >= rough)
    return [float(k * step) for k in range(int(np.ceil(low / step - 1e-9)), int(np.floor(high / step + 1e-9)) + 1)]


def metre_grid(frame: Frame, down: int, stretch: float = 1.0) -> tuple[Layer, tuple[Label, ...]]:
    """Lines over a frame in millimetres at round metres, and their labels; the second axis points `down` the page (1)
    or up (-1) and is stretched."""
    left, top, width, height = frame
    along_mm = stretch * MM
    across = ticks(left / MM, (left + width) / MM, 12)
    along = ticks(top / along_mm, (top + height) / along_mm, max(4, round(12 * height / width)))
    lines = [f"M{round(x * MM)} {top}v{height}" for x in across]
    lines += [f"M{left} {round(y * along_mm)}h{width}" for y in along]
    edge = 0.02 * width  # where a label would be cut off
    below = [
        Label(round(x * MM), top, _metres(x), "tick x", dy=1.1) for x in across if edge < x * MM - left < width - edge
    ]
    left_labels = [
        Label(left, round(y * along_mm), _metres(down * y), "tick y", dx=0.4, dy=-0.2)
        for y in along
        if y * along_mm - top > edge
    ]
    return Layer("grid", (Shape("".join(lines)),)), (*below, *left_labels)


def round_number(value: float) -> str:
    """A round number with a true minus."""
    return f"{value + 0.0:g}".replace("-", MINUS)


def _metres(value: float) -> str:
    return f"{round_number(value)} m"
