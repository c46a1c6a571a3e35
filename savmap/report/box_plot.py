"""The paper's box plot (its figure of all rows): errors by class, over all rows together, as a figure in pixels."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from savmap.report.numbers import fixed
from savmap.report.scene import Figure, Label, Layer, Shape, round_number, ticks
from savmap.types import Evaluation, Floats, pool

_COLUMN, _LEFT, _TOP, _HEIGHT, _BELOW, _HALF = 130, 60, 14, 300, 52, 32
_BOTTOM = _TOP + _HEIGHT
_MOST_DOTS = 400
_LEGEND = (
    ("box", "quartiles"),
    ("median line", "median"),
    ("mean line", "mean"),
    ("whisker line", "up to 1.5 boxes further"),
    ("measure point", "a measure"),
)


@dataclass(frozen=True, eq=False)
class Box:
    """Quartiles, whiskers up to 1.5 boxes further, mean, and the errors beyond the whiskers (n,), all in cm."""

    low: float
    first: float
    median: float
    third: float
    high: float
    mean: float
    beyond: Floats

    def __str__(self) -> str:
        """Its numbers in words."""
        figures = (self.median, self.mean, self.first, self.third, self.low, self.high)
        median, mean, first, third, low, high = (fixed(value, 2, True) for value in figures)
        return f"median {median}, mean {mean}, quartiles {first} and {third}, whiskers {low} and {high}"


def box_of(errors_cm: Floats) -> Box:
    """The box of errors (n,), n > 0 (Tukey 1977)."""
    first, median, third = (float(value) for value in np.percentile(errors_cm, [25, 50, 75]))
    reach = 1.5 * (third - first)
    inside = (errors_cm >= first - reach) & (errors_cm <= third + reach)
    within = errors_cm[inside]
    mean = float(errors_cm.mean())
    return Box(float(within.min()), first, median, third, float(within.max()), mean, errors_cm[~inside])


def box_plot(evaluation: Evaluation) -> Figure | None:
    """Truth - estimate by class; None where nothing was matched."""
    pooled = pool(evaluation.rows.values()).errors
    errors_cm = {name: 100 * errors for name, errors in pooled.items() if len(errors)}
    if not errors_cm:
        return None
    boxes = {name: box_of(errors) for name, errors in errors_cm.items()}
    scale = Scale(boxes)
    width = _LEFT + _COLUMN * len(boxes)
    columns = [
        _column(_LEFT + _COLUMN * k + _COLUMN // 2, errors_cm[name], box, scale)
        for k, (name, box) in enumerate(boxes.items())
    ]
    values = ticks(scale.low, scale.high, 12)
    grid = [Layer("grid", (Shape("".join(f"M{_LEFT} {scale(value)}H{width}" for value in values)),))]
    if scale.low < 0 < scale.high:
        grid.append(Layer("floor", (Shape(f"M{_LEFT} {scale(0)}H{width}"),)))
    numbers = [Label(_LEFT - 6, scale(value), round_number(value), "scale", dy=0.35) for value in values]
    words = "; ".join(f"{name}: {box}" for name, box in boxes.items())
    styles = ("measure", "whisker", "box", "median", "mean")
    return Figure(
        id="box-plot",
        title="Errors by class over all rows: truth \u2212 estimate, cm",
        description=f"Truth minus estimate in centimetres. {words}.",
        frame=(0, 0, width, _BOTTOM + _BELOW),
        layers=(*grid, *(Layer(style, tuple(column[style] for column in columns)) for style in styles)),
        labels=(*numbers, *_class_labels(errors_cm, scale)),
        legend=_LEGEND,
    )


class Scale:
    """From centimetres to pixels down the page: all whiskers are shown, and as much again on either side for what is
    beyond."""

    def __init__(self, boxes: Mapping[str, Box]) -> None:
        lowest, highest = min(box.low for box in boxes.values()), max(box.high for box in boxes.values())
        more = 0.75 * max(highest - lowest, 0.1)
        beyond = np.concatenate([box.beyond for box in boxes.values()])
        self.low = float(max(lowest - more, min(lowest, beyond.min(initial=lowest))) - 0.04 * more)
        self.high = float(min(highest + more, max(highest, beyond.max(initial=highest))) + 0.04 * more)

    def __call__(self, value_cm: float) -> int:
        """Pixels from the top."""
        return round(_TOP + _HEIGHT * (self.high - value_cm) / (self.high - self.low))

    def outside(self, values_cm: Floats) -> int:
        """How many values are not shown."""
        return int(np.sum((values_cm < self.low) | (values_cm > self.high)))


def _column(middle: int, errors_cm: Floats, box: Box, y: Scale) -> dict[str, Shape]:
    """The shapes of one class by style."""
    left, width, tip = middle - _HALF, 2 * _HALF, _HALF // 2
    whiskers = (
        f"M{middle} {y(box.high)}V{y(box.third)}M{middle} {y(box.first)}V{y(box.low)}"
        f"M{middle - tip} {y(box.high)}h{2 * tip}M{middle - tip} {y(box.low)}h{2 * tip}"
    )
    shown = np.sort(errors_cm[(errors_cm >= y.low) & (errors_cm <= y.high)])
    if len(shown) > _MOST_DOTS:
        shown = shown[np.linspace(0, len(shown) - 1, _MOST_DOTS).astype(int)]
    shifts = np.random.default_rng(0).uniform(-16, 16, len(shown))
    return {
        "measure": Shape(
            "".join(f"M{round(middle + shift)} {y(value)}h0" for value, shift in zip(shown, shifts, strict=True))
        ),
        "whisker": Shape(whiskers),
        "box": Shape(f"M{left} {y(box.third)}h{width}V{y(box.first)}h{-width}z", f"{box} cm"),
        "median": Shape(f"M{left} {y(box.median)}h{width}"),
        "mean": Shape(f"M{left} {y(box.mean)}h{width}"),
    }


def _class_labels(errors_cm: Mapping[str, Floats], y: Scale) -> list[Label]:
    labels = []
    for k, (name, errors) in enumerate(errors_cm.items()):
        middle, outside = _LEFT + _COLUMN * k + _COLUMN // 2, y.outside(errors)
        count = f"({len(errors)}, {outside} beyond the axis)" if outside else f"({len(errors)})"
        labels += [
            Label(middle, _BOTTOM + 18, name, "class"),
            Label(middle, _BOTTOM + 18, count, "class small", dy=1.4),
        ]
    return labels
