"""Racks for the simulator: uprights, beams, decks and bracing of every row, with their survey and places for goods.

Everything is built in the row's own frame (x along the aisle, y up, z out of the face, which is z = 0), then put into
the world. Only the +z faces of mapped rows' front uprights and beams carry labels.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from savmap.lab.scenes import (
    Box,
    Hall,
    Material,
    Rgb,
    RowFrame,
    RowSize,
    SceneError,
    SceneParts,
    Site,
    Strict,
    Support,
    span,
    validated,
)
from savmap_shelves.lab.rack import (
    Bay,
    Curve,
    Rack,
    Texture,
    beam_curve,
    curves_of,
    top_of,
    upright_curve,
    upright_starts,
)

OVERLAP_M = 0.001
"""By which the pieces of a bent member are longer, so that no gap shows between them."""


class Racks(Strict):
    """The section of a scene file: a rack for each row."""

    rows: dict[str, Rack]


def scene(section: Mapping[str, Any], rng: np.random.Generator, site: Site) -> SceneParts:
    """The boxes of all racks. Raises SceneError for a row the scene does not place or a rack taller than the hall."""
    racks = validated(Racks, section, "structures.shelves").rows
    boxes: list[Box] = []
    supports: list[Support] = []
    for name, rack in racks.items():
        frame = _frame_of(name, site)
        _check_height(name, rack, site.hall)
        boxes += [_placed(box, frame) for box in _rack(rack, rng)]
        supports += _supports(rack, frame)
    survey = {name: survey_of(rack) for name, rack in racks.items() if site.frames[name].mapped}
    references = {name: _references(entry) for name, entry in survey.items()}
    return SceneParts(
        boxes,
        survey,
        supports,
        sizes={
            name: RowSize(upright_starts(rack)[-1] + rack.upright_width, top_of(rack)) for name, rack in racks.items()
        },
        references=references,
        site_rows={name: _site_row(entry) for name, entry in references.items()},
    )


def survey_of(rack: Rack) -> dict[str, Any]:
    """A rack's entry of a survey file: uprights and sections, each member where it is on average over its length; and
    how members lean, are bowed, tilted and sag, where any does."""
    uprights, sections = [], []
    for number, start in enumerate(upright_starts(rack)):
        x = start + upright_curve(rack, number).mean
        uprights.append([x, x + rack.upright_width])
    for number, bay in enumerate(rack.bays):
        bottoms = [y + beam_curve(rack, number, level).mean for level, y in enumerate(bay.beams)]
        sections.append({"beams": [[y, y + _beam_height(rack, bay)] for y in bottoms]})
    if all(curve.is_straight for curve in curves_of(rack)):
        return {"uprights": uprights, "sections": sections}
    shapes = {
        "leans_permille": rack.leans,
        "bows_m": rack.bows,
        "tilts_permille": [bay.tilts for bay in rack.bays],
        "sags_m": [bay.sags for bay in rack.bays],
    }
    return {"uprights": uprights, "sections": sections, "shapes": shapes}


def _references(entry: Mapping[str, Any]) -> dict[str, Any]:
    """What a user would measure of a row with a tape, as references.json has it."""
    lowest = [section["beams"][0][0] if section["beams"] else None for section in entry["sections"]]
    length = entry["uprights"][-1][1] - entry["uprights"][0][0]
    return {
        "lowest_beam_bottom_height_m": {"values": lowest, "sigma": 0.002},
        "first_to_last_upright_outer_edges_m": {"value": round(length, 4), "sigma": 0.003},
    }


def _site_row(entry: Mapping[str, Any]) -> dict[str, Any]:
    """The same in the row's entry of a site file."""
    lowest, length = entry["lowest_beam_bottom_height_m"], entry["first_to_last_upright_outer_edges_m"]
    last = f"upright {len(lowest['values']) + 1} / right"
    row: dict[str, Any] = {"references": {"lengths": [{"between": ["upright 1 / left", last], **length}]}}
    if any(value is not None for value in lowest["values"]):
        row["plugins"] = {"shelves": {"lowest_beam_bottom_height_m": lowest}}
    return row


def _beam_height(rack: Rack, bay: Bay) -> float:
    return bay.beam_height or rack.beam_height


def _frame_of(name: str, site: Site) -> RowFrame:
    if name not in site.frames:
        raise SceneError(f"structures.shelves.rows.{name}: `rows` does not place a row {name}")
    return site.frames[name]


def _check_height(name: str, rack: Rack, hall: Hall) -> None:
    if top_of(rack) >= hall.height:
        raise SceneError(f"structures.shelves.rows.{name}: {top_of(rack):.2f} m is not below the ceiling (hall.height)")


def _placed(box: Box, frame: RowFrame) -> Box:
    return replace(
        box,
        center=frame.to_world(box.center),
        rotation=frame.world_from_row @ box.rotation,
        face_labels=box.face_labels if frame.mapped else {},
    )


def _rack(rack: Rack, rng: np.random.Generator) -> Iterator[Box]:
    for number, start in enumerate(upright_starts(rack)):
        yield from _frame(rack, start, upright_curve(rack, number), rng)
    for number, bay in enumerate(rack.bays):
        for level, bottom in enumerate(bay.beams):
            yield from _level(rack, bay, bottom, beam_curve(rack, number, level), rng)


def _standing(curve: Curve, x: tuple[float, float], z: tuple[float, float], paint: Material) -> Iterator[Box]:
    """The pieces of an upright member that stands at x where its curve does not move it."""
    for low, high in curve.pieces:
        box = span(x, (low, high), z, paint)
        yield box if curve.is_straight else _moved(box, 1, curve.at(low), curve.at(high))


def _lying(curve: Curve, y: tuple[float, float], z: tuple[float, float], paint: Material) -> Iterator[Box]:
    """The pieces of a level member that lies at y where its curve does not move it."""
    for low, high in curve.pieces:
        box = span((low, high), y, z, paint)
        yield box if curve.is_straight else _moved(box, 0, curve.at(low), curve.at(high))


def _moved(box: Box, axis: int, first: float, last: float) -> Box:
    """A box along x or y, with its ends so far (m) to the side along the other of these axes."""
    angle = float(np.arctan2(last - first, box.size[axis])) * (-1 if axis == 1 else 1)
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1.0]])
    center, size = box.center.copy(), box.size.copy()
    center[1 - axis] += (first + last) / 2
    size[axis] += OVERLAP_M
    return replace(box, center=center, size=size, rotation=turn)


def _paint(rack: Rack, color: Rgb, texture: Texture, rng: np.random.Generator) -> Material:
    dark = tuple(c * 0.15 for c in color) if texture == "holes" else tuple(c * 0.5 for c in color)
    return Material(
        color,
        texture,
        second_color=(dark[0], dark[1], dark[2]),
        scale_m=rack.hole_pitch if texture == "holes" else float(rng.uniform(0.4, 1.2)),
        contrast=float(rng.uniform(0.6, 1.0)) if texture == "holes" else float(rng.uniform(0.1, 0.5)),
        roughness=rack.roughness,
        metallic=rack.metallic,
        seed=int(rng.integers(1 << 30)),
    )


def _frame(rack: Rack, start: float, curve: Curve, rng: np.random.Generator) -> Iterator[Box]:
    x = (start, start + rack.upright_width)
    front = _paint(rack, rack.upright_color, rack.upright_texture, rng)
    for piece in _standing(curve, x, (-rack.upright_depth, 0.0), front):
        yield replace(piece, face_labels={"+z": "upright"})
    rear = _paint(rack, rack.rear_color or rack.upright_color, "plain", rng)
    z = (-rack.depth, -rack.depth + rack.upright_depth)
    yield from _standing(curve, x, z, replace(rear, texture=rack.upright_texture))
    if rack.bracing:
        yield from _bracing(rack, (x[0] + x[1]) / 2, curve, rear, rng)
    if rng.random() < rack.guards:
        yield _guard(rack, x, rng)
    if rng.random() < rack.signs:
        sign = _sign(rack, x, rng)
        yield replace(sign, center=sign.center + np.array([curve.at(sign.center[1]), 0.0, 0.0]))


def _bracing(rack: Rack, x: float, curve: Curve, paint: Material, rng: np.random.Generator) -> Iterator[Box]:
    step = float(rng.uniform(0.7, 1.3))
    z = (-rack.depth + rack.upright_depth, -rack.upright_depth)
    run = z[1] - z[0]
    heights = np.arange(0.25, top_of(rack) - step - 0.05, step)
    for index, y in enumerate(heights):
        slope = np.arctan2(step, run) * (1 if index % 2 else -1)
        turn = np.array([[1, 0, 0], [0, np.cos(slope), -np.sin(slope)], [0, np.sin(slope), np.cos(slope)]])
        at = x + curve.at(y + step / 2)
        yield Box(np.array([at, y + step / 2, sum(z) / 2]), np.array([0.03, 0.03, np.hypot(step, run)]), paint, turn)
        if index == 0:
            yield span((at - 0.015, at + 0.015), (y, y + 0.04), z, paint)


def _level(rack: Rack, bay: Bay, bottom: float, curve: Curve, rng: np.random.Generator) -> Iterator[Box]:
    y = (bottom, bottom + _beam_height(rack, bay))
    front = -rack.setback
    paint = _paint(rack, rack.beam_color, rack.beam_texture, rng)
    for piece in _lying(curve, y, (front - rack.beam_thickness, front), paint):
        yield replace(piece, face_labels={"+z": "beam"})
    rear = _paint(rack, rack.rear_color or rack.beam_color, "plain", rng)
    yield from _lying(curve, y, (-rack.depth, -rack.depth + rack.beam_thickness), rear)
    yield from _deck(rack, y[1], curve, rng)
    for label in _beam_labels(rack, (curve.start, curve.start + curve.length), y, rng):
        yield replace(label, center=label.center + np.array([0.0, curve.at(label.center[0]), 0.0]))


def _deck(rack: Rack, top: float, curve: Curve, rng: np.random.Generator) -> Iterator[Box]:
    if rack.deck == "none":
        yield from _cross_bars(rack, top, curve)
        return
    looks: dict[str, Material] = {
        "steel": Material(rack.deck_color, "scratches", (0.15, 0.15, 0.15), 0.8, 0.3, metallic=rack.metallic),
        "wood": Material((0.45, 0.31, 0.18), "wood", (0.25, 0.16, 0.08), 0.5, 0.6),
        "wire": Material((0.45, 0.46, 0.48), "wire", (0.04, 0.04, 0.04), 0.08, 1.0),
    }
    z = (-rack.depth + rack.beam_thickness, -rack.setback - rack.beam_thickness)
    thickness = 0.02 if rack.deck != "steel" else 0.03
    paint = replace(looks[rack.deck], seed=int(rng.integers(1 << 30)))
    yield from _lying(curve, (top - thickness, top - 0.0005), z, paint)


def _cross_bars(rack: Rack, top: float, curve: Curve) -> Iterator[Box]:
    bar = Material(rack.rear_color or rack.beam_color)
    z = (-rack.depth + rack.beam_thickness, -rack.setback - rack.beam_thickness)
    for middle in np.linspace(curve.start, curve.start + curve.length, 5)[1:-1]:
        at = top + curve.at(middle)
        yield span((middle - 0.02, middle + 0.02), (at - 0.04, at - 0.001), z, bar)


def _supports(rack: Rack, frame: RowFrame) -> Iterator[Support]:
    for number, (bay, start) in enumerate(zip(rack.bays, upright_starts(rack), strict=False)):
        if bay.empty:
            continue
        on_floor = Curve(start + rack.upright_width, bay.width)
        curves = [beam_curve(rack, number, level) for level in range(len(bay.beams))]
        levels = [(y + _beam_height(rack, bay), curve) for y, curve in zip(bay.beams, curves, strict=True)]
        if not bay.beams or bay.beams[0] > 0.4:
            tunnel = not bay.beams or bay.beams[0] > 2.4
            levels = levels if tunnel else [(0.0, on_floor), *levels]
        for top, curve in levels:
            above = [y for y in bay.beams if y > top]
            x = (curve.start + 0.02, curve.start + curve.length - 0.02)
            y = top + max(curve.at(curve.start + curve.length), 0.0)
            yield Support(frame, x, (-rack.depth, 0.0), y, (above[0] if above else top + 1.2) - top)


def _guard(rack: Rack, x: tuple[float, float], rng: np.random.Generator) -> Box:
    """A column guard around the foot of the upright at x."""
    height = float(rng.uniform(0.25, 0.6))
    color: Rgb = (0.75, 0.5, 0.02) if rng.random() < 0.7 else (0.6, 0.08, 0.04)
    stripes = Material(color, "stripes", (0.02, 0.02, 0.02), 0.15, 1.0 if rng.random() < 0.5 else 0.0)
    return span((x[0] - 0.02, x[1] + 0.02), (0.0, height), (-rack.upright_depth - 0.02, 0.03), stripes)


def _sign(rack: Rack, x: tuple[float, float], rng: np.random.Generator) -> Box:
    """A sign stuck on the front of the upright at x; it belongs to the upright's face."""
    bottom = float(rng.uniform(1.3, max(1.4, top_of(rack) * 0.6)))
    color = tuple(float(c) for c in rng.choice([[0.8, 0.8, 0.78], [0.75, 0.55, 0.03], [0.05, 0.15, 0.4]]))
    paper = Material((color[0], color[1], color[2]), "noise", (0.05, 0.05, 0.05), 0.08, 0.4)
    half = float(rng.uniform(0.3, 0.8)) * rack.upright_width / 2
    middle = (x[0] + x[1]) / 2
    return replace(
        span((middle - half, middle + half), (bottom, bottom + float(rng.uniform(0.08, 0.25))), (0.0005, 0.002), paper),
        face_labels={"+z": "upright"},
    )


def _beam_labels(rack: Rack, x: tuple[float, float], y: tuple[float, float], rng: np.random.Generator) -> Iterator[Box]:
    """Labels stuck on the front of the beam that spans x and y; they belong to the beam's face."""
    height = y[1] - y[0]
    paper = Material((0.75, 0.75, 0.73), "noise", (0.05, 0.05, 0.05), 0.05, 0.4)
    z = (-rack.setback + 0.0005, -rack.setback + 0.002)
    for middle in np.arange(x[0] + 0.25, x[1] - 0.2, 0.45):
        if rng.random() < rack.labels:
            at, size = middle + rng.uniform(-0.1, 0.1), rng.uniform(0.3, 0.9) * np.array([0.16, height])
            low = y[0] + rng.uniform(0.02, 0.98) * (height - size[1])
            label = span((at - size[0] / 2, at + size[0] / 2), (low, low + size[1]), z, paper)
            yield replace(label, face_labels={"+z": "beam"})
