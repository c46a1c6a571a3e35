"""Training that goes on until it is killed, on pictures that are made meanwhile."""

import sys
import threading
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from savmap.errors import OutputError, SavmapError
from savmap.lab.sim.dataset import Sample
from savmap.lab.train.made import pictures
from savmap.lab.train.made.pictures import HELD_OUT, Kind, add, make, newest, practice_kinds

pytestmark = pytest.mark.extra("train")
CLASSES = ("post", "post_side")


def striped(number: int) -> list[Sample]:
    """Two pictures of a white post on dark noise."""
    rng = np.random.default_rng(number)
    made = []
    for left in rng.integers(100, 500, 2):
        image, mask = rng.integers(0, 60, (480, 640, 3)).astype(np.uint8), np.zeros((480, 640), np.uint8)
        image[:, left : left + 40], mask[:, left : left + 40] = 230, 1
        made.append((image, mask))
    return made


KINDS = {"face": Kind(3.0, striped, 3), "painted": Kind(1.0, striped)}


def names(folder: Path) -> list[str]:
    return sorted(path.stem for path in (folder / "images").glob("*.jpg"))


def test_the_newest_pictures_are_kept(tmp_path: Path) -> None:
    assert newest(tmp_path / "face") == -1
    for number in (7, 8, 9):
        assert add(tmp_path / "face", KINDS["face"], number, CLASSES, 3) == 2
    assert names(tmp_path / "face") == ["face-00000008-001", "face-00000009-000", "face-00000009-001"]
    assert len(list((tmp_path / "face" / "masks").iterdir())) == 3
    assert newest(tmp_path / "face") == 9


def test_pictures_wait_until_some_are_used_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class EndedError(Exception):
        pass

    def rested(seconds: float) -> None:
        assert len(names(tmp_path / HELD_OUT / "face")) == 3
        counts.append({name: len(names(tmp_path / name)) for name in KINDS})
        crops.value += 10 * pictures.USES
        if len(counts) == 2:
            raise EndedError

    counts: list[dict[str, int]] = []
    crops = SimpleNamespace(value=5)
    monkeypatch.setattr(pictures, "CAPACITY", 16)
    monkeypatch.setattr(pictures, "practice_kinds", lambda plugin, classes: KINDS)
    monkeypatch.setattr(pictures.os, "nice", lambda more: 0)
    monkeypatch.setattr(pictures, "parent_process", lambda: SimpleNamespace(join=threading.Event().wait))
    monkeypatch.setattr(pictures.time, "sleep", rested)
    with pytest.raises(EndedError):
        make("posts", CLASSES, tmp_path, crops)
    assert counts[0] == counts[1] == {"face": 12, "painted": 4}
    held_out = {int(name.split("-")[1]) for name in names(tmp_path / HELD_OUT / "face")}
    trained = [{int(name.split("-")[1]) for name in names(tmp_path / kind)} for kind in KINDS]
    assert max(held_out) < min(trained[0])
    assert not trained[0] & trained[1]
    assert max(trained[0]) >= pictures.FIRST_NUMBER + 9


def test_a_plugin_without_pictures_is_named() -> None:
    with pytest.raises(SavmapError, match="plugin `nobody` has no part in the laboratory"):
        practice_kinds("nobody", CLASSES)


def state(**changes: Any) -> Any:
    from savmap.lab.train.made.run import State

    return replace(State("posts", list(CLASSES), [{"steps": 3}]), **changes)


def test_the_rate_is_constant_and_falls_when_told() -> None:
    rates = [state(steps=steps).rate for steps in (0, 499, 500, 10**6)]
    assert 0 < rates[0] < 0.01
    assert rates[1:] == [1.0, 1.0, 1.0]
    falling = [state(steps=steps, falls_from=800, ends_at=1000).rate for steps in (800, 900, 1000)]
    assert falling == [1.0, 0.5, 0.0]


def test_two_trainings_do_not_share_a_folder(tmp_path: Path) -> None:
    from savmap.lab.train.made.run import locked

    with locked(tmp_path / "run"), pytest.raises(OutputError, match="a training runs there"), locked(tmp_path / "run"):
        pass


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Small crops; pictures are made by the test."""
    from savmap.lab.train.data.augment import Crop
    from savmap.lab.train.made import run

    class Maker:
        def __init__(self, **options: Any) -> None:
            pass

        def start(self) -> None:
            pass

        def is_alive(self) -> bool:
            return False

    context = SimpleNamespace(Process=Maker, Value=lambda kind, value: SimpleNamespace(value=value))
    monkeypatch.setattr(run, "SETTINGS", replace(run.SETTINGS, batch=2, crop=Crop(64, 64)))
    monkeypatch.setattr(run, "LEAST_PICTURES", 2)
    monkeypatch.setattr(run.multiprocessing, "get_context", lambda name: context)
    monkeypatch.setattr(run, "practice_kinds", lambda plugin, classes: KINDS)
    monkeypatch.setattr(run.torch, "set_num_threads", lambda count: None)
    monkeypatch.setattr(run.cv2, "setNumThreads", lambda count: None)
    monkeypatch.setattr(run, "give_way", lambda: None)


@pytest.mark.slow
@pytest.mark.usefixtures("quick")
def test_a_killed_training_goes_on_where_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from savmap.lab.train.made import run
    from savmap.lab.train.network import build
    from savmap.lab.train.trainer import Trainer

    class KilledError(Exception):
        pass

    add(tmp_path / "pictures" / "face", KINDS["face"], 1, CLASSES, 9)
    step, file = Trainer.step, tmp_path / "checkpoint.pt"

    def stepped(self: Trainer, batch: Any, factor: float) -> float:
        losses.append(step(self, batch, factor))
        if len(losses) == 4:
            raise KilledError
        return losses[-1]

    losses: list[float] = []
    run.save(file, state(ends_at=3, falls_from=0), Trainer(build(2, None), run.SETTINGS))
    monkeypatch.setattr(run, "report", lambda *given: None)
    monkeypatch.setattr(run, "written", lambda *given: None)
    run.train(tmp_path, file, *run.restored(file))
    whole, (before, trainer) = list(losses), run.restored(file)
    assert (before.steps, before.crops, trainer.average.updates) == (3, 6, 3)
    losses.clear()
    monkeypatch.setattr(run, "SAVED_EVERY_S", 0.0)
    monkeypatch.setattr(run, "SAID_EVERY_S", 0.0)
    monkeypatch.setattr(Trainer, "step", stepped)
    run.save(file, replace(before, ends_at=None, falls_from=None), trainer)
    with pytest.raises(KilledError):
        run.train(tmp_path, file, *run.restored(file))
    after, trainer = run.restored(file)
    assert (after.steps, after.crops, trainer.average.updates) == (6, 12, 6)
    assert after.history == [{"steps": 3}]
    assert np.isfinite([*whole, *losses]).all()


@pytest.mark.slow
@pytest.mark.usefixtures("quick")
def test_a_fallen_rate_ends_in_both_precisions(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from savmap.lab.train.made import run
    from savmap.lab.train.network import build
    from savmap.lab.train.trainer import Trainer

    exported: list[Any] = []
    monkeypatch.setattr(run, "export", lambda *given: exported.append(given))
    monkeypatch.setattr(run, "write_quantised", lambda *given: exported.append(given))
    for name, kind in KINDS.items():
        add(tmp_path / "pictures" / name, kind, 1, CLASSES, 9)
        add(tmp_path / "pictures" / HELD_OUT / name, kind, 0, CLASSES, 9)
    checkpoint = tmp_path / run.CHECKPOINT
    run.save(checkpoint, state(steps=4), Trainer(build(2, None), run.SETTINGS))
    before = checkpoint.read_bytes()
    run.run(tmp_path, None, None, 0.2)
    assert checkpoint.read_bytes() == before
    assert not (tmp_path / "decayed.pt").exists()
    (_, classes, recipe, output), (model, trained, integers) = exported
    assert (tuple(classes), recipe["steps"], recipe["earlier"]) == (CLASSES, 5, [{"steps": 3}])
    assert (output.name, model, integers.name, len(trained)) == ("decayed.onnx", output, "decayed.int8.onnx", 4)
    said = (tmp_path / run.LOG).read_text()
    assert "face: post IoU" not in said  # two pictures of three that are to be held out
    add(tmp_path / "pictures" / HELD_OUT / "face", KINDS["face"], 2, CLASSES, 9)
    network = Trainer(build(2, None), run.SETTINGS)
    run.report(state(), network, run.Pictures(tmp_path, KINDS, CLASSES))
    assert "face: post IoU" in (tmp_path / run.LOG).read_text()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ("posts --init a.onnx", "has a checkpoint: --resume goes on with it"),
        ("--init a.onnx", "a plugin's name and --init go together"),
        ("--decay 1.5", "--decay is a share"),
    ],
)
def test_what_cannot_be_begun_is_said(
    options: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from savmap.lab.train.made.__main__ import main

    (tmp_path / "checkpoint.pt").write_bytes(b"")
    monkeypatch.setattr(sys, "argv", ["made", "-o", str(tmp_path), *options.split()])
    with pytest.raises(SystemExit):
        main()
    assert said in capsys.readouterr().err


@pytest.mark.parametrize("content", [None, b"", b"nothing"])
def test_what_is_no_checkpoint_is_said(tmp_path: Path, content: bytes | None) -> None:
    from savmap.lab.train.made.run import restored

    if content is not None:
        (tmp_path / "checkpoint.pt").write_bytes(content)
    with pytest.raises(OutputError, match="is no checkpoint of this training"):
        restored(tmp_path / "checkpoint.pt")
