"""Runs that go on, and runs that begin anew."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from savmap.lab.train import train
from savmap.lab.train.data.dataset import Sample
from savmap.lab.train.plan import TrainingPlan

from .conftest import MODELS

pytestmark = [
    pytest.mark.slow,
    pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::FutureWarning"),
    pytest.mark.extra("train"),
]


@pytest.mark.usefixtures("quick_export")
def test_a_run_that_was_stopped_goes_on(plan: TrainingPlan, monkeypatch: pytest.MonkeyPatch) -> None:
    from savmap.lab.train.trainer import Trainer

    steps: list[int] = []
    step = Trainer.step

    def killed(self: Trainer, batch: Any, done: float) -> float:
        steps.append(1)
        if len(steps) == 4:
            raise KeyboardInterrupt
        return step(self, batch, done)

    monkeypatch.setattr(Trainer, "step", killed)
    longer = replace(plan, minutes=60.0)
    with pytest.raises(KeyboardInterrupt):
        train(longer)
    assert plan.output.with_suffix(".resume.pt").is_file()
    assert not plan.output.exists()
    lines: list[str] = []
    recipe = train(plan, lambda _, line: lines.append(line)).recipe
    assert any(line.startswith("going on after step 3") for line in lines)
    assert recipe["steps"] == 3
    assert len(recipe["validation IoU along the way"]) == 2
    assert not plan.output.with_suffix(".resume.pt").exists()
    assert json.loads(json.dumps(recipe)) == recipe


def test_other_data_begin_anew(plan: TrainingPlan) -> None:
    from savmap.lab.train.checkpoint import ResumeFile, run_key
    from savmap.lab.train.data.sets import read_set
    from savmap.lab.train.loop import resumed
    from savmap.lab.train.trainer import FINE_TUNING

    def named(**mapping: str) -> Sequence[Sample]:
        return read_set(plan.data[0], ["upright"], mapping).samples

    def key_of(samples: Sequence[Sample], seed: int = 0, init: Path | None = None) -> str:
        return run_key(["upright"], samples, seed, init, FINE_TUNING)

    samples = named(column="upright")
    whole = key_of(samples)
    assert key_of(named(column="upright")) == whole
    assert key_of(named(crossbar="upright")) != whole
    assert key_of(samples[:1]) != whole
    assert key_of(samples, 1) != whole
    assert key_of(samples, 0, MODELS["lights"]) != whole
    assert run_key(["upright"], samples, 0, None, FINE_TUNING, replayed=[samples[0].origin]) != whole
    picture, mask = (next((plan.data[0] / kind).iterdir()) for kind in ("images", "masks"))
    cv2.imwrite(str(mask), np.zeros((480, 640), np.uint8))
    relabelled = key_of(named(column="upright"))
    assert relabelled != whole
    cv2.imwrite(str(picture), np.zeros((480, 640, 3), np.uint8))
    assert key_of(named(column="upright")) not in {relabelled, whole}
    path = plan.output.with_suffix(".resume.pt")
    path.write_bytes(b"nothing")
    assert ResumeFile(path, whole).load(None) is None  # type: ignore[arg-type]
    lines: list[str] = []
    assert resumed(ResumeFile(path, whole), None, lambda _, line: lines.append(line)).steps == 0  # type: ignore[arg-type]
    assert lines == ["beginning anew: m.resume.pt is of other data or settings"]
