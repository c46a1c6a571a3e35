"""Labels, signs' texts and names of any kind leave savmap as text: nothing in them acts on a terminal, table, file or page."""

import csv
import json
import re
from pathlib import Path

import numpy as np
import pytest

from savmap.cli.commands.results import export, find
from savmap.cli.console import Console
from savmap.cli.endings import plain_endings
from savmap.errors import CONTROLS, SiteError
from savmap.maps.map_file import read_map, write_map
from savmap.report.evaluation import as_table
from savmap.report.page import Report, page_text
from savmap.report.picture import figure_text
from savmap.report.row_views import row_view
from savmap.types import Evaluation, FrameTable, RowMap, Score, SiteMap, Structure, Trajectory

EVIL = "\x1b]0;owned\x07\x1b[31m\x9b2J\r\nend_header\n\u202egnp.\u2028<script>alert(1)</script>&"
FORMULA = "=cmd|'/c calc'!A1"


def site() -> SiteMap:
    path = Trajectory(np.arange(2), np.tile(np.eye(4), (2, 1, 1)), np.full((2, 3), 0.01))
    spread = np.tile(1e-4 * np.eye(3), (2, 1, 1))
    texts = {"text": EVIL, "kind": FORMULA, EVIL: 1.0}
    names = (EVIL, FORMULA)
    things = tuple(
        Structure(f"{k}{name}", name, np.eye(3)[:2], spread, names, np.array([[0, 1]]), texts)
        for k, name in enumerate((EVIL, FORMULA, "\t@SUM(1)"))
    )
    row = RowMap(EVIL, FrameTable(np.arange(2.0), (EVIL,) * 2), {}, path, {"racks": things}, (), {"note 1": EVIL})
    return SiteMap({EVIL: row}, {"savmap": "0"}, {FORMULA: EVIL})


@pytest.fixture
def map_file(tmp_path: Path) -> Path:
    write_map(site(), tmp_path / "map.json")
    return tmp_path / "map.json"


def acts(text: str) -> list[str]:
    """Characters that do something, other than the ends of lines."""
    return [found for found in CONTROLS.findall(text) if found != "\n"]


def test_the_map_keeps_names_and_shows_them_escaped(map_file: Path) -> None:
    assert not acts(map_file.read_text(encoding="utf-8"))
    assert list(read_map(map_file).rows) == [EVIL]
    assert read_map(map_file).rows[EVIL].structures["racks"][0].attributes["text"] == EVIL


def test_ply_headers_hold_no_lines_of_others(map_file: Path, tmp_path: Path) -> None:
    export(map_file, tmp_path / "map.ply", "ply")
    text = (tmp_path / "map.ply").read_bytes().decode("ascii")
    assert not acts(text)
    assert text.split("\n").count("end_header") == 1
    head = text.split("\nend_header\n")[0].split("\n")
    assert {line.split()[0] for line in head} == {"ply", "format", "comment", "element", "property"}


def test_csv_cells_are_neither_formulas_nor_lines(map_file: Path, tmp_path: Path) -> None:
    export(map_file, tmp_path / "map.csv", "csv")
    text = (tmp_path / "map.csv").read_text(encoding="utf-8")
    assert not acts(text)
    lines = list(csv.reader(text.splitlines()))
    assert len(lines) == 7
    assert {len(line) for line in lines} == {16}
    assert lines[0][12:] == ["unchecked_m", "assumed", "text", "warnings"]
    assert not any(cell.lstrip()[:1] in "=+-@" for line in lines[1:] for cell in (*line[:6], *line[12:]) if cell)
    assert "'" + FORMULA in lines[3]


def test_the_terminal_sees_text(map_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    find([map_file], name=f"0{EVIL}")
    with Console(tmp_path / "log") as console:
        console.note(EVIL)
        list(console.each([1], EVIL + "[/bold]"))
        with console.meter(EVIL) as meter:
            meter(1.0, EVIL)
    with pytest.raises(SystemExit), plain_endings():
        raise SiteError(EVIL)
    said = capsys.readouterr()
    assert len(said.out.splitlines()) == 3
    assert "owned" in said.out
    assert not re.search(r"\x1b\]|\x1b\[2J|\x07|\x9b|\u202e", said.out + said.err)
    assert said.err.splitlines()[-1].startswith("savmap: \\x1b]0;owned")
    log = (tmp_path / "log").read_text()
    assert not acts(log)
    assert all(re.match(r"\d{4}-\d\d-\d\d ", line) for line in log.splitlines())
    table = as_table(Evaluation({EVIL: Score({"gap": np.zeros(2)})}, (EVIL,)))
    assert not acts(table)


def test_pages_and_pictures_hold_text(map_file: Path) -> None:
    one = read_map(map_file)
    page = page_text(Report(one, dict.fromkeys(one.rows, ()), None, None, (EVIL,), EVIL))
    picture = figure_text(row_view(one.rows[EVIL], (), "plan"))
    for text in (page, picture):
        assert not acts(text)
        assert "<script>alert" not in text
        assert "owned" in text


def test_an_error_of_the_log_is_lines_of_its_own(tmp_path: Path) -> None:
    with pytest.raises(ZeroDivisionError), Console(tmp_path / "log"):
        raise ZeroDivisionError(EVIL)
    text = (tmp_path / "log").read_text()
    assert "Traceback" in text
    assert not acts(text)


def test_json_of_surrogates_can_be_read_again(tmp_path: Path) -> None:
    whole = site()
    write_map(SiteMap(whole.rows, {"savmap": "\ud800"}, {"B": "no such file: \udcff"}), tmp_path / "map.json")
    assert json.loads((tmp_path / "map.json").read_text())["failed"]["B"] == "no such file: \ufffd"
    read_map(tmp_path / "map.json")
