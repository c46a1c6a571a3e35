"""What an earlier run kept: believed where it is what a run keeps, done again where it was forged."""

import json
import os
import zlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from savmap.files import serialization
from savmap.files.serialization import packed
from savmap.jobs import scheduler
from savmap.jobs.cache import FolderCache
from savmap.jobs.kept import kept_map, kept_measurements
from savmap.pipeline.measure import RowMeasurements
from savmap.types import Feature, FrameTable, RowFacts, RowMap, Structure, Trajectory, ViewSpec
from savmap.vision.markers import MarkerTracks

TABLE = FrameTable(np.arange(2.0), ("pass 1",) * 2)
PATH = Trajectory(np.arange(2), np.tile(np.eye(4), (2, 1, 1)), np.full((2, 3), 0.01))
THING = Structure("1", "thing", np.zeros((1, 3)), np.eye(3)[None], ("foot",), np.empty((0, 2), np.int64))
ROW = RowMap("A", TABLE, {}, PATH, {"made-up": (THING,)}, (), {})
FEATURE = Feature(1, "view", "thing", "foot", 0, np.ones((1, 2)), np.eye(2)[None])
FACTS = RowFacts("A", TABLE, {"view": ViewSpec("view", 0.0)}, {"pass 1": 1})
SEEN = RowMeasurements(FACTS, {"made-up": [FEATURE]}, {"pass 1": np.eye(3)}, frozenset(), (), MarkerTracks({}, {}))


def deep() -> bytes:
    tree = b'{"list": [' * 100_000 + b"1" + b"]}" * 100_000
    return zlib.compress(len(tree).to_bytes(8, "little") + tree)


FORGED_MAPS = {
    "nothing": b"",
    "another record": packed(FACTS),
    "another row": packed(replace(ROW, name="B")),
    "numbers for a name": packed(replace(ROW, report={"note": [1]})),
    "positions at NaN": packed(
        replace(ROW, structures={"made-up": (replace(THING, vertices=np.full((1, 3), np.nan)),)})
    ),
    "no structures": packed(replace(ROW, structures={"made-up": (1, 2)})),
    "no path": packed(replace(ROW, trajectory=None)),
    "edges to nowhere": packed(replace(ROW, structures={"made-up": (replace(THING, edges=np.array([[0, 9]])),)})),
    "nested": deep(),
}
FORGED_SEEN = {
    "another row": packed(replace(SEEN, facts=replace(FACTS, name="B"))),
    "another plugin": packed(replace(SEEN, features={"other": [FEATURE]})),
    "no features": packed(replace(SEEN, features={"made-up": [1]})),
    "frames that are not there": packed(replace(SEEN, features={"made-up": [replace(FEATURE, frame=7)]})),
    "views that are not there": packed(replace(SEEN, features={"made-up": [replace(FEATURE, view="up")]})),
    "attitudes": packed(replace(SEEN, attitudes={"pass 1": "up"})),
    "a map": packed(ROW),
}


def test_what_a_run_kept_is_used() -> None:
    stored, seen = kept_map("A", packed(ROW)), kept_measurements("A", packed(SEEN), ["made-up"])
    assert stored is not None
    assert stored.record.name == "A"
    assert stored.content == packed(ROW)
    assert seen is not None


@pytest.mark.parametrize("forged", FORGED_MAPS)
def test_a_forged_map_is_not_used(forged: str) -> None:
    assert kept_map("A", FORGED_MAPS[forged]) is None


def test_a_small_file_of_much_is_not_used(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(serialization, "MOST_BYTES", 1 << 16)
    assert kept_map("A", zlib.compress(bytes(1 << 20))) is None


@pytest.mark.parametrize("forged", FORGED_SEEN)
def test_forged_measurements_are_not_used(forged: str) -> None:
    assert kept_measurements("A", FORGED_SEEN[forged], ["made-up"]) is None


def test_a_forged_solved_file_is_done_again(tmp_path: Path) -> None:
    cache = FolderCache(tmp_path)
    cache.save("A", scheduler.SOLVED, "key", FORGED_MAPS["no path"])
    nothing: Any = None
    keys = {("A",): "key"}
    progress = scheduler._Progress(nothing, cache, nothing, nothing, [("A",)], nothing, solution_keys=keys)
    assert not progress._use_kept(("A",))
    assert progress.solved == {}


def test_a_stage_that_is_a_pipe_is_not_waited_for(tmp_path: Path) -> None:
    (tmp_path / "stages" / "A").mkdir(parents=True)
    os.mkfifo(tmp_path / "stages" / "A" / "solved")
    assert FolderCache(tmp_path).load("A", "solved", json.dumps({})) is None
