"""What the network is trained on: places in looks that networks are poor at, as many as mapping sees of them."""

import numpy as np
import pytest

from savmap.lab.plugins import lab_plugin
from savmap.lab.sim.random_scene import random_scene
from savmap.lab.sim.scene.files import Scene
from savmap.lab.train.made.pictures import practice_kinds
from savmap_shelves.lab.looks import dark_scene, dim_scene, grey_scene, pale_scene
from savmap_shelves.lab.practice import KINDS


def colours(scene: Scene) -> np.ndarray:
    """Of uprights, beams and goods (n, 3)."""
    racks = scene.structures["shelves"]["rows"].values()
    found = [rack[f"{part}_color"] for rack in racks for part in ("upright", "beam")]
    return np.array([*found, *scene.goods.colors])


def test_faces_are_a_half_and_looks_a_third_each() -> None:
    lab = lab_plugin("shelves")
    assert lab is not None
    assert practice_kinds("shelves", lab.network_classes) == KINDS
    total = sum(kind.share for kind in KINDS.values()) / 0.8  # labelled photographs are a fifth of all
    faces = {name: kind.share / total for name, kind in KINDS.items() if name != "painted"}
    assert sum(faces.values()) == pytest.approx(0.5)
    dark = sum(share for name, share in faces.items() if name.split("-")[1] in {"dark", "dim"})
    assert dark == pytest.approx(0.5 / 3)
    assert {name for name, kind in KINDS.items() if kind.held_out} == {
        "face-random",
        "face-grey",
        "face-dark",
        "painted",
    }


@pytest.mark.parametrize("seed", range(3))
def test_looks_are_what_they_are_called(seed: int) -> None:
    plain = random_scene(seed)
    assert np.ptp(colours(pale_scene(seed))) < 0.5 * max(np.ptp(colours(plain)), 0.9)
    assert colours(dark_scene(seed)).max() < 0.2
    assert dim_scene(seed).look.exposure <= 0.5 * plain.look.exposure
    grey = next(iter(grey_scene(seed).structures["shelves"]["rows"].values()))
    assert len(set(grey["beam_color"])) == 1
    for low in (pale_scene(seed), dim_scene(seed)):
        bays = [bay for rack in low.structures["shelves"]["rows"].values() for bay in rack["bays"]]
        assert sum(bay["beams"][0] < 0.15 for bay in bays if bay["beams"]) > len(bays) / 4
        assert all(np.all(np.diff(bay["beams"]) > 0) for bay in bays)


@pytest.mark.slow
def test_near_views_show_sides_too() -> None:
    image, mask = next(iter(KINDS["close-grey"].batch(1)))
    assert (image.shape, mask.shape) == ((480, 640, 3), (480, 640))
    seen = {int(value) for _, m in KINDS["close-random"].batch(2) for value in np.unique(m)}
    assert {1, 2, 3, 4} <= seen
