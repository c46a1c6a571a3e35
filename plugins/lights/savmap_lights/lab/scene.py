"""Lamps for the simulator: lines of strip or compact lamps below the ceiling, with their survey.

A lamp's luminous body is labelled "light" on all its faces; its housing, if any, is not.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, Literal

import numpy as np
from pydantic import Field

from savmap.lab.scenes import FACES, Box, Material, RandomSection, Rgb, RowFrame, SceneParts, Site, Strict, validated
from savmap.types import Floats


class LampLine(Strict):
    """Lamps on a line parallel to the aisle at `z` and `height` (of the lamps' middle), every `pitch` metres."""

    z: float
    height: float = Field(gt=0.5)
    pitch: float = Field(gt=0.1)
    start: float | None = None
    end: float | None = None
    kind: Literal["strip", "compact"] = "strip"
    across: bool = False
    length: float = Field(default=1.25, gt=0.02)
    width: float = Field(default=0.12, gt=0.01)
    thickness: float = Field(default=0.06, gt=0.005)
    housing: bool = False
    hangers: bool = False
    emission: float = Field(default=12.0, gt=0)
    color: Rgb = (1.0, 0.98, 0.95)
    broken: float = Field(default=0.0, ge=0, le=1)


class Lamps(Strict):
    """The section of a scene file."""

    lines: tuple[LampLine, ...]


def scene(section: Mapping[str, Any], rng: np.random.Generator, site: Site) -> SceneParts:
    """The boxes of all lamps and, for each mapped row, their ends in its frame."""
    boxes: list[Box] = []
    ends: list[Floats] = []
    for line in validated(Lamps, section, "structures.lights").lines:
        for x in _positions(line, site):
            if rng.random() >= line.broken:
                boxes += _lamp(line, x, site)
                ends.append(_ends(line, x))
    survey = {name: _survey(ends, frame) for name, frame in site.frames.items() if frame.mapped}
    return SceneParts(boxes, survey)


def random_section(rng: np.random.Generator, site: Site, drawn: RandomSection | None) -> RandomSection | None:
    """Lamps of one kind on one to three lines along a furnished aisle, below the ceiling and above the rows."""
    if drawn is not None or site.aisle is None or not site.sizes:
        return None
    aisle, ceiling, tallest = site.aisle, site.hall.height, max(size.height for size in site.sizes.values())
    middle = aisle * float(rng.uniform(0.3, 0.7))
    strip = bool(rng.random() < 0.6)
    length = float(rng.uniform(0.6, 2.4))
    drop = float(rng.uniform(0.02, min(1.6, ceiling - tallest - 0.4)))
    line = {
        "height": ceiling - drop - 0.05,
        "pitch": float(rng.uniform(length + 0.3, length + 4.0)) if bool(rng.random() < 0.85) else length + 0.04,
        "kind": "strip" if strip else "compact",
        "across": bool(rng.random() < 0.2),
        "length": length,
        "width": float(rng.uniform(0.05, 0.25)) if strip else float(rng.uniform(0.2, 0.7)),
        "thickness": float(rng.uniform(0.03, 0.15)),
        "housing": bool(rng.random() < 0.35),
        "hangers": bool(rng.random() < 0.5),
        "emission": float(rng.uniform(4, 30)),
        "broken": float(rng.choice([0.0, 0.1, 0.3])),
    }
    places = [middle] + [float(z) for z in (middle - aisle - 2, middle + aisle + 2) if rng.random() < 0.6]
    return RandomSection({"lines": [{**line, "z": z} for z in places]})


def _positions(line: LampLine, site: Site) -> Floats:
    start = site.hall.x[0] + line.pitch / 2 if line.start is None else line.start
    end = site.hall.x[1] - line.pitch / 4 if line.end is None else line.end
    return np.arange(start, end, line.pitch)


def _size(line: LampLine) -> Floats:
    long = line.length if line.kind == "strip" else line.width
    along, sideways = (line.width, long) if line.across else (long, line.width)
    return np.array([along, line.thickness, sideways])


def _ends(line: LampLine, x: float) -> Floats:
    half = _size(line) / 2 * (np.array([0, 0, 1]) if line.across else np.array([1, 0, 0]))
    middle = np.array([x, line.height, line.z])
    return np.stack([middle - half, middle + half])


def _survey(ends: list[Floats], frame: RowFrame) -> dict[str, Any]:
    in_row = [frame.to_row(pair) for pair in ends]
    ordered = sorted(
        (pair[np.argsort(pair[:, 0], kind="stable")] for pair in in_row), key=lambda pair: float(pair[0, 0])
    )
    return {"lights": [{"ends": pair.round(9).tolist()} for pair in ordered]}


def _lamp(line: LampLine, x: float, site: Site) -> Iterator[Box]:
    glow = Material(line.color, emission=line.emission)
    body = Box(np.array([x, line.height, line.z]), _size(line), glow)
    yield replace(body, face_labels=dict.fromkeys(FACES, "light"))
    top = line.height + line.thickness / 2
    metal = Material((0.6, 0.6, 0.6))
    if line.housing:
        size = _size(line) * np.array([1.05, 0, 1.3]) + np.array([0, 0.06, 0])
        yield Box(np.array([x, top + 0.031, line.z]), size, metal)
        top += 0.061
    if line.hangers and site.hall.height > top + 0.05:
        rod = np.array([0.012, site.hall.height - top, 0.012])
        yield Box(np.array([x, (site.hall.height + top) / 2 + 0.0005, line.z]), rod, metal)
