import numpy as np

from savmap.geometry.lines import Lines, crossing, crossing_covariance, where


def exact(slope: list[float], at_zero: list[float], variance: float = 0.01) -> Lines:
    zero = np.zeros(len(slope))
    same = np.full(len(slope), variance)
    return Lines(zero, np.array(slope), np.array(at_zero), zero, same, zero, zero + 100, zero + 100)


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
