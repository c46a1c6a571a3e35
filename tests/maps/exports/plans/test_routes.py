"""The graph of what was driven: joined where paths meet, never taken twice, nothing that was not driven."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from made_up_hall import HOSTILE, hall, row, section, straight, world

from savmap.maps.exports.frames import elements
from savmap.maps.exports.hull import hull
from savmap.maps.exports.plans.footprints import footprints, obstacles
from savmap.maps.exports.plans.routes import RouteGraph, route_graph
from savmap.types import SiteMap


def components(graph: RouteGraph) -> int:
    parent = list(range(len(graph.nodes)))

    def root(node: int) -> int:
        return node if parent[node] == node else root(parent[node])

    for a, b in graph.edges:
        parent[root(a)] = root(b)
    return len({root(node) for node in parent})


def length(graph: RouteGraph) -> float:
    return float(sum(np.linalg.norm(graph.nodes[a] - graph.nodes[b]) for a, b in graph.edges))


def test_drives_along_one_aisle_are_one_and_join_where_they_part() -> None:
    graph = route_graph(hall())
    assert components(graph) == 1
    across = 4.0 + 3.0 - 1.6 + 1.6 - 1.4
    assert length(graph) == pytest.approx(14.0 + across, abs=0.6)
    assert graph.names[0] == "A / 1"
    assert max(np.linalg.norm(graph.nodes[a] - graph.nodes[b]) for a, b in graph.edges) < 3.6


def test_ends_of_rows_are_nodes_to_the_left_and_right() -> None:
    graph = route_graph(hall())
    left, right = graph.ends["A"]
    np.testing.assert_allclose(graph.nodes[left], world(-1.0, 1.5), atol=1e-4)
    np.testing.assert_allclose(graph.nodes[right], world(13.0, 1.5), atol=1e-4)
    assert graph.ends[HOSTILE][0] != graph.ends[HOSTILE][1]


def test_paths_apart_stay_apart_and_gaps_stay_open() -> None:
    gap = np.vstack([straight((0, 1.5), (4, 1.5)), straight((8, 1.5), (12, 1.5))])
    graph = route_graph(SiteMap({"A": row("A", gap)}, {}))
    assert components(graph) == 2
    assert length(graph) == pytest.approx(8.0, abs=1e-3)


def test_a_path_across_another_one_joins_it_in_its_middle() -> None:
    first, second = row("A", straight((0, 1.5), (12, 1.5))), row("B", straight((5.2, -6), (5.2, 6)))
    site = replace(hall(None), rows={"A": first, "B": second})
    graph = route_graph(replace(site, placements={"A": site.placements["A"], "B": site.placements["A"]}))
    assert components(graph) == 1
    degrees = np.bincount(np.array(graph.edges).ravel())
    assert degrees.max() == 4


@pytest.mark.parametrize("shift_m", [0.0, 0.05, 0.07, 0.2, 0.3, 1.0])
def test_no_two_nodes_are_almost_the_same(shift_m: float) -> None:
    own = tuple(section(k, 2.5 * k - 0.63) for k in range(1, 5))
    other = tuple(section(k, 2.5 * k - 0.63 + shift_m) for k in range(1, 4))
    site = hall()
    rows = {
        name: replace(made, structures={"things": parts})
        for (name, made), parts in zip(site.rows.items(), (own, other), strict=True)
    }
    graph = route_graph(replace(site, rows=rows))
    ways = [np.linalg.norm(graph.nodes[a] - graph.nodes[b]) for a, b in graph.edges]
    assert len(graph.stops) == 7
    assert min(ways) >= 0.25
    assert max(ways) <= 3.0 + 1e-3


def test_a_bend_is_followed() -> None:
    bend = np.vstack([straight((0, 1.5), (6, 1.5)), straight((6, 1.5), (6, 7))])
    graph = route_graph(SiteMap({"A": row("A", bend)}, {}))
    path = bend @ np.diag([1.0, -1.0])
    for place in graph.nodes:
        assert np.linalg.norm(path - place, axis=1).min() < 0.15


@pytest.mark.parametrize("apart_m", [0.0, 0.1, 0.4])
def test_out_and_back_along_one_line_is_one_path(apart_m: float) -> None:
    back = straight((12, 1.5 + apart_m), (0, 1.5 + apart_m))
    graph = route_graph(SiteMap({"A": row("A", np.vstack([straight((0, 1.5), (12, 1.5)), back]))}, {}))
    assert components(graph) == 1
    assert length(graph) == pytest.approx(12.0, abs=0.2)
    assert len({frozenset(edge) for edge in graph.edges}) == len(graph.edges)


def test_a_way_around_is_closed() -> None:
    corners = [(0.0, 1.5), (12.0, 1.5), (12.0, 5.5), (0.0, 5.5), (0.0, 1.5)]
    around = np.vstack([straight(*ends) for ends in pairwise(corners)])
    graph = route_graph(SiteMap({"A": row("A", around)}, {}))
    assert components(graph) == 1
    assert length(graph) == pytest.approx(32.0, abs=0.6)
    assert np.bincount(np.array(graph.edges).ravel()).min() == 2


def test_a_map_without_a_path_has_no_graph() -> None:
    graph = route_graph(SiteMap({"A": row("A", np.zeros((0, 2)))}, {}))
    assert (len(graph.nodes), graph.edges, graph.ends) == (0, (), {})


def test_footprints_are_solids_from_above() -> None:
    found = {footprint.name: footprint for footprint in footprints(elements(hall()))}
    post = found["A / post 1"]
    expected = np.array([world(0, 0), world(0.1, 0), world(0.1, -1.0), world(0, -1.0)])
    assert len(post.outline) == 4
    for corner in expected:
        assert np.linalg.norm(post.outline - corner, axis=1).min() < 1e-9
    assert (post.bottom_m, post.top_m) == (pytest.approx(0.5), pytest.approx(5.5))
    np.testing.assert_allclose(post.axis, [world(0.05, -1.0), world(0.05, 0.0)], atol=1e-9)
    low = [footprint.id for footprint in obstacles(hall()) if footprint.row == "A"]
    assert low == ["post 1", "post 2", "bar 1"]


def test_hull_leaves_corners_alone() -> None:
    points = np.array([[0.0, 0], [1, 0], [2, 0], [2, 2], [0, 2], [1, 1], [0, 0]])
    assert hull(points).tolist() == [[0, 0], [2, 0], [2, 2], [0, 2]]
