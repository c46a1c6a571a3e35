"""Figures as files: the page's SVG with a title and a legend, as it is or rasterised by resvg."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib.metadata import distribution
from pathlib import Path

import resvg_py
from markupsafe import Markup

from savmap.errors import OutputError
from savmap.files.atomic import write_bytes
from savmap.report.box_plot import box_plot
from savmap.report.evaluation import mean_absolute_error, named_counts
from savmap.report.row_views import row_view
from savmap.report.scene import Figure, Label, Layer, Shape, swatch
from savmap.report.templating import rendered, resource
from savmap.types import Drawing, Evaluation, Picture, RowMap, pool

# Pixels: the widest and the narrowest picture, and how many of the file's there are to one of these.
_WIDTH, _LEAST_WIDTH, _ZOOM = 1000, 560, 2.0
# The height of a row's view over its width: less is stretched, more is drawn narrower.
_LEAST_RATIO: dict[Picture, float] = {"face": 0.32, "plan": 0.24}
_MOST_RATIO = 0.68
_HEAD, _LEGEND_LINE, _LETTER = 44, 20, 6.6
_FONT = "matplotlib/mpl-data/fonts/ttf/DejaVuSans.ttf"


def write_row_view(row: RowMap, drawings: Sequence[Drawing], picture: Picture, path: Path) -> None:
    """Write a row's face view or plan. Raises OutputError."""
    write_figure(row_view(row, drawings, picture, least_ratio=_LEAST_RATIO[picture]), path)


def write_box_plot(evaluation: Evaluation, path: Path) -> None:
    """Write the box plot of truth - estimate by class, all rows together. Raises OutputError."""
    score = pool(evaluation.rows.values())
    error = mean_absolute_error(score)
    mean = f"mean absolute error {100 * error:.2f} cm" if error is not None else "nothing matched"
    rows = f"Row {', '.join(evaluation.rows)}" if len(evaluation.rows) == 1 else f"{len(evaluation.rows)} rows"
    counts = f"missing: {named_counts(score.missing)}; spurious: {named_counts(score.spurious)}"
    figure = box_plot(evaluation) or Figure("box-plot", "Errors by class: truth \u2212 estimate", "", (0, 0, 1, 1), ())
    write_figure(replace(figure, note=f"{rows}: {mean}; {counts}"), path)


def write_figure(figure: Figure, path: Path) -> None:
    """Write a figure as PNG or SVG, by the name's ending, whole or not at all. Raises OutputError."""
    ending = path.suffix.lower()
    if ending not in (".png", ".svg"):
        raise OutputError(f"{path}: pictures are written as .png or .svg")
    text = figure_text(figure)
    write_bytes(path, text.encode() if ending == ".svg" else rasterised(text))


def rasterised(text: str) -> bytes:
    """An SVG as PNG, with the same font on all machines."""
    font = str(distribution("matplotlib").locate_file(_FONT))
    return bytes(resvg_py.svg_to_bytes(svg_string=text, zoom=_ZOOM, skip_system_fonts=True, font_files=[font]))


def figure_text(figure: Figure) -> str:
    """A figure with its title, note and legend as SVG."""
    layout = _layout(figure)
    style = Markup(_resolved(resource("figure.css"), layout.unit))
    return rendered("figure.svg.jinja", figure=figure, layout=layout, style=style)


@dataclass(frozen=True)
class _Layout:
    """Where a figure's parts stand, in its own units, of which a pixel of the picture has so many; its size in
    pixels."""

    unit: float
    frame: tuple[float, float, float, float]
    size: tuple[float, float]
    texts: tuple[Label, ...]
    swatches: tuple[Layer, ...]


def _layout(figure: Figure) -> _Layout:
    left, top, width, height = figure.frame
    pixels = _WIDTH * min(1.0, _MOST_RATIO * width / height) if figure.axes else float(width)
    unit = width / pixels
    broad = max(pixels, _LEAST_WIDTH)
    column = 50 + _LETTER * max((len(text) for _, text in figure.legend), default=0)
    columns = max(1, int(broad / column))
    texts = [Label(left, top, figure.title, "title", dy=-1.9), Label(left, top, figure.note, "note", dy=-0.7)]
    swatches = []
    for k, (style, text) in enumerate(figure.legend):
        x = left + unit * column * (k % columns)
        y = top + height + unit * _LEGEND_LINE * (0.5 + k // columns)
        swatches.append(Layer(style, (Shape(swatch(style, unit, x, y)),)))
        texts.append(Label(round(x + 32 * unit), round(y + 7 * unit), text, dy=0.35))
    lines = -(-len(figure.legend) // columns)
    tall = _HEAD + height / unit + _LEGEND_LINE * (lines + 1)
    frame = (left - 10 * unit, top - _HEAD * unit, (broad + 20) * unit, tall * unit)
    return _Layout(unit, frame, (broad + 20, tall), tuple(texts), tuple(swatches))


def _resolved(css: str, unit: float) -> str:
    """A style sheet without variables, which rasterisers do not know; `--u` is the units of a pixel."""
    values = {"u": f"{unit:.5g}", **dict(re.findall(r"--([\w-]+): ([^;]+);", css))}
    resolved = re.sub(r"var\(--([\w-]+)(?:, [^)]*)?\)", lambda match: values[match[1]], css)
    return re.sub(
        r"calc\(([\d.]+)px \* ([\d.e+-]+)\)", lambda match: f"{float(match[1]) * float(match[2]):.5g}px", resolved
    )
