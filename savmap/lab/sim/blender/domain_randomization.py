"""Colours, materials and shapes for a scene's boxes, so that path-traced pictures do not share the fast simulator's
palette."""

import colorsys
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from savmap.lab.sim.blender.mesh import Part, Shader, Shape
from savmap.lab.sim.blender.style import Color, Rng
from savmap.types.scenes import Box, Material

HELD_OUT_HUES = (0.74, 0.94)
"""Hues (of 0..1: violet to magenta) that no upright and no beam of a training picture has."""

_TRAINING_SHAPES: tuple[Shape, ...] = ("drum", "sack")
_HELD_OUT_SHAPES: tuple[Shape, ...] = ("roll", "tyres", "cone")


def role(box: Box) -> str:
    """What a box is to the painter: structure (labelled steel and the rest of it), paper, lamp, goods, and surfaces."""
    material, (thin, middle, longest) = box.material, np.sort(box.size)
    if material.emission > 0:
        return "lamp"
    if thin < 0.004:
        return "paper" if longest < 1.2 else "surface"
    if material.texture in ("wood", "wire", "stripes"):
        return material.texture
    loose = not box.face_labels and material.seed and material.texture in ("noise", "scratches") and thin > 0.12
    if material.texture == "carton" or loose:
        return "goods"
    return "surface" if middle > 2.5 and not box.face_labels else "structure"


def _rgb(hue: float, saturation: float, value: float) -> Color:
    return colorsys.hsv_to_rgb(hue % 1.0, saturation, value**2.2)


def is_held_out(color: Color) -> bool:
    """Whether a colour is a strong one of the hues that training never sees on structure."""
    hue, saturation, _ = colorsys.rgb_to_hsv(*color)
    return saturation > 0.25 and HELD_OUT_HUES[0] <= hue <= HELD_OUT_HUES[1]


def _training_paint(rng: Rng) -> Color:
    if rng.uniform() < 0.3:
        grey = float(rng.uniform(0.1, 0.9))
        return _rgb(float(rng.uniform(0, 1)), 0.06, grey)
    low, high = HELD_OUT_HUES
    hue = float(high + rng.uniform(0.02, 1 - (high - low) - 0.02))
    return _rgb(hue, float(rng.uniform(0.4, 1)), float(rng.uniform(0.25, 0.95)))


def _held_out_paint(rng: Rng) -> Color:
    hue = float(rng.uniform(HELD_OUT_HUES[0] + 0.02, HELD_OUT_HUES[1] - 0.02))
    return _rgb(hue, float(rng.uniform(0.45, 0.95)), float(rng.uniform(0.35, 0.9)))


def _training_structure(material: Material, rng: Rng) -> Material:
    keep = rng.uniform() < 0.35 and not is_held_out(material.color)
    return replace(
        material,
        color=material.color if keep else _training_paint(rng),
        roughness=float(rng.uniform(0.25, 0.75)),
        metallic=float(rng.uniform(0.4, 0.8)) if rng.uniform() < 0.2 else 0.0,
    )


def _held_out_structure(material: Material, rng: Rng) -> Material:
    striped = rng.uniform() < 0.45
    second = (0.85, 0.85, 0.82) if rng.uniform() < 0.5 else (0.03, 0.03, 0.035)
    return replace(
        material,
        color=_held_out_paint(rng),
        second_color=second,
        texture="stripes" if striped else material.texture,
        scale_m=float(rng.uniform(0.3, 1.5)) if striped else material.scale_m,
        roughness=float(rng.uniform(0.1, 0.9)),
        metallic=float(rng.uniform(0, 0.8)),
    )


def _goods(material: Material, style: int, rng: Rng) -> Material:
    if style == 3:
        color = _rgb(float(rng.uniform(0.2, 0.55)), float(rng.uniform(0.3, 0.9)), float(rng.uniform(0.2, 0.9)))
    elif rng.uniform() < 0.65:
        color = _rgb(float(rng.uniform(0.06, 0.1)), float(rng.uniform(0.3, 0.6)), float(rng.uniform(0.45, 0.85)))
    else:
        color = _rgb(float(rng.uniform(0, 1)), float(rng.uniform(0, 0.9)), float(rng.uniform(0.1, 0.95)))
    second = _rgb(float(rng.uniform(0, 1)), float(rng.uniform(0.2, 1)), float(rng.uniform(0.1, 0.8)))
    return replace(material, color=color, second_color=second, seed=int(rng.integers(1 << 30)))


def _surface(material: Material, style: int, rng: Rng) -> Material:
    if style == 3:
        color = _rgb(float(rng.uniform(0.05, 0.7)), float(rng.uniform(0.1, 0.45)), float(rng.uniform(0.3, 0.8)))
        return replace(material, color=color)
    if rng.uniform() < 0.5:
        return material
    pale = _rgb(float(rng.uniform(0, 1)), float(rng.uniform(0, 0.3)), float(rng.uniform(0.2, 0.9)))
    return replace(material, color=pale)


def _repaint(name: str, material: Material, style: int, labelled: bool, rng: Rng) -> Material:
    """Steel that nothing is to be learnt from looks the same way in look 2, but keeps to dull colours in look 3."""
    if name == "structure" and style == 2:
        return _training_structure(material, rng)
    if name == "structure" and labelled:
        return _held_out_structure(material, rng)
    return _surface(material, style, rng) if name in ("surface", "structure") else material


def _shape(name: str, box: Box, style: int, rng: Rng) -> Shape:
    share = 0.22 if style == 2 else 0.45
    if name != "goods" or rng.uniform() > share or box.size.min() < 0.15:
        return "box"
    shapes = _TRAINING_SHAPES if style == 2 else _HELD_OUT_SHAPES
    return shapes[int(rng.integers(len(shapes)))]


def _shader(name: str, material: Material, shape: Shape, style: int, rng: Rng) -> Shader:
    if name == "goods":
        if style == 3:
            return "checker"
        return "film" if shape == "sack" or rng.uniform() < 0.25 else "carton"
    if name == "surface":
        return "concrete"
    fixed: dict[str, Shader] = {"lamp": "lamp", "paper": "paper", "wood": "wood", "wire": "wire", "stripes": "stripes"}
    return fixed.get(name, "stripes" if material.texture == "stripes" else "paint")


def _own(old: Material, paint: Material) -> Material:
    """A shared paint with what is a box's own: its seed, and its holes' pitch where it keeps them."""
    pitch = old.scale_m if old.texture == "holes" and paint.texture != "stripes" else paint.scale_m
    return replace(paint, seed=old.seed, scale_m=pitch)


def _part(box: Box, name: str, material: Material, style: int, rng: Rng) -> Part:
    shape = _shape(name, box, style, rng)
    return Part(
        box=replace(box, material=material),
        shader=_shader(name, material, shape, style, rng),
        shape=shape,
        tagged=name == "goods" or (name == "structure" and bool(box.face_labels)),
        perforated=box.material.texture == "holes",
    )


def domain_randomization(boxes: Sequence[Box], style: int, rng: Rng) -> list[Part]:
    """Every box with a new material and, for some goods, another shape. What had one colour keeps one colour."""
    drawn: dict[tuple[object, ...], Material] = {}
    labelled = {box.material.color for box in boxes if box.face_labels}
    parts = []
    for box in boxes:
        name, old = role(box), box.material
        key = (name, old.color)
        if key not in drawn:
            drawn[key] = _repaint(name, old, style, old.color in labelled, rng)
        new = _goods(old, style, rng) if name == "goods" else _own(old, drawn[key])
        parts.append(_part(box, name, new, style, rng))
    return parts
