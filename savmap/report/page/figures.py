"""What the page's SVG figures are made of: paths in whole units (millimetres or pixels), labels, and their frame."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from savmap.report.page.numbers import MINUS
from savmap.types import Floats, Ints

MM = 1000.0


@dataclass(frozen=True)
class Shape:
    """One path (the `d` of SVG), and what is said of it under the pointer."""

    path: str
    title: str = ""


@dataclass(frozen=True)
class Layer:
    """Shapes that look alike (`look`: classes of the style sheet), and where a click on them leads."""

    look: str
    shapes: tuple[Shape, ...]
    link: str = ""


@dataclass(frozen=True)
class Label:
    """A text at (x, y); `look` says how it is set."""

    x: int
    y: int
    text: str
    look: str = ""
    link: str = ""


@dataclass(frozen=True)
class Figure:
    """A picture of this frame (left, top, width, height), painted in the order of its layers; `legend` names looks.

    `axes`: what the two axes are called and whether the second one points down the page (1) or up (-1), for the figures that
    can be zoomed; they are drawn in millimetres. Others are in pixels.
    """

    id: str
    title: str
    description: str
    frame: tuple[int, int, int, int]
    layers: tuple[Layer, ...]
    labels: tuple[Label, ...] = ()
    legend: tuple[tuple[str, str], ...] = ()
    axes: tuple[str, str, int] | None = None


def path(points: Floats, closed: bool = False) -> str:
    """The path through points (n, 2), rounded to whole units, in steps relative to the one before; a dot for one point."""
    whole: Ints = np.round(points).astype(np.int64)
    steps = np.diff(whole, axis=0)
    moves = [_step(int(x), int(y)) for x, y in steps] if len(whole) > 1 else ["h0"]
    return f"M{whole[0, 0]} {whole[0, 1]}{''.join(moves)}" + ("z" if closed else "")


def joined(points: Iterable[tuple[Floats, bool]]) -> str:
    """One path of several, each of points (n, 2) and whether it is closed."""
    return "".join(path(own, closed) for own, closed in points)


def frame_of(points: Floats, margin: float, parts: tuple[float, float]) -> tuple[int, int, int, int]:
    """Left, top, width, height around points (n, 2) with a margin on every side; on the left and right, and above and below,
    of these parts of the width where that is more."""
    room = np.maximum(margin, np.ptp(points[:, 0]) * np.array(parts))
    low, high = points.min(axis=0) - room, points.max(axis=0) + room
    left, top, width, height = (round(float(value)) for value in (*low, *(high - low)))
    return left, top, max(width, 1), max(height, 1)


def nice_step(span: float, parts: int) -> float:
    """1, 2 or 5 times a power of ten, so that `span` has about as many steps."""
    rough = span / parts
    power = 10.0 ** np.floor(np.log10(rough))
    return float(power * next(factor for factor in (1, 2, 5, 10) if factor * power >= rough))


def ticks(low: float, high: float, parts: int) -> list[float]:
    """Round numbers between two others."""
    step = nice_step(high - low, parts)
    return [float(k * step) for k in range(int(np.ceil(low / step - 1e-9)), int(np.floor(high / step + 1e-9)) + 1)]


def metre_grid(frame: tuple[int, int, int, int], flipped: bool) -> tuple[Layer, tuple[Label, ...]]:
    """Lines over a frame in millimetres at round metres, and what stands at their ends; `flipped`: the second axis is up."""
    left, top, width, height = frame
    right, bottom, down = left + width, top + height, -1 if flipped else 1
    across, along = ticks(left / MM, right / MM, 12), ticks(top / MM, bottom / MM, max(4, round(12 * height / width)))
    lines = [f"M{round(x * MM)} {top}v{height}" for x in across] + [f"M{left} {round(y * MM)}h{width}" for y in along]
    below = [Label(round(x * MM), top, f"{x + 0.0:g} m".replace("-", MINUS), "tick x") for x in across]
    beside = [Label(left, round(y * MM), f"{down * y + 0.0:g} m".replace("-", MINUS), "tick y") for y in along]
    return Layer("grid", (Shape("".join(lines)),)), (*below, *beside)


def _step(x: int, y: int) -> str:
    return f"h{x}" if y == 0 else f"v{y}" if x == 0 else f"l{x} {y}"
