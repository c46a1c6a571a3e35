"""Each of our plugins keeps the contract that any plugin must keep."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from pydantic import BaseModel, ConfigDict

from savmap.graph import Constraints, image_measurements, sight_lines
from savmap.plugin.contract import check_plugin
from savmap.plugin.manager import load_class
from savmap.types import Feature, Track, ViewPlan, ViewSpec

from .made_up_plugin import plugin_class


def middles(self: Any, view: Any, detections: Any) -> list[Feature]:
    """The middle of each mask."""
    return [
        Feature(
            view.frame,
            view.spec.name,
            one.label,
            "middle",
            k,
            np.argwhere(one.mask).mean(0)[None, ::-1],
            np.eye(2)[None],
        )
        for k, one in enumerate(detections)
    ]


def counted(self: Any, view: Any, detections: Any) -> list[Feature]:
    """The middles, numbered through all that was asked before."""
    self.count = getattr(self, "count", 0) + 1
    return [replace(one, instance=self.count) for one in middles(self, view, detections)]


def two_things(self: Any, features: Any) -> list[Track]:
    """A track of what is seen first in each frame, and one of what is seen second."""
    things = [[one for one in features if one.instance == number] for number in (0, 1)]
    return [track_of(f"thing {number}", seen) for number, seen in enumerate(things) if seen]


def track_of(name: str, seen: list[Feature]) -> Track:
    pixels, covariances = ([getattr(one, part)[0] for one in seen] for part in ("pixels", "covariance"))
    frames, views = np.array([one.frame for one in seen], np.int64), tuple(one.view for one in seen)
    return Track(name, "thing", {}, frames, views, np.array(pixels), np.array(covariances))


def free_points(self: Any, tracks: Any, facts: Any, start: Any, keys: Any) -> Constraints:
    """Each track a point, at first a metre ahead of the camera."""
    key_of = keys.keys([track.name for track in tracks])
    lines = {track.name: sight_lines(track, facts, start) for track in tracks}
    first = {name: origins[0] + rays[0] for name, (origins, rays) in lines.items()}
    return Constraints("made-up", key_of, image_measurements(tracks, key_of, facts.views), (), first)


SPEC = ViewSpec("ahead", 0.0, hfov_deg=110.0)
SOUND = {
    "render_views": lambda self: ViewPlan((SPEC,)),
    "extract_features": middles,
    "track": two_things,
    "constrain": free_points,
    "describe": lambda self: [],
}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["shelves", "lights", "signs"])
def test_our_plugins_keep_the_contract(name: str) -> None:
    check_plugin(load_class(name))


class Lax(BaseModel):
    model_config = ConfigDict(extra="allow")


@pytest.mark.parametrize(
    ("changes", "clause"),
    [
        ({"classes": ["thing"]}, "`classes` must be a tuple"),
        ({"Config": Lax}, "must refuse unknown keys"),
        ({"model": "none.onnx"}, "`model` must be a Path"),
        ({"track": None}, "it lacks the hook `track`"),
        ({"extract_feature": lambda self: []}, "`extract_feature` is no hook: did you mean `extract_features`?"),
        ({"render_views": lambda self: 1}, "returned int from `render_views`"),
        ({"extract_features": lambda self: [1]}, "from `extract_features`"),
        ({"extract_features": counted}, "must give the same for the same view"),
        ({"track": lambda self: None}, "returned NoneType from `track`"),
        ({"constrain": lambda self: 1 / 0}, "failed in `constrain`: ZeroDivisionError"),
        ({"describe": lambda self: 1 / 0}, "failed in `describe`: ZeroDivisionError"),
    ],
)
def test_a_broken_plugin_is_told_which_clause(changes: dict[str, Any], clause: str) -> None:
    with pytest.raises(AssertionError, match="breaks its contract") as caught:
        check_plugin(plugin_class(**{**SOUND, **changes}), require_model=False)
    assert clause in str(caught.value)


def test_a_small_plugin_keeps_the_contract() -> None:
    check_plugin(plugin_class(**SOUND), require_model=False)
