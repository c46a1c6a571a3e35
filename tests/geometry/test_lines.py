import numpy as np
import pytest

from savmap.geometry.lines import Lines, crossing, crossing_covariance, robust_lines, where


def points(
    slope: float, at_zero: float, count: int = 120, noise: float = 0.0, seed: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    u = np.linspace(100, 400, count)
    return u, at_zero + slope * u + np.random.default_rng(seed).normal(0, noise, count)


def line_of(u: np.ndarray, v: np.ndarray) -> Lines:
    return robust_lines(np.zeros(len(u), dtype=np.int64), u, v, 1, 1.0)


def exact(slope: list[float], at_zero: list[float], variance: float = 0.01) -> Lines:
    zero = np.zeros(len(slope))
    same = np.full(len(slope), variance)
    return Lines(zero, np.array(slope), np.array(at_zero), zero, same, zero, zero + 100, zero + 100)


def test_line_without_outliers_is_the_least_squares_line() -> None:
    u, v = points(0.12, 40.0, noise=0.05)
    line = line_of(u, v)
    slope, at_zero = np.linalg.lstsq(np.stack([u, np.ones_like(u)], -1), v, rcond=None)[0]
    assert line.slope[0] == pytest.approx(slope, abs=2e-5)
    assert line.at_zero[0] == pytest.approx(at_zero, abs=5e-3)
    assert line.inliers[0] == len(u)


@pytest.mark.parametrize("step", [-6.0, 2.5, 30.0])
def test_a_step_in_four_tenths_of_the_length_moves_nothing(step: float) -> None:
    u, v = points(-0.08, 200.0, noise=0.1)
    v[:48] += step
    line = line_of(u, v)
    assert line.at(np.array([100.0, 400.0])) == pytest.approx([192.0, 168.0], abs=0.15)
    assert line.first[0] > 200


def test_groups_do_not_mix_whatever_their_order() -> None:
    first, second = points(0.1, 10.0), points(-0.2, 300.0, count=40)
    group = np.repeat([1, 0], [120, 40])
    order = np.random.default_rng(1).permutation(160)
    u, v = (np.concatenate(pair)[order] for pair in zip(first, second, strict=True))
    lines = robust_lines(group[order], u, v, 2, 1.0)
    np.testing.assert_allclose(lines.slope, [-0.2, 0.1], atol=1e-9)
    np.testing.assert_allclose(lines.at_zero, [300.0, 10.0], atol=1e-6)


def test_a_group_without_points_is_no_line() -> None:
    u, v = points(0.1, 10.0)
    lines = robust_lines(np.full(len(u), 1, dtype=np.int64), u, v, 3, 1.0)
    assert np.isnan(lines.slope).tolist() == [True, False, True]
    assert lines.inliers.tolist() == [0, 120, 0]
    for count in (0, 2):
        lines = robust_lines(np.zeros(0, dtype=np.int64), *np.zeros((2, 0)), count, 1.0)
        assert np.isnan(lines.slope).all()
        assert lines.inliers.tolist() == [0] * count


@pytest.mark.parametrize("length", [1, 25])
def test_variances_are_honest_also_for_errors_that_go_together(length: int) -> None:
    rng = np.random.default_rng(2)
    u = np.arange(300.0)
    window = np.ones(length) / np.sqrt(length)
    squares = []
    for _ in range(200):
        v = 0.3 * np.convolve(rng.normal(size=300 + length - 1), window, "valid")
        line = line_of(u, v)
        squares.append([line.at(at)[0] ** 2 / line.variance_at(at)[0] for at in (150.0, 300.0, 450.0)])
    medians = np.median(squares, axis=0) / 0.455
    assert (medians > 0.5).all()
    assert (medians < 2.5).all(), "chi-square with one degree of freedom has median 0.455"


def test_lines_cross_where_both_say_so() -> None:
    level, upright = exact([0.1, -0.2], [50.0, 90.0]), exact([0.05, -0.1], [300.0, 500.0])
    at = crossing(level, upright)
    np.testing.assert_allclose(level.at(at[:, 0]), at[:, 1])
    np.testing.assert_allclose(upright.at(at[:, 1]), at[:, 0])


def test_the_covariance_of_a_crossing_comes_from_both_lines() -> None:
    level, upright = exact([0.1], [50.0], variance=0.04), exact([0.05], [300.0], variance=0.25)
    at = crossing(level, upright)
    spread = []
    rng = np.random.default_rng(3)
    for _ in range(4000):
        moved = exact([0.1], [50.0 + rng.normal(0, 0.2)]), exact([0.05], [300.0 + rng.normal(0, 0.5)])
        spread.append(crossing(*moved)[0])
    np.testing.assert_allclose(
        crossing_covariance(level, upright, at, 0.0)[0], np.cov(np.transpose(spread)), atol=0.015
    )
    floored = crossing_covariance(exact([0.0], [50.0]), exact([0.0], [300.0]), at, 0.3)
    np.testing.assert_allclose(floored[0], 0.09 * np.eye(2), atol=1e-12)


def test_where_picks_line_by_line() -> None:
    picked = where(np.array([True, False]), exact([0.1, 0.2], [1.0, 2.0]), exact([0.3, 0.4], [3.0, 4.0]))
    assert picked.slope.tolist() == [0.1, 0.4]
    assert picked.offset.tolist() == [1.0, 4.0]
