"""The clear space between beams, as structures for the comparison of two dates."""

import numpy as np
from perfect_maps import structures_of, surveyed_row

from savmap.maps.comparison import compare_maps
from savmap.types import FrameTable, RowMap, SiteMap, Structure, Trajectory
from savmap_shelves.report.openings import openings


def site_of(structures: list[Structure]) -> SiteMap:
    path = Trajectory(np.zeros(0, int), np.zeros((0, 4, 4)))
    return SiteMap({"A": RowMap("A", FrameTable(np.zeros(0), ()), {}, path, {"shelves": tuple(structures)}, ())}, {})


def test_each_opening_is_the_space_between_two_beams() -> None:
    found = {one.id: one for one in openings(structures_of(surveyed_row()))}
    low, high = found["section 1 / opening 1"].vertices.min(axis=0), found["section 1 / opening 1"].vertices.max(axis=0)
    np.testing.assert_allclose((low, high), ([0.1, 0.4, 0], [3.7, 1.2, 0]))
    assert found["section 1 / opening 1"].attributes == {"section": 1, "level": 1}
    bridge = found["section 3 / opening 0"]
    assert bridge.vertices[:, 1].min() == 0
    assert bridge.vertices[:, 1].max() == 4.2


def test_spaces_too_low_for_goods_are_none() -> None:
    row = surveyed_row()
    row["sections"][0]["beams"][1] = [0.6, 0.7]
    names = {one.id for one in openings(structures_of(row)) if one.id.startswith("section 1 ")}
    assert "section 1 / opening 1" not in names
    assert "section 1 / opening 2" in names


def test_a_raised_beam_changes_the_openings_beside_it() -> None:
    row = surveyed_row()
    old = structures_of(row)
    row["sections"][1]["beams"][2] = [2.33, 2.43]
    new = structures_of(row)
    rng = np.random.default_rng(1)
    new = [
        Structure(
            one.id,
            one.label,
            one.vertices + rng.normal(0, 0.001, 3),
            one.covariances,
            one.vertex_labels,
            one.edges,
            one.attributes,
        )
        for one in new
    ]
    found = compare_maps(
        site_of(old), site_of(new), ({"A": {"shelves": openings(old)}}, {"A": {"shelves": openings(new)}})
    )
    changed = {one.name: one.significant[0] for one in found.rows[0].openings if one.state != "same"}
    assert {name: round(one.difference_m or 0, 2) for name, one in changed.items()} == {
        "section 2 / opening 2": 0.08,
        "section 2 / opening 3": -0.08,
    }
    assert {one.what for one in changed.values()} == {"size y"}
