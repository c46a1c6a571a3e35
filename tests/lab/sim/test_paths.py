"""Drives through several aisles: corners, speeds, stops, going in reverse, and what is true about the passes."""

from typing import Any

import numpy as np
import pytest

from savmap.lab.scenes import SceneError
from savmap.lab.sim.drive.cart import course, drive
from savmap.lab.sim.drive.passes import true_passes
from savmap.lab.sim.scene.build import build
from savmap.lab.sim.scene.files import Cart, Scene, parse_scene
from savmap.lab.sim.simulate import references, site_of

BAYS = [{"width": 2.0, "beams": [0.2, 1.2]}, {"width": 2.0, "beams": [0.2, 1.2]}]


def two_aisles(points: list[list[float]], **path: Any) -> Scene:
    """Rows A and B on either side of an aisle, row C along the next one; all 4.3 m long."""
    return parse_scene(
        {
            "hall": {"x": [-5, 9], "z": [-3, 12], "height": 4},
            "cart": {"path": {"points": points, "radius": 1.0, **path}, "height": 1.5, "fps": 10, "sway": 0},
            "rows": {"A": {}, "B": {"x": 4.3, "z": 2.4, "facing": "-z"}, "C": {"z": 4.4}},
            "structures": {"shelves": {"rows": {name: {"bays": BAYS, "height": 2.5} for name in "ABC"}}},
        }
    )


def settings(points: list[tuple[float, float]], **path: Any) -> Cart:
    return Cart.model_validate({"path": {"points": points, **path}, "speed_variation": 0, "fps": 20})


def test_a_corner_is_an_arc_that_the_cart_takes_slowly() -> None:
    one = course(settings([(0, 0), (6, 0), (6, 6)], radius=1.5, speed=1.2, turn_speed=0.5), np.random.default_rng(1))
    moves = np.linalg.norm(np.diff(one.ground, axis=0), axis=1) * 20
    center = np.linalg.norm(one.ground - [4.5, 1.5], axis=1)
    corner = (one.ground[:, 0] > 4.5) & (one.ground[:, 1] < 1.5)
    np.testing.assert_allclose(center[corner], 1.5, atol=0.02)
    assert moves.max() == pytest.approx(1.2, abs=0.01)
    assert moves[corner[1:]].max() < 0.52
    assert np.abs(np.diff(moves[3:-3])).max() < 0.6 / 20 + 0.01
    np.testing.assert_allclose(one.facing[-1], [0, 1], atol=0.01)
    np.testing.assert_allclose(one.ground[-1], [6, 6], atol=0.1)


def test_a_stop_takes_its_time_and_turning_back_is_in_reverse() -> None:
    plain = course(settings([(0, 0), (5, 0), (1, 0)]), np.random.default_rng(1))
    waited = course(settings([(0, 0), (5, 0), (1, 0)], stops=[(2.0, 4.0)]), np.random.default_rng(1))
    still = np.linalg.norm(np.diff(waited.ground, axis=0), axis=1) < 1e-3
    assert still.sum() / 20 == pytest.approx(4.0, abs=0.3)
    assert waited.stamps_s[-1] > plain.stamps_s[-1] + 4.0
    np.testing.assert_allclose(plain.facing, np.tile([1.0, 0.0], (len(plain.facing), 1)), atol=1e-9)
    assert plain.ground[:, 0].max() == pytest.approx(5.0, abs=0.02)
    assert plain.ground[-1, 0] == pytest.approx(1.0, abs=0.1)


def test_passes_are_where_the_camera_is_alongside() -> None:
    built = build(two_aisles([[-2, 1.2], [7, 1.2], [7, 5.8], [-2, 5.8]], stops=[[4.0, 3.0]]))
    path = drive(built.scene.cart, 1)
    first, second = true_passes(built, path)
    x = np.interp([first.start_s, first.end_s, second.start_s, second.end_s], path.stamps_s, path.origins[:, 0])
    np.testing.assert_allclose(x, [0, 4.3, 4.3, 0], atol=0.15)
    assert (first.left, first.right) == (("A",), ("B",))
    assert (second.left, second.right) == ((), ("C",))
    assert (first.travel_deg, abs(second.travel_deg)) == pytest.approx((0, 180), abs=1)
    rows = site_of(built, references(built, path), [first, second])["rows"]
    assert [(name, row["passes"][0]["side"]) for name, row in rows.items()] == [("A", "left"), ("B", "right"), ("C", "right")]  # fmt: skip
    assert rows["C"]["passes"][0]["start_s"] == round(second.start_s, 2)


def test_going_back_is_another_pass() -> None:
    built = build(two_aisles([[-2, 1.2], [3.5, 1.2], [-2, 1.2]]))
    first, second = true_passes(built, drive(built.scene.cart, 1))
    assert (first.left, second.left) == (("A",), ("B",))
    assert first.end_s < second.start_s < first.end_s + 1


def test_points_of_a_path_are_apart() -> None:
    with pytest.raises(SceneError, match=r"at least 0\.1 m apart"):
        two_aisles([[0, 0], [0, 0]])
