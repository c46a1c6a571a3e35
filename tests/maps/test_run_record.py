"""run.json: what is written is read; times that are none are one line."""

import json
from pathlib import Path

import pytest

from savmap.errors import OutputError
from savmap.files.atomic import sha256
from savmap.maps.run_record import LOG, RowRun, RunLog, failed_since, read_log, write_log


def test_a_run_that_is_written_is_read(tmp_path: Path) -> None:
    log = RunLog(rows={"A": RowRun(status="mapped", seconds={"solved": 1.5}, used=4)}, wall_s=2.0)
    write_log(log, tmp_path / "run.json")
    assert read_log(tmp_path / "run.json") == log


@pytest.mark.parametrize("wall_s", ["1e999", -1, 1e300])
def test_times_beyond_reason_are_refused(tmp_path: Path, wall_s: object) -> None:
    content = {"format": "savmap-run", "version": 1, "rows": {}, "wall_s": wall_s}
    (tmp_path / "run.json").write_text(json.dumps(content))
    with pytest.raises(OutputError, match="`wall_s`: "):
        read_log(tmp_path / "run.json")


def test_a_record_of_an_earlier_savmap_is_one_of_a_run_that_ended_well(tmp_path: Path) -> None:
    (tmp_path / LOG).write_text(json.dumps({"format": "savmap-run", "version": 1, "rows": {}, "wall_s": 2.0}))
    assert read_log(tmp_path / LOG).status == "mapped"


def test_a_map_that_a_failed_run_found_is_of_an_earlier_run(tmp_path: Path) -> None:
    (tmp_path / "map.json").write_text("{}")
    write_log(
        RunLog(rows={}, status="failed", error="no row", earlier_map=sha256(tmp_path / "map.json")), tmp_path / LOG
    )
    last = failed_since(tmp_path / "map.json")
    assert last is not None
    assert last.error == "no row"
    (tmp_path / "map.json").write_text('{"newer": 1}')
    assert failed_since(tmp_path / "map.json") is None


@pytest.mark.parametrize(
    "log",
    [None, "", "nonsense", RunLog(rows={}), RunLog(rows={}, status="incomplete"), RunLog(rows={}, status="failed")],
)
def test_where_nothing_tells_of_a_failure_there_is_none(tmp_path: Path, log: RunLog | str | None) -> None:
    (tmp_path / "map.json").write_text("{}")
    if isinstance(log, RunLog):
        write_log(log, tmp_path / LOG)
    elif log is not None:
        (tmp_path / LOG).write_text(log)
    assert failed_since(tmp_path / "map.json") is None
    assert failed_since(tmp_path / "not" / "map.json") is None
