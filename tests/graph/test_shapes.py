"""Factors of shape: zero on true shapes, and with derivatives that agree with small steps."""

from collections.abc import Callable

import gtsam
import numpy as np
import pytest

from savmap.graph import flat, rectangle
from savmap.types import Floats

RECTANGLE = np.array([[0.0, 0, 0], [0.3, 0, 0.1], [0.3, -0.2, 0.1], [0.0, -0.2, 0]])
TRAPEZIUM = np.array([[0.0, 0, 0], [0.3, 0, 0], [0.4, -0.2, 0], [-0.1, -0.2, 0]])
KEYS = (1, 2, 3, 4)
Shape = Callable[..., gtsam.CustomFactor]


def values_of(points: Floats) -> gtsam.Values:
    values = gtsam.Values()
    for key, point in zip(KEYS, points, strict=True):
        values.insert(key, point)
    return values


def whitened(factor: gtsam.CustomFactor, points: Floats) -> Floats:
    return np.asarray(factor.whitenedError(values_of(points)))


def test_a_rectangle_in_any_attitude_is_one() -> None:
    assert whitened(rectangle(KEYS, 0.01), RECTANGLE) == pytest.approx(np.zeros(4), abs=1e-9)
    assert np.abs(whitened(rectangle(KEYS, 0.01), TRAPEZIUM)).max() > 1


def test_a_trapezium_is_flat_and_a_bent_one_is_not() -> None:
    assert whitened(flat(KEYS, 0.01), TRAPEZIUM) == pytest.approx([0.0], abs=1e-9)
    bent = TRAPEZIUM + np.array([0, 0, 0.04]) * np.array([1, 0, 0, 0])[:, None]
    assert abs(whitened(flat(KEYS, 0.01), bent)[0]) > 1


@pytest.mark.parametrize("shape", [flat, rectangle])
def test_derivatives_agree_with_small_steps(shape: Shape) -> None:
    factor = shape(KEYS, 1.0)
    points = RECTANGLE + np.random.default_rng(3).normal(0, 0.02, (4, 3))
    jacobian = factor.linearize(values_of(points)).jacobian()[0]
    step = 1e-6
    numeric = np.array(
        [
            (whitened(factor, points + step * turned) - whitened(factor, points - step * turned)) / (2 * step)
            for turned in np.eye(12).reshape(12, 4, 3)
        ]
    ).T
    assert jacobian == pytest.approx(numeric, abs=1e-6)
