"""The world's frame of exports: z up, aligned, with the covariance of where the site stands."""

from dataclasses import replace

import numpy as np
import pytest

from savmap.errors import OutputError
from savmap.maps.exports.frames import drives, elements, only_row, world_from_row, world_from_site
from savmap.types import Alignment, FrameTable, Placement, RowMap, SiteMap, Solid, Structure, Trajectory


def row(name: str) -> RowMap:
    ring = np.array([[0.0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0]])
    solid = Solid(ring, np.array([0.0, 0, -0.5]), assumed=True, ifc_class="IfcBeam")
    edges = np.array([[0, 1], [1, 2], [2, 3], [3, 0]])
    thing = Structure("bar 1", "bar", ring, np.tile(1e-4 * np.eye(3), (4, 1, 1)), tuple("abcd"), edges, {}, solid)
    poses = np.tile(np.eye(4), (2, 1, 1))
    poses[:, :3, 3] = [[0, 3, 1.5], [1, 3, 1.5]]
    table = FrameTable(np.arange(3.0), ("pass 1", "pass 1", "pass 2"))
    return RowMap(name, table, {}, Trajectory(np.array([0, 2]), poses), {"things": (thing,)}, ())


def test_world_has_z_up_and_solids_move_along() -> None:
    (element,) = elements(SiteMap({"A": row("A")}, {}))
    assert element.row == "A"
    np.testing.assert_allclose(element.structure.vertices, [[0, 0, 0], [2, 0, 0], [2, 0, 1], [0, 0, 1]], atol=1e-12)
    assert element.structure.solid is not None
    np.testing.assert_allclose(element.structure.solid.outline, element.structure.vertices, atol=1e-12)
    np.testing.assert_allclose(element.structure.solid.depth, [0, 0.5, 0], atol=1e-12)


def test_alignment_turns_and_moves_and_adds_its_covariance() -> None:
    covariance = np.diag([0.01**2, 0.02**2, 0.1**2])
    site = SiteMap({"A": row("A")}, {}, alignment=Alignment(10.0, 20.0, 90.0, covariance, z_m=1.0))
    (element,) = elements(site)
    np.testing.assert_allclose(element.structure.vertices[2], [10, 22, 2], atol=1e-9)
    turned = (2 * np.deg2rad(0.1)) ** 2
    expected = np.diag([1e-4 + 0.01**2 + turned, 1e-4 + 0.02**2, 1e-4])
    np.testing.assert_allclose(element.structure.covariances[2], expected, atol=1e-12)


def test_drive_has_the_located_frames() -> None:
    (drive,) = drives(SiteMap({"A": row("A")}, {}))
    assert drive.frames.tolist() == [0, 2]
    assert drive.passes == ("pass 1", "pass 2")
    np.testing.assert_allclose(drive.world_from_rig[:, :3, 3], [[0, -1.5, 3], [1, -1.5, 3]], atol=1e-12)


def test_rows_without_a_common_frame_are_refused() -> None:
    with pytest.raises(OutputError, match="rows B have no place"):
        elements(SiteMap({"A": row("A"), "B": row("B")}, {}, placements={"A": Placement(0, 0, 0, np.eye(3))}))


def test_a_row_without_a_place_is_not_put_into_the_world() -> None:
    aligned = Alignment(10.0, 20.0, 90.0, np.zeros((3, 3)), z_m=1.0)
    placed = {"A": Placement(0, 0, 0, np.zeros((3, 3)))}
    site = SiteMap({"A": row("A"), "B": row("B")}, {}, placements=placed, alignment=aligned)
    alone, note = only_row(site, "B")
    assert alone.alignment is None
    assert "row B has no place in the site's frame" in note
    kept = replace(site, rows={"B": site.rows["B"]})
    for one in (alone, kept):
        np.testing.assert_allclose(elements(one)[0].structure.vertices[2], [2, 0, 1], atol=1e-12)
        np.testing.assert_allclose(world_from_row(one, "B"), world_from_site(None), atol=1e-12)
    assert (only_row(site, "A")[0].alignment, only_row(site, "A")[1]) == (aligned, "")
    beside = SiteMap({"B": row("B")}, {}, failed={"A": "dark"}, alignment=aligned)
    assert only_row(beside, "B")[0].alignment is None
    assert only_row(replace(beside, failed={}), "B")[0].alignment is aligned
