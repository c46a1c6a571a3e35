"""Features as arrays: where each upright and beam was seen, as rays and then as tangents on the face plane.

With the rig's attitude known, a ray (X, Y, Z) in the row's axes (x along the aisle, y up, z out of the face) meets the
face at tangents p = X / -Z, q = Y / -Z, in units of the camera's distance from the face. A face point (x, y) seen from
(t_x, t_y, t_z) has p = (x - t_x) / t_z and q = (y - t_y) / t_z, so that everything below is linear (paper, III.D).
"""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from savmap.geometry import pinhole
from savmap.types import Feature, Floats, Ints, RowFacts, ViewSpec

UPRIGHT_PARTS = ("left", "right")
CORNER_PARTS = (("lower left", "upper left"), ("lower right", "upper right"))
MAX_TANGENT = 12.0


@dataclass(frozen=True)
class Pixels:
    """N feature points: frame, view (index into `views`), pixels (N, 2), covariance (N, 2, 2) px^2, score (N,)."""

    frame: Ints
    view: Ints
    pixels: Floats
    covariance: Floats
    score: Floats


@dataclass(frozen=True)
class Tangents:
    """The face-plane tangents p, q (N,) of N points, with their standard deviations."""

    p: Floats
    q: Floats
    sigma_p: Floats
    sigma_q: Floats


@dataclass(frozen=True)
class Catalogue:
    """Which points make an upright or a beam: indices into Pixels, -1 where not seen.

    open_views (frames, views): which views show the face in which frames.
    uprights (n, 2, 2): edge (left, right), end (top, bottom). corners (m, 2, 2): side (left, right), edge (lower, upper).
    bounds (m, 2): sightings of the uprights that a beam ends at (left, right). spans (m, 2): ends of a beam's own edge.
    """

    points: Pixels
    views: tuple[ViewSpec, ...]
    names: tuple[str, ...]
    uprights: Ints
    corners: Ints
    bounds: Ints
    spans: Ints
    upright_frame: Ints
    upright_view: Ints
    beam_frame: Ints
    beam_view: Ints
    edges: Ints
    edge_axis: Ints
    open_views: NDArray[np.bool_]


def catalogue(features: Sequence[Feature], facts: RowFacts) -> Catalogue:
    """Sort features into uprights and beams. Features of other labels, or of unknown views, are left out."""
    views = facts.views
    specs = tuple(views.values())
    number = {name: index for index, name in enumerate(views)}
    own = [f for f in features if f.label in ("upright", "beam") and f.view in number]
    first = np.concatenate([[0], np.cumsum([len(f.pixels) for f in own])]).astype(np.int64)
    uprights, corners, spans, edges = _grouped(own, first, number)
    keys = list(uprights)
    row_of = {key: index for index, key in enumerate(keys)}
    beams = [key for key, rows in corners.items() if (rows[0] >= 0).any()]
    bounds = [[row_of.get((*key[:2], k), -1) for k in corners[key][1]] for key in beams]
    edge_rows = np.array(edges, dtype=np.int64).reshape(-1, 3)
    points = Pixels(
        np.array([f.frame for f in own for _ in f.pixels], dtype=np.int64),
        np.array([number[f.view] for f in own for _ in f.pixels], dtype=np.int64),
        np.concatenate([f.pixels for f in own]) if own else np.zeros((0, 2)),
        np.concatenate([f.covariance for f in own]) if own else np.zeros((0, 2, 2)),
        np.array([f.score for f in own for _ in f.pixels], dtype=np.float64),
    )
    return Catalogue(
        points,
        specs,
        tuple(views),
        np.array([uprights[key] for key in keys], dtype=np.int64).reshape(-1, 2, 2),
        np.array([corners[key][0] for key in beams], dtype=np.int64).reshape(-1, 2, 2),
        np.array(bounds, dtype=np.int64).reshape(-1, 2),
        np.array([spans.get(key, (-1, -1)) for key in beams], dtype=np.int64).reshape(-1, 2),
        np.array([key[0] for key in keys], dtype=np.int64),
        np.array([key[1] for key in keys], dtype=np.int64),
        np.array([key[0] for key in beams], dtype=np.int64),
        np.array([key[1] for key in beams], dtype=np.int64),
        edge_rows[:, :2],
        edge_rows[:, 2],
        _open_views(points, facts),
    )


def _open_views(points: Pixels, facts: RowFacts) -> NDArray[np.bool_]:
    """A view is open in all frames of a pass in which it showed anything."""
    passes = list(dict.fromkeys(facts.frames.passes))
    number = np.array([passes.index(name) for name in facts.frames.passes], dtype=np.int64)
    table = np.zeros((len(passes), len(facts.views)), dtype=np.bool_)
    table[number[points.frame], points.view] = True
    return np.asarray(table[number])


Key = tuple[int, int, int]


def _grouped(
    own: Sequence[Feature], first: Ints, number: Mapping[str, int]
) -> tuple[dict[Key, Ints], dict[Key, tuple[Ints, list[int]]], dict[Key, tuple[int, int]], list[tuple[int, int, int]]]:
    uprights: dict[Key, Ints] = {}
    corners: dict[Key, tuple[Ints, list[int]]] = defaultdict(lambda: (np.full((2, 2), -1, dtype=np.int64), [-1, -1]))
    spans: dict[Key, tuple[int, int]] = {}
    edges: list[tuple[int, int, int]] = []
    place = {part: (side, edge) for side, parts in enumerate(CORNER_PARTS) for edge, part in enumerate(parts)}
    for feature, row in zip(own, first.tolist(), strict=False):
        key = (feature.frame, number[feature.view], feature.instance)
        if len(feature.pixels) == 2:
            edges.append((row, row + 1, 0 if feature.label == "beam" else 1))
        if feature.label == "upright" and feature.part in UPRIGHT_PARTS and len(feature.pixels) == 2:
            rows = uprights.setdefault(key, np.full((2, 2), -1, dtype=np.int64))
            rows[UPRIGHT_PARTS.index(feature.part)] = (row, row + 1)
        elif feature.label == "beam" and len(feature.pixels) == 2:
            spans[key] = (row, row + 1)
        elif feature.label == "beam" and feature.part in place:
            corners[key][0][place[feature.part]] = row
            corners[key][1][:] = [feature.neighbours.get(side, -1) for side in ("left", "right")]
    return {key: rows for key, rows in uprights.items() if (rows >= 0).all()}, dict(corners), spans, edges


def rig_rays(points: Pixels, views: Sequence[ViewSpec]) -> Floats:
    """Unit rays (N, 3) in the rig frame."""
    rays = np.zeros((len(points.frame), 3))
    for index, view in enumerate(views):
        mine = points.view == index
        rays[mine] = view.rig_rays(points.pixels[mine])
    return rays


def tangents(points: Pixels, views: Sequence[ViewSpec], world_from_rig: Floats, across: NDArray[np.bool_]) -> Tangents:
    """Tangents of points for attitudes world_from_rig (n, 3, 3) by frame; nan where a ray does not meet the face.

    Where `across` (N,) is set, the sigma is the one across an edge (the smaller axis of the covariance).
    """
    pixel_rays = np.stack([v.rig_from_view @ np.linalg.inv(v.camera) for v in views])[points.view]
    world_from_pixel = world_from_rig[points.frame] @ pixel_rays
    ray = np.einsum("nij,nj->ni", world_from_pixel, np.column_stack([points.pixels, np.ones(len(points.pixels))]))
    depth = np.where(-ray[:, 2] > 1e-6, -ray[:, 2], np.nan)
    plane = ray[:, :2] / depth[:, None]
    plane[~(np.abs(np.nan_to_num(plane, nan=np.inf)) < MAX_TANGENT).all(axis=1)] = np.nan
    slope = (world_from_pixel[:, :2, :2] + plane[:, :, None] * world_from_pixel[:, 2:, :2]) / depth[:, None, None]
    covariance = np.where(across[:, None, None], _across_only(points.covariance), points.covariance)
    spread = np.einsum("nij,njk,nik->ni", slope, covariance, slope)
    sigma = np.sqrt(np.maximum(spread, 0))
    return Tangents(plane[:, 0], plane[:, 1], sigma[:, 0], sigma[:, 1])


def _across_only(covariance: Floats) -> Floats:
    values, vectors = np.linalg.eigh(covariance)
    normal = vectors[:, :, 0]
    across: Floats = values[:, 0, None, None] * normal[:, :, None] * normal[:, None, :]
    return across


def visible(
    seen: Catalogue, tangent: tuple[Floats, Floats], frame: Ints, world_from_rig: Floats, margin: float
) -> NDArray[np.bool_]:
    """Whether face tangents p, q (N,) lie in a view that is open at `frame` (N,), `margin` of its size inside its border."""
    rays = np.stack([*tangent, -np.ones_like(tangent[0])], axis=1)
    rig = np.einsum("nji,nj->ni", world_from_rig[frame], rays)
    inside = np.zeros(len(frame), dtype=np.bool_)
    for number in np.flatnonzero(seen.open_views.any(axis=0)):
        view = seen.views[number]
        pixel = pinhole.project(rig @ view.rig_from_view, view.camera)
        size = np.array([view.width, view.height])
        within = ((pixel >= margin * size) & (pixel <= (1 - margin) * size)).all(axis=1)
        inside |= within & seen.open_views[frame, number]
    return inside
