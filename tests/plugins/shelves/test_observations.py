"""Observations without pixels: exact where nothing is spoilt, and spoilt as often as asked for."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from savmap.lab.sim.drive.cart import Drive, drive
from savmap.lab.sim.observations import MaskErrors, ObservedEdge
from savmap.lab.sim.scene.build import Built, build
from savmap.lab.sim.scene.files import Cart, Scene, parse_scene
from savmap.types import ViewSpec
from savmap_shelves.lab.observed import Truth, observe, strips

VIEW = ViewSpec("face", yaw_deg=-90.0, hfov_deg=120.0)
EXACT = MaskErrors(sigma_px=0.0)
BAYS = [{"width": 2.0, "beams": [0.2, 1.2, 2.2]}, {"width": 1.5, "beams": [1.8, 2.4]}]


def small_scene(**changes: Any) -> Scene:
    """Two bays with a tunnel, a row across and a row behind."""
    content: dict[str, Any] = {
        "seed": 3,
        "hall": {"x": [-3.0, 7.0], "z": [-4.0, 5.0], "height": 4.5},
        "rows": {
            "A": {"x": 0.0, "z": 0.0},
            "B": {"x": 3.8, "z": 2.4, "facing": "-z"},
            "C": {"x": 3.8, "z": -2.3, "facing": "-z", "mapped": False},
        },
        "structures": {"shelves": {"rows": {name: {"bays": BAYS, "height": 3.0, "setback": 0.005} for name in "ABC"}}},
    }
    return parse_scene({**content, **changes})


@pytest.fixture(scope="module")
def scene_with() -> Callable[..., Scene]:
    return small_scene


@pytest.fixture(scope="module")
def built() -> Built:
    return build(small_scene())


@pytest.fixture(scope="module")
def path() -> Drive:
    return drive(Cart(start=(0.5, 1.2), end=(3.0, 1.2), height=1.5, frames=60), 3)


def all_edges(built: Built, path: Drive, errors: MaskErrors) -> list[ObservedEdge]:
    return [edge for frame in observe(built, "A", path, VIEW, errors, 1) for edge in frame]


def masks(edges: list[ObservedEdge]) -> dict[tuple[int, int], list[ObservedEdge]]:
    found: dict[tuple[int, int], list[ObservedEdge]] = {}
    for edge in edges:
        found.setdefault((edge.frame, edge.instance), []).append(edge)
    return found


def test_strips_count_sections_and_levels(built: Built) -> None:
    truths = [strip.truth for strip in strips(built, "A")]
    assert truths[:3] == [Truth("upright", number) for number in range(3)]
    assert truths[3:] == [Truth("beam", 0, k) for k in range(3)] + [Truth("beam", 1, k) for k in range(2)]


@pytest.mark.parametrize("row", ["A", "B"])
def test_exact_edges_lie_on_the_planes_through_the_structures(built: Built, path: Drive, row: str) -> None:
    spec = VIEW if row == "A" else ViewSpec("face", yaw_deg=90.0, hfov_deg=120.0)
    edges_of = {strip.truth: strip.edges for strip in strips(built, row)}
    frame = built.frames[row]
    count = 0
    for index, edges in enumerate(observe(built, row, path, spec, EXACT, 1)):
        camera = frame.to_row(path.origins[index])
        row_from_rig = frame.world_from_row.T @ path.world_from_rig[index]
        for edge in edges:
            assert edge.truth is not None
            ends = edges_of[edge.truth][0 if edge.side in ("left", "lower") else 1]
            normal = np.cross(*(ends - camera))
            off = spec.rig_rays(edge.pixels) @ row_from_rig.T @ (normal / np.linalg.norm(normal))
            np.testing.assert_allclose(off, 0, atol=1e-9)
            assert (edge.pixels >= -0.5 - 1e-6).all()
            assert (edge.pixels <= [639.5 + 1e-6, 479.5 + 1e-6]).all()
            count += 1
    assert count > 500


def test_errors_come_at_the_rates_set(built: Built, path: Drive) -> None:
    clean = len(masks(all_edges(built, path, EXACT)))
    missed = len(masks(all_edges(built, path, MaskErrors(0.0, missed=0.3))))
    assert missed / clean == pytest.approx(0.7, abs=0.08)
    doubled = len(masks(all_edges(built, path, MaskErrors(0.0, duplicated=0.2))))
    assert doubled / clean == pytest.approx(1.2, abs=0.06)
    strange = all_edges(built, path, MaskErrors(0.0, outliers=0.25))
    assert sum(edge.truth is None for edge in strange) / 2 / clean == pytest.approx(0.25, abs=0.07)


def test_incomplete_masks_are_shorter_and_wide_ones_wider(built: Built, path: Drive) -> None:
    exact = all_edges(built, path, EXACT)
    shorter = all_edges(built, path, MaskErrors(0.0, incomplete=1.0))
    lengths = np.array(
        [[np.linalg.norm(np.diff(e.pixels, axis=0)) for e in pair] for pair in zip(exact, shorter, strict=True)]
    )
    assert 0.4 - 1e-9 <= (lengths[:, 1] / lengths[:, 0]).min() <= (lengths[:, 1] / lengths[:, 0]).max() <= 0.9 + 1e-9
    wider = masks(all_edges(built, path, MaskErrors(0.0, wide=1.0, wide_px=5.0)))
    grown = [breadth(pair) - breadth(masks(exact)[key]) for key, pair in wider.items()][:40]
    assert 1.0 < np.min(grown) <= np.max(grown) < 10.5


def breadth(pair: list[ObservedEdge]) -> float:
    return float(np.linalg.norm(pair[1].pixels.mean(0) - pair[0].pixels.mean(0)))


def test_noise_has_its_sigma_and_its_seed(built: Built, path: Drive) -> None:
    exact, noisy = all_edges(built, path, EXACT), all_edges(built, path, MaskErrors(sigma_px=0.7))
    off = np.array([b.pixels - a.pixels for a, b in zip(exact, noisy, strict=True)])
    assert off.std() == pytest.approx(0.7, rel=0.1)
    again = all_edges(built, path, MaskErrors(sigma_px=0.7))
    np.testing.assert_array_equal([e.pixels for e in noisy], [e.pixels for e in again])


def test_a_view_away_from_the_row_sees_nothing(built: Built, path: Drive) -> None:
    away = ViewSpec("away", yaw_deg=90.0, hfov_deg=90.0)
    assert not any(list(observe(built, "A", path, away, EXACT, 1)))


def test_a_drive_without_disturbance_is_straight(scene_with: Callable[..., Scene]) -> None:
    cart = Cart(start=(0, 1), end=(4, 1), frames=9, sway=0, weave=0, bounce=0, tilt=0, speed_variation=0)
    path = drive(cart, 1)
    np.testing.assert_allclose(path.origins, [[0.5 * k, 3.0, 1.0] for k in range(9)], atol=1e-12)
    np.testing.assert_allclose(path.world_from_rig, np.tile([[0, 0, 1], [0, -1, 0], [1, 0, 0]], (9, 1, 1)), atol=1e-12)
    uneven = drive(cart.model_copy(update={"speed_variation": 0.5}), 1).origins[:, 0]
    assert (np.diff(uneven) > 0).all()
    assert np.ptp(np.diff(uneven)) > 0.05
    assert build(scene_with()).aisle_z == (0.0, 2.4)
