"""`savmap report`: a map file, its run and a survey make a page with what the plugins draw and score."""

import json
import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_up_map import row as made_up_row
from typer.testing import CliRunner

from savmap.apps.viewer.beside import viewed
from savmap.cli.app import app
from savmap.errors import OutputError
from savmap.maps.map_file import write_map
from savmap.maps.run_record import RowRun, RunLog, write_log
from savmap.report.page import page_text
from savmap.report.site_report import drawings_of, plugins_of_map, report_for, write_report
from savmap.types import Drawing, FrameTable, MapWarning, RowMap, Score, SiteMap, Structure, Survey, Trajectory, Verdict

ATTRIBUTES: dict[str, Any] = {"width_m": 0.1, "width_sigma_m": 0.004}


def upright(number: int, x: float) -> Structure:
    corners = np.array([[x, 0, 0], [x + 0.1, 0, 0], [x, 3, 0], [x + 0.1, 3, 0]])
    labels = tuple(f"upright {number} / {side} / {end}" for end in ("bottom", "top") for side in ("left", "right"))
    edges = np.array([[0, 1], [1, 3], [3, 2], [2, 0]])
    return Structure(
        f"upright {number}", "upright", corners, np.tile(1e-6 * np.eye(3), (4, 1, 1)), labels, edges, ATTRIBUTES
    )


def lamp(number: int, x: float) -> Structure:
    ends = np.array([[x, 6.0, 1.0], [x + 1.2, 6.0, 1.0]])
    return Structure(
        f"light {number}", "light", ends, np.tile(1e-6 * np.eye(3), (2, 1, 1)), ("end 0", "end 1"), np.array([[0, 1]])
    )


@pytest.fixture
def site() -> SiteMap:
    poses = np.tile(np.eye(4), (2, 1, 1))
    found = {"shelves": (upright(1, 0.0), upright(2, 2.9)), "lights": (lamp(1, 0.5),)}
    row = RowMap("A", FrameTable(np.arange(2.0), ("pass 1",) * 2), {}, Trajectory(np.arange(2), poses), found, ())
    return SiteMap({"A": row}, {"savmap": "0"}, {"B": "no video"})


@pytest.fixture
def map_file(site: SiteMap, tmp_path: Path) -> Path:
    write_map(site, tmp_path / "map.json")
    return tmp_path / "map.json"


def survey(tmp_path: Path, name: str) -> Path:
    row = {"uprights": [[0, 0.1], [2.9, 3.0]], "sections": [{"beams": []}]}
    content = {"format": "savmap-survey", "version": 1, "units": "m", "rows": {name: row}}
    (tmp_path / "survey.json").write_text(json.dumps(content), encoding="utf-8")
    return tmp_path / "survey.json"


def test_whatever_is_drawn_of_a_structure_has_its_name(site: SiteMap) -> None:
    row = site.rows["A"]
    drawn = drawings_of(row, plugins_of_map(site)["A"], None, {})
    assert {own.name for own in drawn} == {"upright 1", "upright 2", "light 1"}


class AskedPlugin:
    """Notes what it is asked, and says that its structures are 10 cm off."""

    def __init__(self, name: str, asked: list[tuple[str, str]]) -> None:
        self.name, self.asked = name, asked

    def evaluate(self, structures: Sequence[Structure], survey: dict[str, Any]) -> Score:
        self.asked.append((self.name, "evaluate"))
        return Score({"width": np.array([0.1])}, deviations={own.id: 0.1 for own in structures})

    def draw(self, structures: Sequence[Structure], survey: Any, deviations: dict[str, float]) -> tuple[Drawing, ...]:
        assert [deviations[own.id] for own in structures] == [0.1] * len(structures)
        self.asked.append((self.name, "draw"))
        return (Drawing("point", structures[0].vertices, "off", "structure", "things"),)


def test_what_the_verdict_warnings_is_drawn_as_warned(site: SiteMap) -> None:
    row = replace(site.rows["A"], verdict=Verdict((MapWarning("uncertain-element", ("upright 2", "light 1")),)))
    drawn = drawings_of(row, plugins_of_map(site)["A"], None, {})
    assert {one.name for one in drawn if one.role == "warned"} == {"upright 2", "light 1"}
    assert {one.name for one in drawn if one.role == "mapped"} == {"upright 1"}


def test_plugins_score_and_draw_a_row_once(site: SiteMap) -> None:
    asked: list[tuple[str, str]] = []
    plugins: Any = {name: AskedPlugin(name, asked) for name in ("shelves", "lights")}
    report = report_for(site, {"A": plugins}, Survey({"A": {}}))
    page_text(report)
    assert sorted(asked) == [(name, hook) for name in ("lights", "shelves") for hook in ("draw", "evaluate")]
    assert report.evaluation is not None
    assert len(report.evaluation.rows["A"].errors["width"]) == len(report.drawings["A"]) == 2


def test_the_command_writes_a_page_from_a_map_alone(map_file: Path, tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["report", str(map_file), "-o", str(tmp_path / "new" / "page.html")])
    assert result.exit_code == 0, result.output
    assert "wrote" in result.output
    text = (tmp_path / "new" / "page.html").read_text(encoding="utf-8")
    assert "upright 1: width 0.100 \u00b1 0.004 m" in text
    assert 'id="errors"' not in text
    assert 'id="time"' not in text


def test_a_run_and_a_survey_add_times_and_errors(map_file: Path, tmp_path: Path) -> None:
    write_log(RunLog(rows={"A": RowRun(status="mapped", seconds={"solve": 1.5})}, wall_s=2.0), tmp_path / "run.json")
    write_report(map_file, tmp_path / "page.html", tmp_path / "run.json", survey(tmp_path, "A"))
    text = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert '<section id="errors">' in text
    assert '<section id="time">' in text
    assert "V gap" in text


def test_record_beside_a_map_is_used_where_it_is_of_it(map_file: Path, tmp_path: Path) -> None:
    for status, times in (("mapped", 1), ("failed", 0)):
        write_log(RunLog(rows={"A": RowRun(status=status, seconds={"solve": 1.5})}), tmp_path / "run.json")
        write_report(map_file, tmp_path / "page.html")
        assert (tmp_path / "page.html").read_text(encoding="utf-8").count('<section id="time">') == times


def test_the_record_of_another_run_is_refused(map_file: Path, tmp_path: Path) -> None:
    write_log(RunLog(rows={"A": RowRun(status="failed"), "B": RowRun(status="mapped")}), tmp_path / "run.json")
    with pytest.raises(OutputError, match=r"run\.json: is of another run than the map: row A is in one of them alone"):
        write_report(map_file, tmp_path / "page.html", tmp_path / "run.json")
    assert not (tmp_path / "page.html").exists()


def test_a_survey_of_other_rows_is_told_not_refused(map_file: Path, tmp_path: Path) -> None:
    write_report(map_file, tmp_path / "page.html", None, survey(tmp_path, "Z"))
    text = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "The survey has none of the rows that were mapped" in text
    assert '<section id="errors">' not in text


def test_a_map_of_failed_rows_only_is_reported(site: SiteMap, tmp_path: Path) -> None:
    write_map(replace(site, rows={}), tmp_path / "none.json")
    write_report(tmp_path / "none.json", tmp_path / "page.html", None, survey(tmp_path, "Z"))
    assert "no video" in (tmp_path / "page.html").read_text(encoding="utf-8")


def test_the_page_must_be_named_as_one(map_file: Path, tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"a report is an HTML page; name it \.html"):
        write_report(map_file, tmp_path / "page.pdf")


def test_viewer_is_written_where_it_is_missing_or_old(tmp_path: Path) -> None:
    write_map(SiteMap({"A": made_up_row("A")}, {}), tmp_path / "map.json")
    page, written = viewed(tmp_path)
    assert (page, written) == (tmp_path / "view.html", True)
    assert viewed(tmp_path / "map.json") == (page, False)
    assert viewed(tmp_path, fresh=True) == (page, True)
    page.write_text(page.read_text(encoding="utf-8").replace(" by=", " by=0.0.1 "), encoding="utf-8")
    assert viewed(tmp_path) == (page, True)


def test_viewer_shows_the_map_that_is_asked_for(tmp_path: Path) -> None:
    write_map(SiteMap({"A": made_up_row("A")}, {}), tmp_path / "map.json")
    write_map(SiteMap({"B": made_up_row("B")}, {}), tmp_path / "other.json")
    os.utime(tmp_path / "other.json", (1, 1))
    page, _ = viewed(tmp_path)
    assert viewed(tmp_path / "other.json") == (page, True)
    assert viewed(tmp_path / "other.json") == (page, False)
    assert viewed(tmp_path) == (page, True)
    os.utime(tmp_path / "map.json", (2e9, 2e9))  # copied, the same
    assert viewed(tmp_path) == (page, False)


def test_viewer_shows_the_survey_that_is_asked_for(map_file: Path, tmp_path: Path) -> None:
    surveyed = survey(tmp_path, "A")
    page, _ = viewed(map_file, surveyed)
    assert viewed(map_file, surveyed) == viewed(map_file) == (page, False)
    surveyed.write_text(surveyed.read_text().replace("2.9", "2.8"))
    assert viewed(map_file) == (page, False)  # none is asked for
    assert viewed(map_file, surveyed) == (page, True)
