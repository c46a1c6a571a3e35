"""Stripes for the simulator: magenta paint on the floor."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from savmap.lab.scenes import Box, Material, SceneParts, Site
from savmap.plugin import Floats, hookimpl


class StripesLab:
    """What `savmap simulate` asks."""

    @hookimpl
    def scene(self, section: Mapping[str, Any], site: Site) -> SceneParts:
        """`stripes: {rectangles: [[x from, x to, z from, z to], ...]}`, m in the scene's frame."""
        spans = section["rectangles"]
        outlines = np.array([[[a, 0, c], [b, 0, c], [b, 0, d], [a, 0, d]] for a, b, c, d in spans], dtype=np.float64)
        mapped = {name: frame for name, frame in site.frames.items() if frame.mapped}
        survey = {name: {"stripes": frame.to_row(outlines).tolist()} for name, frame in mapped.items()}
        return SceneParts([painted(outline) for outline in outlines], survey)


def painted(outline: Floats) -> Box:
    """A layer of paint, 2 mm thick, over a rectangle (4, 3) m of the floor."""
    low, high = outline.min(axis=0), outline.max(axis=0)
    return Box((low + high) / 2, high - low + [0, 0.004, 0], Material((0.75, 0.01, 0.5)), face_labels={"+y": "stripe"})
