"""The path of a live session: its maps are told where the camera went, in the unit of the face's distance."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from savmap.apps.live import session
from savmap.apps.live.session import LiveMapping
from savmap.apps.live.sources import live_job
from savmap.pipeline.key_frames import SHARE
from savmap.pipeline.view_plans import PassPlan
from savmap.types import ViewPlan

from ...pipeline.filmed_aisle import LEVEL, SIDES_M, aisle
from ...video.made_up_video import evenly, write_video
from .test_session import AHEAD, FakeMapper, until, watcher

COUNT, STEP_M = 17, 0.12


def test_maps_are_told_the_path_of_the_drive(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of every frame; measured are those before which the camera moved on by a share of its distance from the face."""
    job = live_job(write_video(tmp_path / "a.mp4", evenly(40, 10)), ["shelves"], tmp_path / "out", None, 2.0).walked
    plugin, request = watcher(lambda view: []), session.request_for

    def plan_shown(name: str, row_pass: Any, *_: object) -> Any:
        return PassPlan(name, row_pass.clip, {"watcher": ViewPlan((AHEAD,), LEVEL)})

    monkeypatch.setattr(session, "request_for", lambda *given: replace(request(*given), plugins=[plugin]))
    monkeypatch.setattr(session, "plan_shown", plan_shown)
    monkeypatch.setattr(session.PassPreview, "of_frames", lambda *_: None)
    monkeypatch.setattr(session, "Mapper", FakeMapper)
    monkeypatch.setattr(session, "PREVIEWED", 3)
    monkeypatch.setattr(session, "FIRST_MAP", 5)
    with LiveMapping(job, "1") as live:
        for frame in range(3):
            live.take(aisle(STEP_M * frame, frame))
        until(lambda: live._walk is not None)
        for frame in range(3, COUNT):
            live.take(aisle(STEP_M * frame, frame))
        further = iter(range(COUNT, 1000))
        until(lambda: live.take(aisle(STEP_M * (number := next(further)), number)).maps > 0)
        measured = STEP_M * 15 * np.array(live._to_measure)
    assert measured[:3] == pytest.approx(STEP_M * np.arange(3))
    gaps, share = np.diff(measured[3:]), SHARE * SIDES_M[0]
    assert len(gaps) > 2
    assert ((gaps > 0.9 * share) & (gaps < 1.1 * share + STEP_M)).all()
    path = FakeMapper.asked[-1].walked
    assert path is not None
    assert len(path.frames) > len(FakeMapper.asked[-1].measured)
    steps = np.diff(path.world_from_rig[:, 0, 3]) / np.diff(path.frames)
    assert SIDES_M[0] * np.median(steps) == pytest.approx(STEP_M, rel=0.05)
