"""Distances in a map, and how sure they are."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from savmap.errors import SiteError
from savmap.maps.distance import vertex_distance
from savmap.types import FrameTable, JointCovariance, Placement, RowMap, SiteMap, Structure, Trajectory

COMMON, OWN = 0.05**2, 0.001**2


def row(name: str, joint: bool = True) -> RowMap:
    """Two posts 3 m apart, whose places share an error of 5 cm and have one of 1 mm each."""
    posts = tuple(post(number) for number in (1, 2))
    numbers: Mapping[str, Mapping[str, np.ndarray]] = {
        "posts": {f"post {k + 1}": np.array([[k, -1, -1]]) for k in range(2)}
    }
    together = JointCovariance(numbers, COMMON + OWN * np.eye(2)) if joint else None
    path = Trajectory(np.arange(1), np.eye(4)[None])
    return RowMap(name, FrameTable(np.zeros(1), ("pass 1",)), {}, path, {"posts": posts}, (), joint=together)


def post(number: int) -> Structure:
    place = np.array([[3.0 * number, 1.0, 0.0]])
    covariance = np.diag([COMMON + OWN, OWN, OWN])[None]
    return Structure(f"post {number}", "post", place, covariance, (f"post {number} / top",), np.zeros((0, 2), np.int64))


def test_what_both_ends_share_does_not_count() -> None:
    found = vertex_distance(SiteMap({"A": row("A")}, {}), "post 1 / top", "Post 2 / top")
    assert (found.length_m, found.remark) == (3.0, "")
    assert found.sigma_m == pytest.approx((2 * OWN) ** 0.5)
    assert str(found).startswith("3.000 m +- 1.4 mm (x 3.000 m")


def test_map_without_a_joint_covariance_says_so() -> None:
    found = vertex_distance(SiteMap({"A": row("A", joint=False)}, {}), "post 1 / top", "post 2 / top")
    assert found.sigma_m == pytest.approx((2 * (COMMON + OWN)) ** 0.5)
    assert "both share count twice" in str(found)


def test_rows_are_told_apart_and_need_a_common_frame() -> None:
    site = SiteMap({name: row(name) for name in "AB"}, {})
    with pytest.raises(SiteError, match="is in rows A, B: put the row before it, such as `A: post 1 / top`"):
        vertex_distance(site, "post 1 / top", "B: post 2 / top")
    with pytest.raises(SiteError, match="row A has no place"):
        vertex_distance(site, "A: post 1 / top", "B: post 2 / top")
    with pytest.raises(SiteError, match="nearest: post"):
        vertex_distance(site, "A: post / top", "B: post 2 / top")
    with pytest.raises(SiteError, match="`A: post 1` is no vertex of the map; nearest: post 1"):
        vertex_distance(site, "A: post 1", "B: post 2 / top")
    placed = {"A": Placement(0, 0, 0, np.zeros((3, 3))), "B": Placement(0, -4.0, 0, np.zeros((3, 3)))}
    found = vertex_distance(SiteMap(site.rows, {}, placements=placed), "A: post 1 / top", "B: post 2 / top")
    assert found.length_m == pytest.approx(5.0)
    assert "taken for independent" in str(found)


@pytest.mark.parametrize("joint", [True, False])
def test_vertex_is_where_it_is(joint: bool) -> None:
    found = vertex_distance(SiteMap({"A": row("A", joint)}, {}), "post 1 / top", "post 1 / top")
    assert (found.length_m, found.sigma_m) == (0.0, 0.0)


def test_what_nothing_measured_is_said() -> None:
    whole = row("A")
    guess = np.diag([COMMON + OWN, 0.05**2, OWN])[None]
    posts = tuple(replace(own, covariances=guess) for own in whole.structures["posts"])
    site = SiteMap({"A": replace(whole, structures={"posts": (posts[0], whole.structures["posts"][1])})}, {})
    found = str(vertex_distance(site, "post 1 / top", "post 2 / top"))
    assert "y 0.000 m +- 50.0 mm" in found
    assert found.endswith("; y of `post 1 / top` was not measured, it is assumed to +- 50 mm")
    both = str(
        vertex_distance(SiteMap({"A": replace(whole, structures={"posts": posts})}, {}), "post 1 / top", "post 2 / top")
    )
    assert both.count("was not measured") == 2


def test_an_edge_as_site_files_call_it_is_measured_from() -> None:
    own = row("A")
    labels = ("left / bottom", "left / top", "right / bottom", "right / top")
    corners = np.array([[x, y, 0.0] for x in (0.0, 0.1) for y in (0.0, 5.0)])
    posts = tuple(
        Structure(
            f"post {number}",
            "post",
            corners + np.array([3.0 * number, 0, 0]),
            np.tile(OWN * np.eye(3), (4, 1, 1)),
            tuple(f"post {number} / {label}" for label in labels),
            np.zeros((0, 2), np.int64),
        )
        for number in (1, 2)
    )
    site = SiteMap({"A": replace(own, structures={"posts": posts}, joint=None)}, {})
    assert vertex_distance(site, "post 1 / left", "A: Post 2 / right").difference_m.tolist() == pytest.approx(
        [3.1, 0.0, 0.0]
    )
    with pytest.raises(SiteError, match="`post 1` is no vertex"):
        vertex_distance(site, "post 1", "post 2 / right")


def test_a_vertex_is_called_by_its_structure_too() -> None:
    """Lamps and the scaffold's structures label their vertices alike: the answer sent the user in a circle."""
    own = row("A")
    lamps = tuple(
        replace(lamp, id=f"light {number}", vertex_labels=("end 0",))
        for number, lamp in enumerate(own.structures["posts"], 1)
    )
    site = SiteMap({"A": replace(own, structures={"lights": lamps}, joint=None)}, {})
    assert vertex_distance(site, "light 1 / end 0", "A: Light 2 / end 0").length_m == 3.0
    with pytest.raises(SiteError, match="`end 0` is no vertex of the map; nearest: light 1 / end 0; light 2 / end 0"):
        vertex_distance(site, "end 0", "light 2 / end 0")
    both = SiteMap({"A": replace(own, structures={"lights": lamps, "lamps": lamps}, joint=None)}, {})
    with pytest.raises(SiteError, match=r"in plugins A: lamps, A: lights: put .* such as `A: lights: light 1 / end 0`"):
        vertex_distance(both, "light 1 / end 0", "light 2 / end 0")
    assert vertex_distance(both, "lamps: light 1 / end 0", "A: lights: light 2 / end 0").length_m == 3.0


def test_what_no_second_reference_checks_is_said() -> None:
    """A length that is 20 cm too long stretches what lies between, and moves both ends alike where they are one place."""
    own = row("A")
    assert own.joint is not None
    wrong = replace(own, joint=replace(own.joint, hidden=np.array([[0.1, 0.3], [0.5, 0.5]])))
    found = vertex_distance(SiteMap({"A": wrong}, {}), "post 1 / top", "post 2 / top")
    assert str(found).endswith("; not checked by a second reference: an error of 200 mm would stay hidden")
    small = replace(own, joint=replace(own.joint, hidden=np.array([[0.1, 0.101]])))
    assert vertex_distance(SiteMap({"A": small}, {}), "post 1 / top", "post 2 / top").remark == ""
