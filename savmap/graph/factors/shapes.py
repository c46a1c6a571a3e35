"""Shapes of four points in any attitude, which no relation of coordinates expresses: flat, a rectangle, a square."""

from collections.abc import Callable, Sequence
from functools import partial

import gtsam
import numpy as np

from savmap.types import Floats

Errors = Callable[[Floats], Floats]
Slopes = Callable[[Floats], Floats]
Span = tuple[tuple[int, int], tuple[int, int]]
TINY_M = 1e-9
DIAGONALS: Span = ((0, 2), (1, 3))
SIDES: Span = ((0, 1), (1, 2))


def flat(corners: Sequence[int], sigma_m: float) -> gtsam.CustomFactor:
    """Four points, in order around, lie in a plane: the least distance between the two diagonals' lines is 0 +-
    `sigma_m`."""
    return _factor(corners, sigma_m, _gap, _gap_slopes, 1)


def rectangle(corners: Sequence[int], sigma_m: float) -> gtsam.CustomFactor:
    """Four points, in order around, are a rectangle of any size: opposite sides alike (3 equations), the diagonals as
    long as one another."""
    return _with_equal_spans(corners, sigma_m, [DIAGONALS])


def square(corners: Sequence[int], sigma_m: float) -> gtsam.CustomFactor:
    """Four points, in order around, are a square of any size: a rectangle, and two neighbouring sides alike (5
    equations)."""
    return _with_equal_spans(corners, sigma_m, [DIAGONALS, SIDES])


def graph_of(factors: Sequence[gtsam.NonlinearFactor]) -> gtsam.NonlinearFactorGraph:
    """Factors as a graph, as `Constraints` takes them."""
    graph = gtsam.NonlinearFactorGraph()
    for factor in factors:
        graph.push_back(factor)
    return graph


def _with_equal_spans(corners: Sequence[int], sigma_m: float, equal: Sequence[Span]) -> gtsam.CustomFactor:
    errors, slopes = partial(_parallelogram, equal=equal), partial(_parallelogram_slopes, equal=equal)
    return _factor(corners, sigma_m, errors, slopes, 3 + len(equal))


def _factor(corners: Sequence[int], sigma_m: float, errors: Errors, slopes: Slopes, count: int) -> gtsam.CustomFactor:
    def error(_: object, values: gtsam.Values, jacobians: list[Floats] | None) -> Floats:
        points = np.array([values.atPoint3(key) for key in corners])
        if jacobians is not None:
            for number, slope in enumerate(np.moveaxis(slopes(points), 1, 0)):
                jacobians[number] = np.asfortranarray(slope)
        return errors(points)

    return gtsam.CustomFactor(gtsam.noiseModel.Isotropic.Sigma(count, sigma_m), list(corners), error)


def _gap(points: Floats) -> Floats:
    normal = _normal(points)
    return np.array([normal @ (points[1] - points[0])])


def _normal(points: Floats) -> Floats:
    across = np.cross(points[2] - points[0], points[3] - points[1])
    normal: Floats = across / max(float(np.linalg.norm(across)), TINY_M)
    return normal


def _gap_slopes(points: Floats) -> Floats:
    """Derivatives (1, 4, 3) of the gap by the corners: of the nearest points, each moved by its diagonal's ends."""
    normal = _normal(points)
    first, second = points[2] - points[0], points[3] - points[1]
    start = points[1] - points[0]
    system = np.stack([first, -second, normal], axis=1)
    along = np.linalg.solve(system, start)[:2] if abs(np.linalg.det(system)) > TINY_M else np.array([0.5, 0.5])
    s, t = float(along[0]), float(along[1])
    return np.array([-(1 - s), 1 - t, -s, t])[None, :, None] * normal


def _parallelogram(points: Floats, equal: Sequence[Span]) -> Floats:
    """Errors (3 + n,): opposite sides alike, then the lengths of n pairs of spans alike."""
    a, b, c, d = points
    lengths = [_length(points, first) - _length(points, second) for first, second in equal]
    return np.array([*(a - b + c - d), *lengths])


def _length(points: Floats, ends: tuple[int, int]) -> float:
    return float(np.linalg.norm(points[ends[1]] - points[ends[0]]))


def _parallelogram_slopes(points: Floats, equal: Sequence[Span]) -> Floats:
    """Derivatives (3 + n, 4, 3) of the errors by the corners."""
    slopes = np.zeros((3 + len(equal), 4, 3))
    slopes[:3] = np.array([1.0, -1.0, 1.0, -1.0])[:, None] * np.eye(3)[:, None]
    for row, spans in enumerate(equal, 3):
        for (first, last), way in zip(spans, (1.0, -1.0), strict=True):
            span = points[last] - points[first]
            along = way * span / max(float(np.linalg.norm(span)), TINY_M)
            slopes[row, last] += along
            slopes[row, first] -= along
    return slopes
