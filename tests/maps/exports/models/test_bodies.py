"""Solids as closed bodies: they fill the right space, whichever way round their outline is given, and their faces look outwards."""

import numpy as np
import pytest

from savmap.maps.exports.marks import PALETTE, colours, unique
from savmap.maps.exports.models.bodies import Body, body_of
from savmap.types import Floats, Solid

SQUARE = np.array([[0.0, 0, 0], [2, 0, 0], [2, 3, 0], [0, 3, 0]])
CORNER = np.array([[0.0, 0, 0], [2, 0, 0], [2, 1, 0], [1, 1, 0], [1, 3, 0], [0, 3, 0]])
COMB = np.array([[0.0, 0], [5, 0], [5, 3], [4, 3], [4, 1], [3, 1], [3, 3], [2, 3], [2, 1], [1, 1], [1, 3], [0, 3]])


def volume(points: Floats, triangles: Floats) -> float:
    """The volume that triangles enclose; positive if they look outwards."""
    a, b, c = np.moveaxis(points[triangles], 1, 0)
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)


def body(outline: Floats, depth: list[float]) -> Body:
    found = body_of(Solid(outline, np.array(depth), assumed=False))
    assert found is not None
    return found


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("depth", [[0.0, 0, -0.5], [0.0, 0, 0.5], [0.3, 0.1, -0.5]])
@pytest.mark.parametrize(
    ("outline", "area"), [(SQUARE, 6.0), (CORNER, 4.0), (np.column_stack([COMB, np.zeros(12)]), 11.0)]
)
def test_bodies_are_closed_and_look_outwards(outline: Floats, area: float, depth: list[float], turned: bool) -> None:
    whole = body(outline[::-1] if turned else outline, depth)
    edges = {(a, b) for corner in whole.triangles.tolist() for a, b in zip(corner, np.roll(corner, -1), strict=True)}
    assert len(edges) == 3 * len(whole.triangles)
    assert edges == {(b, a) for a, b in edges}
    assert volume(whole.points, whole.triangles) == pytest.approx(0.5 * area)
    points, normals, corners = whole.flat_faces()
    assert volume(points, corners) == pytest.approx(0.5 * area)
    a, b, c = np.moveaxis(points[corners], 1, 0)
    outwards = np.cross(b - a, c - a)
    outwards /= np.linalg.norm(outwards, axis=1, keepdims=True)
    np.testing.assert_allclose(normals[corners[:, 0]], outwards, atol=1e-12)
    np.testing.assert_allclose(whole.normals, outwards_of(whole), atol=1e-12)


def outwards_of(whole: Body) -> Floats:
    a, b, c = np.moveaxis(whole.points[whole.triangles], 1, 0)
    normals = np.cross(b - a, c - a)
    unit: Floats = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    return unit


def test_what_has_no_volume_is_no_body() -> None:
    assert body_of(Solid(SQUARE, np.array([0.5, 0.0, 0.0]), False)) is None
    assert body_of(Solid(np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]]), np.array([0, 0, 1.0]), False)) is None
    assert body_of(Solid(np.zeros((4, 3)), np.array([0, 0, 1.0]), False)) is None


def test_corners_given_twice_count_once() -> None:
    assert len(body(np.repeat(SQUARE, 2, axis=0), [0, 0, 1.0]).outline) == 4


def test_an_outline_that_crosses_itself_is_filled_all_the_same() -> None:
    crossed = np.array([[0.0, 0, 0], [4, 0, 0], [0, 3, 0], [4, 2, 0]])
    found = body_of(Solid(crossed, np.array([0, 0, 1.0]), False))
    assert found is None or len(found.filling) == 2


def test_names_are_given_once() -> None:
    assert unique(["a", "a", "a_2", "a", "A"]) == ["a", "a_2", "a_2_2", "a_3", "A"]
    assert unique(["a", "A"], str.casefold) == ["a", "A_2"]
    assert unique(["a", "a", "a (2)"], form="{} ({})") == ["a", "a (2)", "a (2) (2)"]


def test_labels_have_colours_of_their_own() -> None:
    assert len(set(colours("abcdefgh").values())) == 8
    assert colours("ba") == {"a": PALETTE[0], "b": PALETTE[1]}
