"""A run that fails where an earlier one left a map: the folder says so, and so does whatever reads the map."""

import json
import shutil
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result
from typer.testing import CliRunner

from savmap.cli.app import app
from savmap.errors import OutputError, RowsFailedError, SavmapError, StructureError
from savmap.jobs.cache import locked
from savmap.jobs.map_site import failures_recorded
from savmap.jobs.scheduler import MappedRows
from savmap.maps.map_file import write_map
from savmap.maps.run_record import RowRun, RunLog
from savmap.types import FrameTable, RowMap, SiteMap, Structure, Trajectory

EXAMPLE = Path(__file__).parents[2] / "examples" / "aisle-dev"
EARLIER = "is of an earlier run"


def row() -> RowMap:
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=np.float64)
    labels = tuple(f"board / {k}" for k in range(4))
    board = Structure("board", "board", corners, np.tile(np.eye(3) * 1e-6, (4, 1, 1)), labels, np.zeros((0, 2), int))
    path = Trajectory(np.zeros(0, np.int64), np.zeros((0, 4, 4)))
    return RowMap("A", FrameTable(np.zeros(0), ()), {}, path, {"boards": (board,)}, ())


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder in which a run has just mapped a site."""
    site = (EXAMPLE / "site.yaml").read_text(encoding="utf-8").replace("survey:", "# survey:")
    site = site.replace("aisle-dev.mp4", str(EXAMPLE / "aisle-dev.mp4"))
    (tmp_path / "site.yaml").write_text(site, encoding="utf-8")
    maps(monkeypatch)
    assert run_map(tmp_path).exit_code == 0
    return tmp_path


def maps(monkeypatch: pytest.MonkeyPatch, **more: Any) -> None:
    """Let rows be mapped at once, to the same map each time, or fail."""

    def mapped(*_: object, **__: object) -> MappedRows:
        if "error" in more:
            raise more["error"]
        return MappedRows({"A": row()}, more.get("failed", {}), RunLog(rows={"A": RowRun(status="mapped")}))

    monkeypatch.setattr("savmap.jobs.map_site.map_rows_of", mapped)
    monkeypatch.setattr("savmap.jobs.map_site.made_by", lambda _: {"savmap": "0"})
    monkeypatch.setattr("savmap.jobs.map_site.viewer", lambda: None)
    for name in ("report_for", "write_page", "write_row_view", "plugins_for"):
        monkeypatch.setattr(f"savmap.jobs.map_site.{name}", lambda *_, **__: _Anything())
    monkeypatch.setattr("savmap.jobs.map_site.replace", lambda one, **_: one)
    monkeypatch.setattr("savmap.jobs.map_site.drawing_key", lambda *_: "key")
    monkeypatch.setattr("savmap.jobs.map_site.write_photo", lambda *_: [])


class _Anything(tuple[()]):
    """A report of nothing, and a list of no plugins."""

    __slots__ = ()
    title, evaluation, places, drawings = "", None, (), defaultdict[str, tuple[()]](tuple)


def run_map(folder: Path, site: str = "site.yaml", *options: str) -> Result:
    return CliRunner().invoke(app, ["map", str(folder / site), "--jobs", "0", "-o", str(folder / "out"), *options])


def run_json(folder: Path) -> dict[str, Any]:
    content: dict[str, Any] = json.loads((folder / "out" / "run.json").read_text(encoding="utf-8"))
    return content


def warnings(*arguments: object) -> int:
    """How many lines of standard error say that a map is of an earlier run."""
    result = CliRunner().invoke(app, [str(one) for one in arguments])
    lines = [line for line in result.stderr.splitlines() if EARLIER in line]
    assert all(line.startswith("savmap: warning: ") for line in lines)
    return len(lines)


def test_a_run_that_ended_well_says_so_and_nothing_warns(folder: Path) -> None:
    assert run_json(folder)["status"] == "mapped"
    assert warnings("find", folder / "out", "board") == 0
    shutil.copy(folder / "out" / "map.json", folder / "alone.json")
    assert warnings("find", folder / "alone.json", "board") == 0


def test_a_run_that_fails_says_so_in_the_folder_and_leaves_the_map(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = (folder / "out" / "map.json").read_bytes()
    maps(monkeypatch, error=StructureError("row A: no upright was found"))
    result = run_map(folder)
    assert isinstance(result.exception, StructureError)
    assert f"{folder / 'out' / 'map.json'} {EARLIER}" in result.stderr.splitlines()
    assert (folder / "out" / "map.json").read_bytes() == before
    record = run_json(folder)
    assert (record["status"], record["error"], record["rows"]) == ("failed", "row A: no upright was found", {})
    assert warnings("find", folder / "out", "board") == 1
    assert warnings("measure", folder / "out" / "map.json", "board / 0", "board / 1") == 1
    assert warnings("export", folder / "out", "--format", "csv", "-o", folder / "a.csv") == 1
    assert warnings("compare", folder / "out", folder / "out" / "map.json") == 2
    assert warnings("view", folder / "out", "--no-open") == 1
    assert warnings("evaluate", folder / "out", EXAMPLE / "survey.json") == 1
    assert "no upright was found" in CliRunner().invoke(app, ["find", str(folder / "out"), "board"]).stderr


def test_the_next_run_that_ends_well_ends_the_warnings(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    maps(monkeypatch, error=StructureError("too dark"))
    run_map(folder)
    maps(monkeypatch)
    assert run_map(folder).exit_code == 0
    assert run_json(folder)["status"] == "mapped"
    assert warnings("find", folder / "out", "board") == 0


@pytest.mark.parametrize("cut", [KeyboardInterrupt(), SystemExit(137)])
def test_a_run_that_is_cut_off_has_not_failed(
    folder: Path, monkeypatch: pytest.MonkeyPatch, cut: BaseException
) -> None:
    maps(monkeypatch, error=cut)
    run_map(folder)
    assert run_json(folder)["status"] == "mapped"
    assert warnings("find", folder / "out", "board") == 0


def test_a_site_file_that_is_wrong_now_is_a_failed_run(folder: Path) -> None:
    (folder / "site.yaml").write_text("rows: {A: {passes: [{vido: a.mp4}]}}\n", encoding="utf-8")
    result = run_map(folder)
    assert isinstance(result.exception, SavmapError)
    assert EARLIER in result.stderr
    assert "vido" in run_json(folder)["error"]
    assert warnings("find", folder / "out", "board") == 1


def test_a_video_that_is_gone_is_a_failed_run(folder: Path) -> None:
    site = (folder / "site.yaml").read_text(encoding="utf-8").replace(str(EXAMPLE / "aisle-dev.mp4"), "gone.mp4")
    (folder / "site.yaml").write_text(site, encoding="utf-8")
    assert EARLIER in run_map(folder).stderr
    assert run_json(folder)["status"] == "failed"


def test_a_name_that_is_mistyped_and_a_preview_are_no_runs(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert isinstance(run_map(folder, "stie.yaml").exception, SavmapError)
    maps(monkeypatch, error=StructureError("too dark"))
    monkeypatch.setattr("savmap.cli.mapping.previews", lambda *_: 1 / 0)
    run_map(folder, "site.yaml", "--preview")
    assert run_json(folder)["status"] == "mapped"
    assert warnings("find", folder / "out", "board") == 0


def test_a_first_run_that_fails_warns_of_no_map(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.rmtree(folder / "out")
    maps(monkeypatch, error=StructureError("too dark"))
    assert EARLIER not in run_map(folder).stderr
    assert run_json(folder)["error"] == "too dark"
    write_map(SiteMap({"A": row()}, {"savmap": "0"}), folder / "out" / "map.json")
    assert warnings("find", folder / "out", "board") == 0, "a map that came later is of no earlier run"


def test_a_run_whose_map_was_written_leaves_no_earlier_one(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OutputError("report.html: cannot be written (no space left on device)")

    monkeypatch.setattr("savmap.jobs.map_site.write_page", full)
    assert EARLIER not in run_map(folder).stderr
    assert run_json(folder)["status"] == "failed"
    assert warnings("find", folder / "out", "board") == 0


def test_a_run_that_mapped_some_rows_has_not_failed(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    maps(monkeypatch, failed={"B": StructureError("too dark")})
    result = run_map(folder)
    assert isinstance(result.exception, RowsFailedError)
    assert EARLIER not in result.stderr
    assert run_json(folder)["rows"]["A"]["status"] == "mapped"


def test_what_another_run_is_writing_is_left_alone(folder: Path) -> None:
    with locked(folder / "out"):
        result = run_map(folder)
    assert "another savmap is writing there" in str(result.exception)
    assert run_json(folder)["status"] == "mapped"


def test_a_folder_that_no_run_wrote_to_is_left_alone(tmp_path: Path) -> None:
    for place in (tmp_path, tmp_path / "not there"):
        with pytest.raises(SavmapError), failures_recorded(place):
            raise SavmapError("the site file is wrong")
    assert list(tmp_path.iterdir()) == []


def test_an_error_that_nobody_expected_is_a_failure_too(folder: Path) -> None:
    with pytest.raises(ZeroDivisionError), failures_recorded(folder / "out"):
        1 / 0  # noqa: B018
    assert run_json(folder)["error"] == "ZeroDivisionError: division by zero"
