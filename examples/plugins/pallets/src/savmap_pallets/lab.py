"""Pallets for the simulator: boards and blocks of wood or plastic on the floor before a row, with their survey.

All faces are labelled "pallet". The hollows between the blocks are dark boxes with the same label: a pallet's outline is that of
a cuboid.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from pydantic import Field

from savmap.lab.scenes import (
    FACES,
    Box,
    Material,
    RandomSection,
    Rgb,
    RowFrame,
    SceneError,
    SceneParts,
    Site,
    Strict,
    span,
    validated,
)
from savmap.plugin.hookspecs import hookimpl
from savmap.types import Floats

WOOD: Rgb = (0.46, 0.33, 0.2)
PLASTICS: tuple[Rgb, ...] = ((0.03, 0.1, 0.4), (0.1, 0.1, 0.11), (0.4, 0.41, 0.42), (0.5, 0.05, 0.03))
BOARD_M, HOLLOW_M = 0.022, 0.004
APART_M, TRIES = 1.6, 40


class Pallet(Strict):
    """One pallet: its middle on the floor in the row's frame, m, and its long side's turn about y from the row's x axis."""

    x: float
    z: float
    turn_deg: float = 0.0
    size: tuple[float, float, float] = (1.2, 0.8, 0.144)
    color: Rgb = WOOD
    boards: int = Field(default=5, ge=1, le=12)


class Section(Strict):
    """The section of a scene file: pallets before each row."""

    rows: dict[str, tuple[Pallet, ...]]


class PalletsLab:
    """What `savmap simulate` and training ask."""

    @hookimpl
    def scene(self, section: Mapping[str, Any], rng: np.random.Generator, site: Site) -> SceneParts:
        """The boxes of all pallets, and each mapped row's survey of them. Raises SceneError for a row the scene does not place."""
        rows = validated(Section, section, "structures.pallets").rows
        boxes: list[Box] = []
        for name, pallets in rows.items():
            if name not in site.frames:
                raise SceneError(f"structures.pallets.rows.{name}: `rows` does not place a row {name}")
            boxes += [box for pallet in pallets for box in placed(pallet, site.frames[name], rng)]
        survey = {
            name: {
                "pallets": [
                    {"x": p.x, "z": p.z, "turn_deg": p.turn_deg, "size": list(p.size)} for p in rows.get(name, ())
                ]
            }
            for name, frame in site.frames.items()
            if frame.mapped
        }
        return SceneParts(boxes, survey)

    @hookimpl
    def random_section(self, rng: np.random.Generator, site: Site, drawn: RandomSection | None) -> RandomSection | None:
        """The section of a random place: pallets before its mapped rows, none within another's reach."""
        rows: dict[str, Any] = {}
        for name, frame in site.frames.items():
            if frame.mapped:
                rows[name] = [_random(rng, x, z) for x, z in _places(rng, frame, site)]
        return RandomSection({"rows": rows})


def _places(rng: np.random.Generator, frame: RowFrame, site: Site) -> list[tuple[float, float]]:
    fronts = [own.origin[2] for own in site.frames.values() if own.mapped]
    width = float(max(fronts) - min(fronts)) or 3.0
    chosen: list[tuple[float, float]] = []
    for _ in range(TRIES):
        x, z = float(rng.uniform(-1, 24)), float(rng.uniform(0.55, max(0.65, 0.45 * width)))
        apart = all(np.hypot(x - other[0], z - other[1]) > APART_M for other in chosen)
        inside = site.hall.x[0] + 1 < frame.to_world(np.array([x, 0.0, z]))[0] < site.hall.x[1] - 1
        if apart and inside:
            chosen.append((x, z))
    return chosen


def _random(rng: np.random.Generator, x: float, z: float) -> dict[str, Any]:
    base = np.array(WOOD if rng.random() < 0.75 else PLASTICS[int(rng.integers(len(PLASTICS)))])
    color = np.clip(base * rng.uniform(0.5, 1.5) * rng.uniform(0.9, 1.1, 3), 0.01, 0.9)
    size = (1.2, 0.8, 0.144) if rng.random() < 0.8 else rng.uniform([1.0, 0.6, 0.12], [1.3, 1.1, 0.17])
    return {
        "x": x,
        "z": z,
        "turn_deg": float(rng.choice([0.0, 90.0]) + rng.normal(0, 6) if rng.random() < 0.5 else rng.uniform(0, 180)),
        "size": [float(one) for one in size],
        "color": color.tolist(),
        "boards": int(rng.integers(4, 9)),
    }


def placed(pallet: Pallet, frame: RowFrame, rng: np.random.Generator) -> Iterator[Box]:
    """The boxes of a pallet in the world, labelled."""
    angle = np.radians(pallet.turn_deg)
    cos, sin = np.cos(angle), np.sin(angle)
    turn = np.array([[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]])
    middle = np.array([pallet.x, 0.0, pallet.z])
    for box in _boxes(pallet, rng):
        yield Box(
            frame.to_world(middle + turn @ box.center),
            box.size,
            box.material,
            frame.world_from_row @ turn @ box.rotation,
            dict.fromkeys(FACES, "pallet"),
        )


def _boxes(pallet: Pallet, rng: np.random.Generator) -> Iterator[Box]:
    """Boards and blocks about the pallet's middle on the floor, long side along x."""
    long, wide, high = pallet.size
    paint = Material(pallet.color, "wood", _share(pallet.color, 0.5), 0.5, float(rng.uniform(0.3, 0.9)), 0.8)
    top, low = high - BOARD_M, BOARD_M
    x, z = (-long / 2, long / 2), (-wide / 2, wide / 2)
    yield from _boards(x, z, (top, high), pallet.boards, paint, rng)
    for middle in (-1, 0, 1):
        place = middle * (wide / 2 - 0.05)
        yield span(x, (0.001, low), (place - 0.05, place + 0.05), paint)
        for end in (-1, 0, 1):
            along = end * (long / 2 - 0.0725)
            yield span((along - 0.0725, along + 0.0725), (low, top), (place - 0.05, place + 0.05), _worn(paint, rng))
    dark = Material(_share(pallet.color, 0.12))
    inside = (x[0] + HOLLOW_M, x[1] - HOLLOW_M), (z[0] + HOLLOW_M, z[1] - HOLLOW_M)
    yield span(inside[0], (low * 0.5, high - 3 * HOLLOW_M), inside[1], dark)


def _boards(
    x: tuple[float, float],
    z: tuple[float, float],
    y: tuple[float, float],
    count: int,
    paint: Material,
    rng: np.random.Generator,
) -> Iterator[Box]:
    gap = float(rng.uniform(0.0, 0.35)) * (z[1] - z[0]) / count
    edges: Floats = np.linspace(z[0], z[1] + gap, count + 1)
    for start, end in zip(edges[:-1].tolist(), (edges[1:] - gap).tolist(), strict=True):
        yield span(x, y, (start, end), _worn(paint, rng))


def _worn(paint: Material, rng: np.random.Generator) -> Material:
    return replace(paint, color=_share(paint.color, float(rng.uniform(0.8, 1.2))), seed=int(rng.integers(1 << 30)))


def _share(color: Rgb, share: float) -> Rgb:
    red, green, blue = (min(part * share, 0.95) for part in color)
    return red, green, blue
