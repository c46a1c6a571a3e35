"""Strips of which no frame showed an end: as long as the others."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from savmap.plugin import Floats, Structure

FEWEST, MOST = 4, 0.75
"""Strips of one length: so many at least, and this share of them."""
ALIKE, ALIKE_M = 0.01, 0.02
"""How far lengths differ that are one, as a share and m."""
ENDS = ("end 0", "end 1")
OPEN = tuple((end,) for end in ENDS)
"""The vertices of strips, and of those of which one end is measured."""


def with_open_ends(lamps: Sequence[Structure]) -> list[Structure]:
    """The lamps; strips with one end get the other at the length of most, if these have one, else they are left out."""
    span = common_span([lamp for lamp in lamps if lamp.vertex_labels == ENDS])
    return [
        _opened(lamp, span) if lamp.vertex_labels in OPEN and span is not None else lamp
        for lamp in lamps
        if lamp.vertex_labels not in OPEN or span is not None
    ]


def common_span(strips: Sequence[Structure]) -> Floats | None:
    """From the first end to the second (3,) m of most strips, of one length within a centimetre or two; None where
    their lengths differ, or they are few."""
    spans = np.array([strip.vertices[1] - strip.vertices[0] for strip in strips]).reshape(-1, 3)
    if len(spans) < FEWEST:
        return None
    lengths = np.linalg.norm(spans, axis=1)
    usual = float(np.median(lengths))
    alike = np.abs(lengths - usual) < ALIKE * usual + ALIKE_M
    return np.median(spans[alike], axis=0) if alike.sum() >= FEWEST and alike.mean() >= MOST else None


def _opened(lamp: Structure, span: Floats) -> Structure:
    """A strip with both ends, of which one is measured."""
    measured = ENDS.index(lamp.vertex_labels[0])
    other = lamp.vertices[0] + (span if measured == 0 else -span)
    order = [0, 1] if measured == 0 else [1, 0]
    covariances = np.stack([lamp.covariances[0], lamp.covariances[0] + ALIKE_M**2 * np.eye(3)])
    return replace(
        lamp,
        vertices=np.stack([lamp.vertices[0], other])[order],
        covariances=covariances[order],
        vertex_labels=ENDS,
        edges=np.array([[0, 1]], np.int64),
        attributes={**lamp.attributes, "end not seen": ENDS[1 - measured]},
    )
