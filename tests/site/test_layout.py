"""Where rows stand: one by one, and at regular spacing."""

from typing import Any

import numpy as np
import pytest

from savmap.errors import SiteError
from savmap.site.layout import placements
from savmap.site.model import Site

LAYOUT = {"aisle_m": 3.0, "rack_m": 2.2, "length_m": 14.0}


def site(names: str, layout: dict[str, Any] | None = None, places: dict[str, Any] | None = None) -> Site:
    rows = {name: {"passes": [{"video": "a.mp4"}], "place": (places or {}).get(name)} for name in names}
    return Site.model_validate({"rows": rows, "layout": layout})


def stands(found: Site, name: str) -> tuple[float, float, float]:
    one = placements(found)[name]
    return pytest.approx((one.x_m, one.z_m, one.heading_deg))


def test_rows_without_a_place_have_none() -> None:
    assert placements(site("AB", places={"B": {"x_m": 1, "z_m": 2, "heading_deg": 90}})).keys() == {"B"}


def test_a_place_is_taken_as_given_with_its_sigmas() -> None:
    place = {"x_m": 1.0, "z_m": 2.0, "heading_deg": 270.0, "sigma_m": 0.1}
    found = placements(site("A", places={"A": place}))["A"]
    assert (found.x_m, found.z_m, found.heading_deg) == (1.0, 2.0, -90.0)
    np.testing.assert_allclose(found.covariance, np.diag([0.01, 0.01, 4.0]))


def test_faces_look_at_one_another_across_the_aisle() -> None:
    found = site("ABCD", LAYOUT)
    assert stands(found, "A") == (0.0, 0.0, 0.0)
    assert stands(found, "B") == (14.0, 3.0, 180.0)
    assert stands(found, "C") == (0.0, 5.2, 0.0)
    assert stands(found, "D") == (14.0, 8.2, 180.0)
    first, second = (placements(found)[name].site_from_row for name in "AB")
    np.testing.assert_allclose(first[:3, 2], -second[:3, 2], atol=1e-12)
    gap = (np.linalg.inv(first) @ second @ [0, 0, 0, 1])[2]
    assert gap == pytest.approx(3.0)  # B stands where A looks
    np.testing.assert_allclose(second @ [14.0, 0, 0, 1], [0, 0, 3.0, 1], atol=1e-12)


def test_a_layout_may_begin_with_a_rack_and_leave_faces_out() -> None:
    found = site("ABC", {**LAYOUT, "begins_with": "rack", "rows": ["C", None, "A"], "lengths_m": {"C": 10}})
    assert stands(found, "C") == (10.0, 0.0, 180.0)
    assert stands(found, "A") == (14.0, 5.2, 180.0)
    assert "B" not in placements(found)


def test_a_turned_layout() -> None:
    found = site("AB", {**LAYOUT, "x_m": 100, "z_m": 50, "heading_deg": 90})
    assert stands(found, "A") == (100.0, 50.0, 90.0)
    # at heading 90 the rows run towards -z, and face +x
    assert stands(found, "B") == (103.0, 36.0, -90.0)


def test_a_rows_own_place_wins_and_keeps_its_turn_in_the_layout() -> None:
    found = site("ABC", {"aisle_m": 3, "rack_m": 2}, {"B": {"x_m": 9, "z_m": 9, "heading_deg": 180}})
    assert stands(found, "B") == (9.0, 9.0, 180.0)
    assert stands(found, "C") == (0.0, 5.0, 0.0)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"length_m": None}, "layout: row `B` is turned round"),
        ({"rows": ["A", "X"]}, "layout.rows.1: there is no row `X`; the site's rows are A, B"),
        ({"rows": ["A", "A"]}, "layout.rows: row `A` is given twice"),
        ({"lengths_m": {"X": 3}}, "layout.lengths_m.X: there is no row `X`"),
    ],
)
def test_a_layout_that_does_not_fit_is_refused(change: dict[str, Any], words: str) -> None:
    with pytest.raises(SiteError) as caught:
        placements(site("AB", {**LAYOUT, **change}))
    assert str(caught.value).startswith(words)
