"""The edges of strips measured in the panorama, with what is known of racks: where side faces show beside an edge."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from savmap.geometry.lines import Lines, where
from savmap.types import Bools, Floats, Panorama, ViewSpec
from savmap.vision.subpixel import Edges, Subpixel, measured
from savmap_shelves.boundaries.strips import Strips

OUTLINED = Subpixel(prior_px=0.8, flanked_bias_px=0.0, inner=(0.5, 0.15))
"""Edges of found objects are where the evidence of all frames has them, to a part of a pixel."""
ROUNDS = 3
TOLERANCE = 0.01
SAME = 0.4
"""Edges that are nearer to each other than this share of their mask's thickness are one line."""
STANDING_PARTS, LYING_PARTS = 8, 4
"""Of an upright's and of a beam's edge, each measured by itself."""
LEAST_PART_PX = 10.0
Parts = list[tuple[Lines, Floats, Bools]]
"""Of each part: lines (2 g,) of the upper, then the lower edges of g strips, the middle u (2 g,) of the part, and which
could be measured."""
MeasuredParts = tuple[Parts, Parts]
"""Of uprights, and of beams."""
WHOLE = 0.5
"""What is thinner in its mask than this share of what is usual in the picture is hidden in part."""


def measured_strips(panorama: Panorama, spec: ViewSpec, uprights: Strips, beams: Strips) -> tuple[Strips, Strips]:
    """Uprights and beams of a view with their edges as the panorama shows them."""
    axes = _face_axes(spec, uprights, beams)
    edges = [_edges(spec, uprights, axes, True), _edges(spec, beams, axes, False)]
    (standing, _), (lying, seen) = measured(panorama, spec, edges, OUTLINED)
    lying = replace(lying, inliers=np.where(seen, lying.inliers, 0.0))
    return _with_edges(uprights, standing), _with_edges(beams, lying)


def measured_parts(panorama: Panorama, spec: ViewSpec, uprights: Strips, beams: Strips) -> MeasuredParts:
    """The edges of strips, which may lean or be bent, part by part."""
    axes = _face_axes(spec, uprights, beams)
    groups = (uprights, True, STANDING_PARTS), (beams, False, LYING_PARTS)
    standing, lying = (
        [*_followed(panorama, spec, _edges(spec, strips, axes, stands), parts)] for strips, stands, parts in groups
    )
    return standing, lying


def _followed(panorama: Panorama, spec: ViewSpec, edges: Edges, parts: int) -> Iterator[tuple[Lines, Floats, Bools]]:
    """Each part of edges, outwards from the middle, where the part before it leads to."""
    size = (edges.last - edges.first) / parts
    for step in (range(parts // 2 - 1, -1, -1), range(parts // 2, parts)):
        lines = edges.lines
        for number in step:
            first = edges.first + number * size
            part = replace(edges, lines=lines, first=first, last=first + size, wanted=size >= LEAST_PART_PX)
            ((lines, seen),) = measured(panorama, spec, [part], OUTLINED)
            yield lines, part.middle, seen


def _edges(spec: ViewSpec, strips: Strips, axes: Floats, stands: bool) -> Edges:
    """The upper, then the lower edges of strips."""
    both = strips.upper.joined(strips.lower)
    first, last, thickness = np.tile([strips.first, strips.last, strips.thickness], 2)
    middle = (first + last) / 2
    inside = np.repeat([1.0, -1.0], len(strips))
    rays = _rays(spec, middle, both.at(middle), stands) @ axes
    across = rays[:, 0 if stands else 1] / np.maximum(rays[:, 2], 1e-6)
    flank = np.maximum(inside * across, 0.0)
    return Edges(both, first, last, inside, thickness, flank, stands, patterned=stands, wanted=both.inliers > 0)


def _with_edges(strips: Strips, lines: Lines) -> Strips:
    """Strips with measured edges. Where both are the same line, as of a thin strip of which one edge has no contrast, the mask keeps that edge which
    the line is farther from, unless goods hide a part of it. It weighs as measured ones do, so that all frames together tell which of the edges the line is."""
    edged = replace(strips, upper=lines[: len(strips)], lower=lines[len(strips) :])
    middle = (strips.first + strips.last) / 2
    off_upper, off_lower = (
        np.abs(new.at(middle) - old.at(middle))
        for new, old in ((edged.upper, strips.upper), (edged.lower, strips.lower))
    )
    whole = strips.thickness > WHOLE * np.median(strips.thickness) if len(strips) else np.zeros(0, dtype=np.bool_)
    same, is_lower = whole & (edged.thickness < SAME * strips.thickness), off_upper >= off_lower
    upper = where(same & is_lower, strips.upper, edged.upper)
    return replace(edged, upper=upper, lower=where(same & ~is_lower, strips.lower, edged.lower))


def _face_axes(spec: ViewSpec, uprights: Strips, beams: Strips) -> Floats:
    """Rotation (3, 3) of the face in the view, as columns: along the beams to the right, down the uprights, into the face.

    A side face shows on the side that is turned to the point where the camera is straight in front of the face.
    """
    right = _common_direction(spec, beams, False, np.array([1.0, 0.0, 0.0]))
    down = _common_direction(spec, uprights, True, np.array([0.0, 1.0, 0.0]))
    down -= (down @ right) * right
    down /= np.linalg.norm(down)
    return np.stack([right, down, np.cross(right, down)], axis=1)


def _common_direction(spec: ViewSpec, strips: Strips, stands: bool, expected: Floats) -> Floats:
    """The direction (3,) in the view that strips run along: their vanishing point; the expected one for fewer than two."""
    if len(strips) < 2:
        return expected
    normals = _plane_normals(spec, strips.upper.joined(strips.lower), strips, stands)
    weight = np.tile(strips.length, 2)
    for _ in range(ROUNDS):
        direction: Floats = np.linalg.eigh((normals * weight[:, None]).T @ normals)[1][:, 0]
        weight = np.tile(strips.length, 2) / (1 + np.square(normals @ direction / TOLERANCE))
    return direction if direction @ expected > 0 else -direction


def _plane_normals(spec: ViewSpec, lines: Lines, strips: Strips, stands: bool) -> Floats:
    """Unit normals (2 p, 3) of the planes through the camera and the strips' edges."""
    ends = np.tile([strips.first, strips.last], 2)
    first, last = (_rays(spec, u, lines.at(u), stands) for u in ends)
    normals = np.cross(first, last)
    unit: Floats = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    return unit


def _rays(spec: ViewSpec, u: Floats, v: Floats, stands: bool) -> Floats:
    """Rays (n, 3) in the view at depth 1."""
    x, y = (v, u) if stands else (u, v)
    camera = spec.camera
    return np.stack([(x - camera[0, 2]) / camera[0, 0], (y - camera[1, 2]) / camera[1, 1], np.ones_like(x)], axis=-1)
