"""Features as arrays: where each upright and beam was sighted, as pixels and then as tangents on the face plane.

With the rig's attitude known, a ray (X, Y, Z) in the row's axes (x along the aisle, y up, z out of the face) meets the
face at tangents p = X / -Z, q = Y / -Z, in units of the camera's distance from the face. A face point (x, y) seen from
(t_x, t_y, t_z) has p = (x - t_x) / t_z and q = (y - t_y) / t_z, so that everything below is linear (paper, III.D).
"""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from savmap.types import Bools, Feature, Floats, Ints, RowFacts, ViewSpec

UPRIGHT_PARTS = ("left", "right")
CORNER_PARTS = (("lower left", "upper left"), ("lower right", "upper right"))
MAX_TANGENT = 12.0
Key = tuple[int, int, int]


@dataclass(frozen=True, eq=False)
class FeaturePoints:
    """N feature points: frame, view (index into `views`), pixels (N, 2), covariance (N, 2, 2) px^2."""

    frame: Ints
    view: Ints
    pixels: Floats
    covariance: Floats


@dataclass(frozen=True, eq=False)
class Tangents:
    """The face-plane tangents p, q (N,) of N points, with the standard deviation of p."""

    p: Floats
    q: Floats
    sigma_p: Floats


@dataclass(frozen=True, eq=False)
class Sightings:
    """Which points make an upright or a beam: indices into FeaturePoints, -1 where a point is missing.

    uprights (n, 2, 2): edge (left, right), end (top, bottom). corners (m, 2, 2): side (left, right), edge (lower, upper).
    bounds (m, 2): sightings of the uprights that a beam ends at (left, right).
    edges (e, 2): both ends of each edge.
    """

    points: FeaturePoints
    views: tuple[ViewSpec, ...]
    uprights: Ints
    corners: Ints
    bounds: Ints
    upright_frame: Ints
    upright_view: Ints
    beam_frame: Ints
    edges: Ints


@dataclass(frozen=True, eq=False)
class FaceSightings(Sightings):
    """Sightings with the attitudes world_from_rig (n, 3, 3) of the frames, and the points' tangents that follow."""

    world_from_rig: Floats
    face: Tangents

    def horizon(self) -> Floats:
        """Tangents p (n, 2) of the uprights' edges (left, right) at q = 0."""
        p, q = self.face.p[self.uprights], self.face.q[self.uprights]
        rise = q[:, :, 1] - q[:, :, 0]
        lean = (p[:, :, 1] - p[:, :, 0]) / np.where(np.abs(rise) > 1e-3, rise, np.nan)
        return p[:, :, 0] - lean * q[:, :, 0]

    def upright_spacing(self) -> float:
        """The median distance between neighbouring uprights of a frame, as a tangent; nan where no frame shows two."""
        centre = self.horizon().mean(axis=1)
        order = np.lexsort((centre, self.upright_view, self.upright_frame))
        same = (np.diff(self.upright_frame[order]) == 0) & (np.diff(self.upright_view[order]) == 0)
        gaps = np.diff(centre[order])[same]
        gaps = gaps[np.isfinite(gaps) & (gaps > 0.2)]
        return float(np.median(gaps)) if len(gaps) else float("nan")


def on_face(sightings: Sightings, world_from_rig: Floats) -> FaceSightings:
    """Sightings on the face plane, for attitudes world_from_rig (n, 3, 3) of the frames."""
    across = np.zeros(len(sightings.points.frame), dtype=np.bool_)
    across[sightings.edges.ravel()] = True
    face = tangents(sightings.points, sightings.views, world_from_rig, across)
    return FaceSightings(**vars(sightings), world_from_rig=world_from_rig, face=face)


def collect_sightings(features: Sequence[Feature], facts: RowFacts) -> Sightings:
    """Sort features into uprights and beams. Features of other labels, or of unknown views, are left out."""
    names = tuple(facts.views)
    of_face = [f for f in features if f.label in ("upright", "beam") and f.view in names]
    points = feature_points(of_face, names)
    first = np.concatenate([[0], np.cumsum([len(f.pixels) for f in of_face])]).astype(np.int64)
    keys = [(f.frame, names.index(f.view), f.instance) for f in of_face]
    edges = [(row, row + 1) for f, row in zip(of_face, first, strict=False) if len(f.pixels) == 2]
    uprights = _uprights(of_face, keys, first)
    corners, neighbours = _beams(of_face, keys, first)
    row_of = {key: index for index, key in enumerate(uprights)}
    bounds = [[row_of.get((*key[:2], number), -1) for number in neighbours[key]] for key in corners]
    upright_keys, beam_keys = (np.array([*group], dtype=np.int64).reshape(-1, 3) for group in (uprights, corners))
    return Sightings(
        points,
        tuple(facts.views.values()),
        np.array([*uprights.values()], dtype=np.int64).reshape(-1, 2, 2),
        np.array([*corners.values()], dtype=np.int64).reshape(-1, 2, 2),
        np.array(bounds, dtype=np.int64).reshape(-1, 2),
        upright_keys[:, 0],
        upright_keys[:, 1],
        beam_keys[:, 0],
        np.array(edges, dtype=np.int64).reshape(-1, 2),
    )


def feature_points(features: Sequence[Feature], views: Sequence[str]) -> FeaturePoints:
    """The points of features, one after the other."""
    return FeaturePoints(
        np.array([f.frame for f in features for _ in f.pixels], dtype=np.int64),
        np.array([views.index(f.view) for f in features for _ in f.pixels], dtype=np.int64),
        np.concatenate([np.zeros((0, 2)), *(f.pixels for f in features)]),
        np.concatenate([np.zeros((0, 2, 2)), *(f.covariance for f in features)]),
    )


def _uprights(features: Sequence[Feature], keys: Sequence[Key], first: Ints) -> Mapping[Key, Ints]:
    """Point indices (2, 2) of the uprights of which both edges were sighted. Keys are frame, view, instance."""
    uprights: dict[Key, Ints] = defaultdict(lambda: np.full((2, 2), -1, dtype=np.int64))
    for feature, key, row in zip(features, keys, first.tolist(), strict=False):
        if feature.label == "upright" and feature.part in UPRIGHT_PARTS and len(feature.pixels) == 2:
            uprights[key][UPRIGHT_PARTS.index(feature.part)] = (row, row + 1)
    return {key: rows for key, rows in uprights.items() if (rows >= 0).all()}


def _beams(
    features: Sequence[Feature], keys: Sequence[Key], first: Ints
) -> tuple[Mapping[Key, Ints], Mapping[Key, list[int]]]:
    """Of beams with a corner: point indices (2, 2) of the corners, and the uprights that they end at."""
    corners: dict[Key, Ints] = defaultdict(lambda: np.full((2, 2), -1, dtype=np.int64))
    neighbours: dict[Key, list[int]] = {}
    place = {part: (side, edge) for side, parts in enumerate(CORNER_PARTS) for edge, part in enumerate(parts)}
    for feature, key, row in zip(features, keys, first.tolist(), strict=False):
        if feature.label == "beam" and feature.part in place:
            corners[key][place[feature.part]] = row
            neighbours[key] = [feature.neighbours.get(side, -1) for side in ("left", "right")]
    return {key: rows for key, rows in corners.items() if (rows >= 0).any()}, neighbours


def tangents(points: FeaturePoints, views: Sequence[ViewSpec], world_from_rig: Floats, across: Bools) -> Tangents:
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
    spread = np.einsum("nj,njk,nk->n", slope[:, 0], covariance, slope[:, 0])
    return Tangents(plane[:, 0], plane[:, 1], np.sqrt(np.maximum(spread, 0)))


def _across_only(covariance: Floats) -> Floats:
    values, vectors = np.linalg.eigh(covariance)
    normal = vectors[:, :, 0]
    across: Floats = values[:, 0, None, None] * normal[:, :, None] * normal[:, None, :]
    return across
