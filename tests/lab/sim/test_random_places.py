"""Random places and rows: furnished by plugins, the same for the same seed, for good."""

import hashlib
import json
from typing import Any

import pytest

from savmap.lab.scenes import SceneError
from savmap.lab.sim.random_row import random_row
from savmap.lab.sim.random_scene import classes_of, furnished, random_scene
from savmap.lab.sim.scene.build import build
from savmap.lab.sim.scene.files import Scene


def rounded(content: Any) -> Any:
    """Without the last digits, in which processors may differ."""
    if isinstance(content, dict):
        return {key: rounded(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [rounded(value) for value in content]
    return round(content, 9) if isinstance(content, float) else content


def digest(scene: Scene) -> str:
    """Of what is built; which of it is mapped is no part of it."""
    content = scene.model_dump(mode="json", exclude={"mapped"})
    return hashlib.sha256(json.dumps(rounded(content)).encode()).hexdigest()[:12]


@pytest.mark.parametrize(
    ("scene", "known"),
    [(random_row(5000, 40), "e43840910ea7"), (random_row(1001, 40), "f40c067daf3c"), (random_scene(3), "82fafed7425b")],
)
def test_recorded_footage_still_has_its_scene(scene: Scene, known: str) -> None:
    assert digest(scene) == known


def test_rows_come_before_what_hangs_over_them() -> None:
    place = furnished(4)
    first, *others = place.sections
    assert place.sections[first].rows
    assert not any(place.sections[name].rows for name in others)
    assert classes_of(place.scene)[: len(classes_of(place.scene)) - 1] == ("upright", "beam")
    assert all(size.height < place.scene.hall.height for size in place.site.sizes.values())


def test_sizes_said_are_sizes_built() -> None:
    place = furnished(6)
    built = build(place.scene)
    for name, size in place.site.sizes.items():
        assert built.site.sizes[name].length == pytest.approx(size.length)
        assert built.site.sizes[name].height == pytest.approx(size.height)


def test_no_place_without_a_plugin_that_makes_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("savmap.lab.plugins.installed", lambda group: {})
    with pytest.raises(SceneError, match="needs a plugin that makes up rows"):
        random_scene(0)
