"""The views that the plugin asks for, and when it reads."""

from collections.abc import Mapping
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from savmap.geometry.pinhole import rig_from_view
from savmap.types import Detection, Feature, View, ViewPlan, ViewSpec
from savmap.vision.view_planning import LEVEL, Manual
from savmap_signs import reading
from savmap_signs.plugin import Signs
from savmap_signs.settings import Settings

from .drawn_signs import panorama_of, plate

RIG_FROM_FACE = rig_from_view(30.0, 0.0, 0.0)
SPEC = ViewSpec("signs lower", yaw_deg=0.0, hfov_deg=110.0, every=2)


def plan(config: Settings, manual: Mapping[str, Manual] | None = None) -> ViewPlan:
    preview = SimpleNamespace(rig_from_manhattan=RIG_FROM_FACE @ LEVEL)
    return Signs(config).render_views(pass_preview=preview, manual=manual or {}, attitude=None)  # type: ignore[arg-type]


def test_views_look_up_and_down_the_face_and_along_the_aisle() -> None:
    views = {spec.name: (round(spec.yaw_deg), round(spec.pitch_deg), spec.every) for spec in plan(Settings()).views}
    assert views == {
        "signs upper": (30, 25, 1),
        "signs lower": (30, -25, 1),
        "signs ahead": (120, 25, 1),
        "signs behind": (-60, 25, 1),
    }
    assert [spec.name for spec in plan(Settings(along=False, every=3)).views] == ["signs upper", "signs lower"]
    assert {spec.every for spec in plan(Settings(every=3)).views} == {3}


def test_a_view_aimed_by_hand_wins() -> None:
    upper, *_ = plan(Settings(), {"signs upper": Manual(pitch_deg=40.0)}).views
    assert (round(upper.yaw_deg), upper.pitch_deg) == (30, 40.0)


def test_texts_are_read_in_every_nth_view(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reading, "read", lambda panorama, spec, corners: {"text:A21-03": 0.9})
    panorama = panorama_of(plate((0.2, -0.3, 1.5), (0.3, 0.15)), "A21-03", 256)
    mask = np.zeros((SPEC.height, SPEC.width), np.uint8)
    cv2.rectangle(mask, (300, 100), (360, 140), 1, -1)
    detection = Detection("sign", 0.9, mask.astype(bool), mask.astype(np.float32))

    def features(config: Settings, frame: int) -> list[Feature]:
        view = View(SPEC, frame, 0.1, np.zeros((SPEC.height, SPEC.width, 3), np.uint8))
        return Signs(config).extract_features(view, [detection], panorama)

    each = [features(Settings(read_every=2), frame) for frame in (0, 2, 4)]
    assert [[bool(feature.readings) for feature in four] for four in each] == [
        [True, False, False, False],
        [False] * 4,
        [True, False, False, False],
    ]
    assert not any(feature.readings for feature in features(Settings(read=False), 0))
