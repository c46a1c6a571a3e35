"""Signs of all kinds for the simulator's random places: on the fronts of whatever structure stands there, and over the
aisle."""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from savmap.lab.scenes import Front, RandomSection, Site
from savmap_signs.lab.artwork import FONTS

PROUD_M = 0.004
AISLE_M = 2.6
PAPERS = (
    [0.85, 0.85, 0.82], [0.8, 0.8, 0.78], [0.85, 0.6, 0.02], [0.8, 0.35, 0.02], [0.02, 0.12, 0.45],
    [0.03, 0.25, 0.08], [0.6, 0.03, 0.03], [0.03, 0.03, 0.03], [0.5, 0.55, 0.55],
)  # fmt: skip
LIGHT, DARK = [0.9, 0.9, 0.88], [0.01, 0.01, 0.01]
LETTERS = "ABCDEFGHJKLMNPRSTUVWXYZ"


def random_section(rng: np.random.Generator, site: Site, drawn: RandomSection | None) -> RandomSection | None:
    """Signs on the structures in mapped faces and over the aisle."""
    if drawn is not None:
        return None
    plates: list[dict[str, Any]] = []
    for name, fronts in site.fronts.items():
        tall, long = sorted_fronts(fronts)
        if tall and site.frames[name].mapped:
            plates += [*_at_bays(rng, name, tall, long), *_labels(rng, name, tall, long)]
    length = max((size.length for size in site.sizes.values()), default=site.hall.x[1])
    plates += _hung(rng, length, site.hall.height, site.aisle or AISLE_M)
    return RandomSection({"plates": plates})


def sorted_fronts(fronts: Sequence[Front]) -> tuple[list[Front], list[Front]]:
    """Fronts that stand upright, left to right, and those that lie along the row, left to right and bottom up."""

    def stands(front: Front) -> bool:
        return front.high[1] - front.low[1] > front.high[0] - front.low[0]

    ordered = sorted(fronts, key=lambda front: front.low)
    return [front for front in ordered if stands(front)], [front for front in ordered if not stands(front)]


def series_style(rng: np.random.Generator) -> dict[str, Any]:
    """Colours, font and border of one series of signs."""
    paper = PAPERS[int(rng.integers(len(PAPERS)))]
    luminous = float(np.dot(paper, [0.2, 0.7, 0.1]))
    ink = LIGHT if luminous < 0.15 or (luminous < 0.35 and rng.random() < 0.5) else DARK
    return {
        "paper": [float(c) for c in np.clip(np.array(paper) * rng.uniform(0.8, 1.1, 3), 0.01, 0.9)],
        "ink": ink,
        "font": FONTS[int(rng.integers(len(FONTS)))],
        "border": bool(rng.random() < 0.4),
    }


def text_of(rng: np.random.Generator, number: int) -> str:
    """A text as a warehouse has it, with a number."""
    letter = LETTERS[int(rng.integers(len(LETTERS)))]
    kinds = (
        f"{letter}{rng.integers(10, 99)}-{number:02d}",
        f"{letter}{number}",
        f"{rng.integers(10, 99)}-{number:02d}",
        f"{letter}{letter}{rng.integers(100, 999)}",
        f"AISLE\n{letter}{number:02d}",
    )
    return kinds[int(rng.integers(len(kinds)))]


def code_of(rng: np.random.Generator) -> dict[str, Any]:
    """A QR code, a tag, or none."""
    kind = str(rng.choice(["none", "qr", "tag36h11"], p=[0.6, 0.25, 0.15]))
    return {"code": kind, "content": str(rng.integers(0, 500)) if kind == "tag36h11" else ""}


def _at_bays(
    rng: np.random.Generator, row: str, tall: Sequence[Front], long: Sequence[Front]
) -> Iterator[dict[str, Any]]:
    """Signs of one series on upright fronts, on long ones, or flags that stand out of the face."""
    style, share = series_style(rng), float(rng.uniform(0.3, 1.0))
    size = float(rng.uniform(0.16, 0.45)), float(rng.uniform(0.08, 0.25))
    height = float(rng.uniform(1.2, max(1.3, min(3.2, tall[0].high[1] - 0.3))))
    mount = str(rng.choice(["upright", "beam", "flag"], p=[0.45, 0.4, 0.15]))
    for number, (left, right) in enumerate(pairwise(tall), start=1):
        if rng.random() > share:
            continue
        plate = {"row": row, "bay": number, "size": size, "text": text_of(rng, number), **style}
        middle = (left.low[0] + left.high[0]) / 2
        if mount == "flag":
            yield plate | {"at": [middle, height, size[0] / 2 + 0.03], "facing": "x"}
            continue
        between = [front for front in long if left.high[0] <= front.low[0] < right.low[0]]
        at = [middle, height, PROUD_M]
        if mount == "beam" and between:
            front = min(between, key=lambda front: abs(front.low[1] - height))
            at = [_along(rng, front, 0.2, 0.8), (front.low[1] + front.high[1]) / 2, PROUD_M]
        yield plate | {"at": at} | code_of(rng)


def _along(rng: np.random.Generator, front: Front, first: float, last: float) -> float:
    """A place along a front, between two shares of its length."""
    return front.low[0] + (front.high[0] - front.low[0]) * float(rng.uniform(first, last))


def _labels(
    rng: np.random.Generator, row: str, tall: Sequence[Front], long: Sequence[Front]
) -> Iterator[dict[str, Any]]:
    """Small labels with codes on long fronts."""
    if rng.random() < 0.5:
        return
    share = float(rng.uniform(0.6, 0.95))
    for number, front in enumerate(long, start=1):
        if rng.random() < 0.6:
            height = share * (front.high[1] - front.low[1])
            bay = sum(upright.low[0] < front.low[0] for upright in tall)
            at = [_along(rng, front, 0.1, 0.9), (front.low[1] + front.high[1]) / 2, front.high[2] + PROUD_M]
            text, kind = f"{bay:02d}-{number}", str(rng.choice(["qr", "none"]))
            yield {"row": row, "at": at, "size": [height * 2.2, height], "text": text, "code": kind, "bay": bay}


def _hung(rng: np.random.Generator, length: float, ceiling: float, aisle: float) -> Iterator[dict[str, Any]]:
    """Signs over the aisle, across it or along it."""
    if rng.random() < 0.15:
        return
    style = series_style(rng)
    size = float(rng.uniform(0.5, 1.2)), float(rng.uniform(0.25, 0.6))
    height = float(rng.uniform(2.6, max(2.7, min(5.0, ceiling - 0.6))))
    facing = "x" if rng.random() < 0.75 else "+z"
    for number, x in enumerate(np.arange(rng.uniform(0, 3), length + 2, rng.uniform(2.5, 6)).tolist()):
        at = [x, height, aisle * float(rng.uniform(0.35, 0.65))]
        yield {"at": at, "size": size, "text": text_of(rng, number), "facing": facing, "hung": True, **style}
