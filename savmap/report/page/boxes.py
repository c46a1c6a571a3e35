"""The paper's box plot (its figure of all rows): errors by class, over all rows together, as an SVG figure in pixels."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from savmap.evaluation import Evaluation, pool
from savmap.report.page.figures import Figure, Label, Layer, Shape, ticks
from savmap.report.page.numbers import MINUS, fixed
from savmap.types import Floats

_COLUMN, _LEFT, _TOP, _HEIGHT, _BELOW, _HALF = 130, 60, 14, 300, 52, 32
_MOST_DOTS = 400


@dataclass(frozen=True)
class Box:
    """Quartiles, whiskers up to 1.5 boxes further, mean, and the errors beyond the whiskers (n,), all in cm."""

    low: float
    first: float
    median: float
    third: float
    high: float
    mean: float
    beyond: Floats


def box_of(errors_cm: Floats) -> Box:
    """The box of errors (n,), n > 0 (Tukey's, as matplotlib draws it)."""
    first, median, third = (float(value) for value in np.percentile(errors_cm, [25, 50, 75]))
    reach = 1.5 * (third - first)
    inside = (errors_cm >= first - reach) & (errors_cm <= third + reach)
    within = errors_cm[inside]
    return Box(
        float(within.min()), first, median, third, float(within.max()), float(errors_cm.mean()), errors_cm[~inside]
    )


def box_plot(evaluation: Evaluation) -> Figure | None:
    """Truth - estimate by class; None where nothing matched."""
    errors = {name: 100 * own for name, own in pool(evaluation.rows.values()).errors.items() if len(own)}
    if not errors:
        return None
    boxes = {name: box_of(own) for name, own in errors.items()}
    scale = Scale(boxes)
    width = _LEFT + _COLUMN * len(boxes) + 8
    columns = [_column(_LEFT + _COLUMN * k + _COLUMN // 2, box, scale) for k, box in enumerate(boxes.values())]
    looks = ("beyond", "whisker", "box", "median", "mean")
    layers = tuple(
        Layer(look, tuple(Shape(column[look], column["said"] if look == "box" else "") for column in columns))
        for look in looks
    )
    return Figure(
        id="box-plot",
        title="Errors by class over all rows: truth \u2212 estimate, cm",
        description=_described(boxes),
        frame=(0, 0, width, _TOP + _HEIGHT + _BELOW),
        layers=(_grid(scale, width), *layers),
        labels=(*_scale_labels(scale), *_class_labels(errors, boxes, scale)),
        legend=(
            ("box", "quartiles"),
            ("median line", "median"),
            ("mean line", "mean"),
            ("whisker line", "up to 1.5 boxes further"),
            ("beyond point", "further off"),
        ),
    )


class Scale:
    """From centimetres to pixels down the page: all whiskers are shown, and as much again on either side for what is beyond."""

    def __init__(self, boxes: Mapping[str, Box]) -> None:
        every = list(boxes.values())
        lowest, highest = min(own.low for own in every), max(own.high for own in every)
        room = 0.75 * max(highest - lowest, 0.1)
        beyond = np.concatenate([own.beyond for own in every])
        self.low = float(max(lowest - room, min(lowest, beyond.min(initial=lowest))) - 0.04 * room)
        self.high = float(min(highest + room, max(highest, beyond.max(initial=highest))) + 0.04 * room)

    def __call__(self, value_cm: float) -> int:
        """Pixels from the top."""
        return round(_TOP + _HEIGHT * (self.high - value_cm) / (self.high - self.low))


def _column(middle: int, box: Box, y: Scale) -> dict[str, str]:
    left, width, tip = middle - _HALF, 2 * _HALF, _HALF // 2
    spread = np.random.default_rng(0)
    shown = box.beyond[(box.beyond >= y.low) & (box.beyond <= y.high)]
    if len(shown) > _MOST_DOTS:
        shown = np.sort(shown)[np.linspace(0, len(shown) - 1, _MOST_DOTS).astype(int)]
    dots = [
        f"M{round(middle + shift)} {y(value)}h0"
        for value, shift in zip(shown, spread.uniform(-9, 9, len(shown)), strict=True)
    ]
    return {
        "beyond": "".join(dots),
        "whisker": f"M{middle} {y(box.high)}V{y(box.third)}M{middle} {y(box.first)}V{y(box.low)}"
        f"M{middle - tip} {y(box.high)}h{2 * tip}M{middle - tip} {y(box.low)}h{2 * tip}",
        "box": f"M{left} {y(box.third)}h{width}V{y(box.first)}h{-width}z",
        "median": f"M{left} {y(box.median)}h{width}",
        "mean": f"M{left} {y(box.mean)}h{width}",
        "said": f"median {fixed(box.median, 2, True)} cm, mean {fixed(box.mean, 2, True)} cm, quartiles {fixed(box.first, 2, True)} and {fixed(box.third, 2, True)} cm",
    }


def _grid(y: Scale, width: int) -> Layer:
    lines = "".join(f"M{_LEFT} {y(value)}H{width}" for value in ticks(y.low, y.high, 8))
    return Layer("grid", (Shape(lines), Shape(f"M{_LEFT} {y(0)}H{width}")) if y.low < 0 < y.high else (Shape(lines),))


def _scale_labels(y: Scale) -> list[Label]:
    return [
        Label(_LEFT - 6, y(value), f"{value + 0.0:g}".replace("-", MINUS), "scale") for value in ticks(y.low, y.high, 8)
    ]


def _class_labels(errors: Mapping[str, Floats], boxes: Mapping[str, Box], y: Scale) -> list[Label]:
    found = []
    for k, (name, own) in enumerate(errors.items()):
        middle = _LEFT + _COLUMN * k + _COLUMN // 2
        hidden = int(np.sum((own < y.low) | (own > y.high)))
        found.append(Label(middle, _TOP + _HEIGHT + 18, name, "class"))
        more = f"({len(own)}" + (f", {hidden} further off)" if hidden else ")")
        found.append(Label(middle, _TOP + _HEIGHT + 18, more, "class small"))
    return found


def _described(boxes: Mapping[str, Box]) -> str:
    each = (
        f"{name}: median {fixed(box.median, 2, True)}, mean {fixed(box.mean, 2, True)}, quartiles {fixed(box.first, 2, True)} and {fixed(box.third, 2, True)}, whiskers {fixed(box.low, 2, True)} and {fixed(box.high, 2, True)}"
        for name, box in boxes.items()
    )
    return "Truth minus estimate in centimetres. " + "; ".join(each) + "."
