"""Structures of a map as outlines, and the planes that they lie in."""

from dataclasses import replace

import numpy as np
import pytest

from savmap.lab.adapt.faces import Outline, faces_of, outlines_of, ring
from savmap.types import Structure

from .filmed_wall import BOXES, CLASSES, RING, quad


def test_corners_follow_the_ring() -> None:
    assert ring(RING, 4) in ([0, 1, 3, 2], [0, 2, 3, 1])
    assert ring(RING[:3], 4) is None
    assert ring(np.array([[0, 1], [1, 2], [2, 0], [3, 4], [4, 5], [5, 3]]), 6) is None


def test_other_labels_have_no_outline() -> None:
    assert [one.label for one in outlines_of([quad("post 1"), quad("plank 1")], ("plank",))] == ["plank"]


def test_face_ends_where_the_map_does() -> None:
    (face,) = faces_of(outlines_of([quad(name) for name in BOXES], CLASSES))
    ends = face.patch.points()[[0, -1, -1], [0, 0, -1]]
    assert np.allclose(np.abs(ends[:, 0]), 1.0, atol=face.patch.cell)
    assert np.allclose(sorted(ends[:, 1]), [0.0, 0.0, 1.5], atol=face.patch.cell)
    assert 0.015 < face.patch.cell < 0.025


def test_cells_lie_where_the_patch_has_them() -> None:
    (face,) = faces_of(outlines_of([quad(name) for name in BOXES], CLASSES))
    rows, columns = face.patch.shape
    cells = face.cells(face.patch.points())
    assert np.allclose(cells[..., 0], np.arange(columns))
    assert np.allclose(cells[..., 1], np.arange(rows)[:, None])


def test_what_stands_apart_has_its_own_face() -> None:
    apart = quad("plank 1", z=-1.0)
    faces = faces_of(outlines_of([quad("post 1"), quad("post 2"), apart], CLASSES))
    assert sorted(len(face.outlines) for face in faces) == [1, 2]


def test_only_the_less_sure_sides_are_unsure() -> None:
    end = replace(quad("post 1"), covariances=quad("post 1").covariances.copy())
    covariances = end.covariances.copy()
    covariances[2:, 1, 1] = 0.05**2
    high = replace(end, covariances=covariances)
    first, *others = outlines_of([high, quad("post 2"), quad("plank 1")], CLASSES)
    top = int(np.argmax(first.corners[:, 1] + np.roll(first.corners[:, 1], -1)))
    assert np.isclose(first.unsure_m[top], 2 * (0.05 - 0.001))
    assert np.allclose(np.delete(first.unsure_m, top), 0.0)
    assert all(np.allclose(other.unsure_m, 0.0) for other in others)


def test_unsure_is_at_most_a_quarter() -> None:
    unsure = [one.unsure_m for one in outlines_of([quad("post 1", 1.0), quad("post 2"), quad("plank 1")], CLASSES)]
    assert np.allclose(sorted(unsure[0]), [0.025, 0.025, 0.375, 0.375])


def posts(*widths_m: float) -> list[Outline]:
    """The outlines of posts of some widths, side by side."""
    return outlines_of([post(number, width) for number, width in enumerate(widths_m)], CLASSES)


def post(number: int, width_m: float) -> Structure:
    one = quad("post 1")
    corners = one.vertices.copy()
    corners[[1, 3], 0] = corners[[0, 2], 0] + width_m
    return replace(one, id=f"post {number}", vertices=corners + np.array([number, 0.0, 0.0]))


def test_sides_of_an_odd_thickness_are_unsure() -> None:
    *alike, odd = posts(0.100, 0.101, 0.099, 0.100, 0.150)
    assert all(np.allclose(one.unsure_m, 0.0) for one in alike)
    assert np.allclose(sorted(odd.unsure_m), [0.0, 0.0, 0.075, 0.075])


def test_what_is_too_thick_does_not_become_usual() -> None:
    """Half of the sides are another thing's edge, each another: the median would call the thick ones usual."""
    *right, thick, thicker, thickest = posts(0.0571, 0.0573, 0.0572, 0.0660, 0.0747, 0.1057)
    assert all(np.allclose(one.unsure_m, 0.0) for one in right)
    assert all(one.unsure_m.max() > 0.03 for one in (thick, thicker, thickest))


def test_thicknesses_that_all_differ_teach_their_middles() -> None:
    widths = (0.046, 0.062, 0.069, 0.038, 0.044)
    unsure = [one.unsure_m.max() for one in posts(*widths)]
    assert np.allclose(unsure, [width / 3 for width in widths])


def test_what_is_doubted_is_unsure_all_over() -> None:
    sure = [post(number, 0.1) for number in range(3)]
    outlines = outlines_of(sure, CLASSES, {"post 1"})
    assert [float(one.unsure_m.max()) for one in outlines] == pytest.approx([0.0, 0.1, 0.0])
