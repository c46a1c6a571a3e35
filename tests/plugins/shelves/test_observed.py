"""Features from simulated masks: corners where beams meet uprights."""

from collections.abc import Sequence

import numpy as np
import pytest

from savmap.geometry.pinhole import project
from savmap.lab.sim.drive.cart import Drive, drive
from savmap.lab.sim.observations import PAPER, MaskErrors, ObservedEdge
from savmap.lab.sim.scene.build import Built, build
from savmap.lab.sim.scene.files import parse_scene
from savmap.types import Feature, ViewSpec
from savmap_shelves.lab.observed import Truth, observe, observed_features, strips

VIEW = ViewSpec("shelf", yaw_deg=-90.0, hfov_deg=130.0)


@pytest.fixture(scope="module")
def row() -> tuple[Built, Drive]:
    """Two bays of three beams, driven past without disturbance."""
    bays = [{"width": 2.0, "beams": [0.2, 1.2, 2.2]}] * 2
    cart = {"start": [0.5, 1.2], "end": [3.5, 1.2], "height": 1.5, "frames": 12, "sway": 0, "weave": 0, "tilt": 0}
    scene = parse_scene(
        {
            "hall": {"x": [-3.0, 7.0], "z": [-4.0, 5.0], "height": 4.5},
            "goods": {"density": 0.0},
            "cart": cart,
            "rows": {"A": {"x": 0.0, "z": 0.0}},
            "structures": {"shelves": {"rows": {"A": {"bays": bays, "height": 3.0, "setback": 0.0}}}},
        }
    )
    return build(scene), drive(scene.cart, 3)


def seen(row: tuple[Built, Drive], errors: MaskErrors) -> list[list[ObservedEdge]]:
    return list(observe(row[0], "A", row[1], VIEW, errors, 1))


def corners(features: Sequence[Feature]) -> list[Feature]:
    return [feature for feature in features if feature.label == "beam" and len(feature.pixels) == 1]


def test_exact_masks_give_exact_corners(row: tuple[Built, Drive]) -> None:
    built, path = row
    edges_of = {strip.truth: strip.edges for strip in strips(built, "A")}
    bottom = edges_of[Truth("beam", 0, 1)][0]
    found = 0
    for index, edges in enumerate(seen(row, MaskErrors(0.0))):
        turn = path.world_from_rig[index] @ VIEW.rig_from_view
        pixel = project((bottom[1] - path.origins[index]) @ turn, VIEW.camera)
        own = [f for f in corners(observed_features(edges, VIEW)) if f.part == "lower right"]
        found += any(np.abs(f.pixels[0] - pixel).max() < 1e-6 for f in own)
    assert found >= 6


def test_features_have_the_object_that_they_are_of(row: tuple[Built, Drive]) -> None:
    built, path = row
    edges_of = {strip.truth.object: strip.edges for strip in strips(built, "A") if isinstance(strip.truth, Truth)}
    assert [*edges_of] == [
        *(f"upright {n}" for n in range(1, 4)),
        *(f"bay {bay} / beam {n}" for bay in (1, 2) for n in (1, 2, 3)),
    ]
    found = set[str]()
    for index, edges in enumerate(seen(row, MaskErrors(0.5, missed=0.1, duplicated=0.3, outliers=0.3))):
        turn = path.world_from_rig[index] @ VIEW.rig_from_view
        for feature in corners(observed_features(edges, VIEW)):
            corner = edges_of[feature.object][int("upper" in feature.part), int("right" in feature.part)]
            pixel = project((corner - path.origins[index]) @ turn, VIEW.camera)
            assert abs(feature.pixels[0, 1] - pixel[1]) < 5.0
            found.add(feature.object)
    assert found == {name for name in edges_of if "beam" in name}


def test_duplicates_are_left_out(row: tuple[Built, Drive]) -> None:
    clean = sum(len(observed_features(edges, VIEW)) for edges in seen(row, MaskErrors(0.0)))
    doubled = sum(len(observed_features(edges, VIEW)) for edges in seen(row, MaskErrors(0.0, duplicated=1.0)))
    assert doubled == clean


def test_biased_masks_are_wider_by_twice_the_bias(row: tuple[Built, Drive]) -> None:
    exact, biased = (seen(row, MaskErrors(0.0, bias_px=bias)) for bias in (0.0, 1.5))
    for before, after in zip((e for f in exact for e in f), (e for f in biased for e in f), strict=True):
        moved = after.pixels - before.pixels
        np.testing.assert_allclose(np.linalg.norm(moved, axis=1), 1.5, atol=1e-9)
        outwards = {"left": [-1, 0], "right": [1, 0], "upper": [0, -1], "lower": [0, 1]}[after.side]
        assert (moved @ np.array(outwards) > 0).all()


def test_drift_stays_for_some_frames(row: tuple[Built, Drive]) -> None:
    path = drive(row[0].scene.cart.model_copy(update={"frames": 200}), 3)
    exact, moved = (
        [e for f in observe(row[0], "A", path, VIEW, errors, 1) for e in f if e.truth == Truth("beam", 0, 1)]
        for errors in (MaskErrors(0.0), MaskErrors(0.0, drift_px=1.0, drift_frames=5.0))
    )
    lower = [b.pixels[0, 1] - a.pixels[0, 1] for a, b in zip(exact, moved, strict=True) if a.side == "lower"]
    rate = np.corrcoef(lower[:-1], lower[1:])[0, 1]
    assert 0.6 < rate < 0.95
    assert PAPER.bias_px > 1
