"""Figures by matplotlib without a display: sized in metres, painted from drawings, saved alike each time."""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from savmap.errors import OutputError
from savmap.files.atomic import write_bytes
from savmap.report.drawing import Drawing, Role, Tone
from savmap.types import Floats

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Style = Mapping[str, Any]

STYLES: Mapping[tuple[Role, Tone], Style] = {
    ("survey", "structure"): {"color": "#ffd43b", "linewidth": 0.0, "zorder": 1},
    ("mapped", "structure"): {"color": "#12355b", "linewidth": 1.1, "linestyle": (0, (4, 2)), "zorder": 3},
    ("off", "structure"): {"color": "#d00000", "linewidth": 1.6, "linestyle": (0, (4, 2)), "zorder": 4},
    ("survey", "fixture"): {"color": "#ffd43b", "linewidth": 6.0, "zorder": 1},
    ("mapped", "fixture"): {"color": "#e8590c", "linewidth": 2.2, "zorder": 3},
    ("off", "fixture"): {"color": "#d00000", "linewidth": 2.2, "zorder": 4},
}
_SAID: Mapping[Role, str] = {"survey": "survey", "mapped": "map", "off": "map, off by more than 5 cm or spurious"}
_UNDATED: Mapping[str, Style] = {"png": {}, "svg": {"Date": None}, "pdf": {"CreationDate": None}}


def new_axes(size_in: tuple[float, float]) -> tuple[Figure, Axes]:
    """A figure of this size in inches, with one pair of axes and a quiet grid."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    figure = Figure(figsize=size_in, layout=ConstrainedLayoutEngine(h_pad=0.12, w_pad=0.12))
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    axes.set_axisbelow(True)
    axes.grid(color="#e9ecef", linewidth=0.8)
    axes.spines[["top", "right"]].set_visible(False)
    return figure, axes


def save(figure: Figure, path: Path) -> None:
    """Write a figure as PNG, SVG or PDF, by the name's ending, whole or not at all. Raises OutputError."""
    import matplotlib

    ending = path.suffix.lstrip(".").lower()
    if ending not in _UNDATED:
        raise OutputError(f"{path}: pictures are written as .png, .svg or .pdf")
    stream = io.BytesIO()
    with matplotlib.rc_context({"svg.hashsalt": "savmap"}):
        figure.savefig(stream, format=ending, dpi=150, metadata=dict(_UNDATED[ending]))
    write_bytes(path, stream.getvalue())


def window(points: Floats, margin_m: float) -> tuple[float, float, float, float]:
    """Left, right, bottom, top of a picture that shows points (n, 2) with a margin on every side."""
    (left, bottom), (right, top) = points.min(axis=0) - margin_m, points.max(axis=0) + margin_m
    return float(left), float(right), float(bottom), float(top)


def axes_for(bounds: tuple[float, float, float, float], heights_in: tuple[float, float]) -> tuple[Figure, Axes]:
    """Axes in metres over these bounds: equal scales where that keeps the height, in inches, above its lower limit."""
    left, right, bottom, top = bounds
    equal = 12.5 * (top - bottom) / (right - left)
    height = float(np.clip(equal, *heights_in))
    width = 1.5 + 12.5 * min(1.0, height / equal)
    figure, axes = new_axes((max(width, 7.0), height + 1.8))
    axes.set_xlim(left, right)
    axes.set_ylim(bottom, top)
    axes.set_aspect("equal" if equal >= heights_in[0] else "auto")
    if equal < heights_in[0]:
        stretch = f"vertical scale {heights_in[0] / equal:.1f} times that along x"
        axes.set_title(stretch, loc="right", fontsize=9, color="#495057")
    axes.set_xlabel("x along the row, m")
    return figure, axes


def paint(axes: Axes, drawing: Drawing, across: Literal[1, 2], **changes: Any) -> None:
    """One drawing, seen as x against y (`across` 1) or z (2), in its style but for `changes`."""
    label = f"{_SAID[drawing.role]}: {drawing.legend}"
    style = {**STYLES[drawing.role, drawing.tone], **changes, "label": label}
    x, v = drawing.points[:, 0], drawing.points[:, across]
    if drawing.kind == "point":
        style.update(marker="o", markersize=4 + style["linewidth"], linestyle="")
        axes.plot(x, v, **style)
    elif drawing.kind == "line":
        axes.plot(x, v, solid_capstyle="butt", **style)
    elif drawing.role == "survey":
        axes.fill(x, v, **style)
    else:
        axes.plot(np.append(x, x[0]), np.append(v, v[0]), **style)


def legend(figure: Figure, axes: Axes) -> None:
    """A legend beneath the axes: one entry for each label, in the order painted."""
    handles, labels = axes.get_legend_handles_labels()
    if not labels:
        return
    entries = dict(zip(reversed(labels), reversed(handles), strict=True))
    names = sorted(entries, key=labels.index)
    lines = -(-len(names) // max(2, int(figure.get_figwidth() / 2.8)))
    shown = [entries[name] for name in names]
    figure.legend(shown, names, loc="outside lower center", ncols=-(-len(names) // lines), frameon=False, fontsize=9)
