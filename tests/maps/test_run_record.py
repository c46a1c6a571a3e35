"""run.json: what is written is read; times that are none are one line."""

import json
from pathlib import Path

import pytest

from savmap.errors import OutputError
from savmap.maps.run_record import RowRun, RunLog, read_log, write_log


def test_a_run_that_is_written_is_read(tmp_path: Path) -> None:
    log = RunLog(rows={"A": RowRun(status="mapped", seconds={"solved": 1.5}, used=4)}, wall_s=2.0)
    write_log(log, tmp_path / "run.json")
    assert read_log(tmp_path / "run.json") == log


@pytest.mark.parametrize("wall_s", ["1e999", -1, 1e300])
def test_times_beyond_reason_are_refused(tmp_path: Path, wall_s: object) -> None:
    content = {"format": "savmap-run", "version": 1, "rows": {}, "wall_s": wall_s}
    (tmp_path / "run.json").write_text(json.dumps(content))
    with pytest.raises(OutputError, match="wall_s: Input should be"):
        read_log(tmp_path / "run.json")
