"""What hangs and stands on a simulated rack: column guards, signs, labels on beams. In the row's frame."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from savmap.lab.scenes import Box, Material, Rgb, span
from savmap_shelves.lab.rack import Rack, top_of


def guard(rack: Rack, x: tuple[float, float], rng: np.random.Generator) -> Box:
    """A column guard around the foot of the upright at x."""
    height = float(rng.uniform(0.25, 0.6))
    color: Rgb = (0.75, 0.5, 0.02) if rng.random() < 0.7 else (0.6, 0.08, 0.04)
    stripes = Material(color, "stripes", (0.02, 0.02, 0.02), 0.15, 1.0 if rng.random() < 0.5 else 0.0)
    return span((x[0] - 0.02, x[1] + 0.02), (0.0, height), (-rack.upright_depth - 0.02, 0.03), stripes)


def sign(rack: Rack, x: tuple[float, float], rng: np.random.Generator) -> Box:
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


def beam_labels(rack: Rack, x: tuple[float, float], y: tuple[float, float], rng: np.random.Generator) -> Iterator[Box]:
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
