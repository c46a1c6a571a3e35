"""A small scene that the simulator's tests share."""

from collections.abc import Callable
from typing import Any

import pytest

from savmap.lab.sim.scene.build import Built, build
from savmap.lab.sim.scene.files import Scene, parse_scene

BAYS = [{"width": 2.0, "beams": [0.2, 1.2, 2.2]}, {"width": 1.5, "beams": [1.8, 2.4]}]


def small_scene(**changes: Any) -> Scene:
    """Two sections with a tunnel, a row across, a row behind, lamps above the aisle."""
    content: dict[str, Any] = {
        "seed": 3,
        "hall": {"x": [-3.0, 7.0], "z": [-4.0, 5.0], "height": 4.5},
        "goods": {"density": 0.3},
        "look": {"texel": 0.8},
        "cart": {"start": [0.5, 1.2], "end": [3.0, 1.2], "height": 1.5, "frames": 3, "width": 256},
        "rows": {
            "A": {"x": 0.0, "z": 0.0},
            "B": {"x": 3.8, "z": 2.4, "facing": "-z"},
            "C": {"x": 3.8, "z": -2.3, "facing": "-z", "mapped": False},
        },
        "structures": {
            "shelves": {"rows": {name: {"bays": BAYS, "height": 3.0, "setback": 0.005} for name in "ABC"}},
            "lights": {"lines": [{"z": 1.2, "height": 4.0, "pitch": 1.6, "length": 0.8}]},
        },
    }
    return parse_scene({**content, **changes})


@pytest.fixture(scope="session")
def scene_with() -> Callable[..., Scene]:
    """Makes the small scene, with top-level keys changed."""
    return small_scene


@pytest.fixture(scope="session")
def built() -> Built:
    """The small scene, built."""
    return build(small_scene())
