"""`savmap inspect`: what plugins find becomes records, a page with pictures, CSV and JSON."""

import csv
import json
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from pydantic import BaseModel, ConfigDict
from typer.testing import CliRunner

import savmap
from savmap.apps.inspection.inspect import applied_keys
from savmap.cli.app import app
from savmap.errors import OutputError, SiteError
from savmap.files.atomic import sha256
from savmap.maps.map_file import write_map
from savmap.maps.orthophoto_file import write_orthophoto
from savmap.maps.run_record import FootageFile, RowRun, RunLog, write_log
from savmap.plugin import (
    CloseUp,
    Finding,
    FindingTable,
    InspectionLimits,
    Limit,
    Measured,
    RowInspection,
    Structure,
    hookimpl,
)
from savmap.plugin.hookspecs import REQUIRED
from savmap.types import AppliedLimit, FaceDepths, FrameTable, Orthophoto, RowMap, SiteMap, Survey, Trajectory, Verdict


class PostLimits(InspectionLimits):
    height_m: Limit = Limit(amber=2.0, red=1.0, source="made up")
    """Of a post."""
    width_m: Limit = Limit(amber=0.1, red=0.2)
    """Not looked at."""


class Posts:
    """A stranger's plugin that inspects the heights of posts."""

    name = "posts"
    classes = ("post",)
    model = Path("none.onnx")
    Limits = PostLimits

    class Config(BaseModel):
        model_config = ConfigDict(extra="forbid")

    def __init__(self, config: object) -> None: ...

    @hookimpl
    def inspect(
        self, structures: Sequence[Structure], limits: PostLimits, survey: dict[str, Any] | None
    ) -> RowInspection:
        findings = tuple(
            limits.graded(
                "height_m",
                Finding("low", f"height of {post.id}", subjects=(post.id,), unit="m", action="=replace it"),
                Measured(float(np.ptp(post.vertices[:, 1])), 0.01),
            )
            for post in structures
        )
        table = FindingTable("heights", "Heights", ("post", "height_m", "wanted_m"), (("post 1", 3.0, None),))
        parts = tuple(
            CloseUp(post.id, post.id, post.vertices[[0, 1]] + [[0, 0, 0], [0.1, 0, 0]]) for post in structures
        )
        told = () if survey is None else (f"survey of {survey['length']} m",)
        return RowInspection(findings, (table,), parts, ("rust", *told))


for hook in REQUIRED:
    setattr(Posts, hook, hookimpl(lambda self: None))


def post(number: int, height_m: float) -> Structure:
    ends = np.array([[float(number), 0.0, 0.0], [float(number), height_m, 0.0]])
    return Structure(
        f"post {number}", "post", ends, np.tile(1e-6 * np.eye(3), (2, 1, 1)), ("foot", "top"), np.array([[0, 1]])
    )


def site() -> SiteMap:
    path = Trajectory(np.arange(1), np.eye(4)[None])
    posts = (replace(post(1, 3.0), attributes={"text": "LEFT"}), post(2, 0.5), post(3, 1.5))
    return SiteMap(
        {"A": RowMap("A", FrameTable(np.zeros(1), ("pass 1",)), {}, path, {"posts": posts, "absent": ()}, ())}, {}
    )


@pytest.fixture
def installed(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    """The plugin's entry point, as pip would write it."""
    record = tmp_path_factory.mktemp("packages") / "made_up_posts-0.1.0.dist-info"
    record.mkdir()
    (record / "entry_points.txt").write_text(f"[savmap.plugins]\nposts = {__name__}:Posts\n", encoding="utf-8")
    (record / "METADATA").write_text("Name: made-up-posts\nVersion: 0.1.0\n", encoding="utf-8")
    monkeypatch.syspath_prepend(str(record.parent))


@pytest.fixture
def folder(installed: None, tmp_path: Path) -> Path:
    write_map(site(), tmp_path / "map.json")
    picture = np.asarray(cv2.imencode(".jpg", np.full((400, 500, 3), 90, np.uint8))[1], np.uint8).ravel()
    photo = Orthophoto(np.array([0.0, 0, 0]), np.eye(3)[0], np.eye(3)[1], 0.01, 500, 400, picture)
    write_orthophoto("A", photo, tmp_path)
    return tmp_path


def run(*arguments: object) -> tuple[BaseException | None, str]:
    result = CliRunner().invoke(app, ["inspect", *map(str, arguments)])
    return result.exception, result.output


def test_every_plugin_is_asked_with_its_limits(installed: None) -> None:
    inspection = savmap.inspect(site())
    assert [(row, plugin, finding.subjects[0], finding.grade) for row, plugin, finding in inspection.findings()] == [
        ("A", "posts", "post 2", "red"),
        ("A", "posts", "post 3", "amber"),
        ("A", "posts", "post 1", "green"),
    ]
    assert inspection.limits == (AppliedLimit("posts: height_m", "Of a post.", "amber 2, red 1", "made up"),)
    assert "not installed" in inspection.rows["A"]["absent"].unchecked[0]
    lower = savmap.inspect(site(), {"plugins": {"posts": {"height_m": {"amber": 0.4, "red": 0.2}}}})
    assert lower.counts() == {"red": 0, "amber": 0, "unknown": 0, "green": 3}
    assert "survey of 7 m" in savmap.inspect(site(), drawing=Survey({"A": {"length": 7}})).rows["A"]["posts"].unchecked


def test_only_limits_that_were_applied_are_listed() -> None:
    limits, finding = PostLimits(), Finding("low", "low", unit="m")
    measured = Measured(3.0, 0.1)
    assert applied_keys([RowInspection()], limits) == set()
    assert applied_keys([RowInspection((finding,), applied=("width_m",))], limits) == {"width_m"}
    assert applied_keys([RowInspection((limits.graded("height_m", finding, measured),))], limits) == {"height_m"}
    unnamed = RowInspection((limits.height_m.finding(finding, measured),))
    assert applied_keys([unnamed], limits) == {"height_m", "width_m"}


def test_command_writes_page_tables_and_json(folder: Path) -> None:
    error, output = run(folder, "-o", folder / "check.html")
    assert error is None
    assert "1 red, 1 amber, 0 unknown, 1 green" in output
    page = (folder / "check.html").read_text(encoding="utf-8")
    assert "no inspection by itself" in page
    assert "1 standard deviation" in page
    assert "limit 1000 mm (made up)" in page
    assert "wanted, m<" in page
    assert "more than 99 % likely beyond it" in page
    assert page.count('<img src="data:image/jpeg;base64,') == 2, "what is in order has no picture"
    lines = list(csv.DictReader((folder / "check.csv").read_text(encoding="utf-8").splitlines()))
    assert [lines[0][key] for key in ("title", "value", "probability")] == ["height of post 2", "0.5", "1"]
    assert lines[0]["action"].startswith("'="), "no formula for a spreadsheet"
    table = list(csv.reader((folder / "check-posts-heights.csv").read_text(encoding="utf-8").splitlines()))
    assert table == [["row", "post", "height_m", "wanted_m"], ["A", "post 1", "3", ""]]
    content = json.loads((folder / "check.json").read_text(encoding="utf-8"))
    assert content["counts"] == {"red": 1, "amber": 1, "unknown": 0, "green": 1}
    assert content["findings"][0]["subjects"] == ["post 2"]
    assert [content["findings"][0][key] for key in ("limit_key", "limit_source")] == ["height_m", "made up"]
    assert [limit["name"] for limit in content["limits"]] == ["posts: height_m"]


def test_the_page_names_map_verdict_footage_and_limits(folder: Path) -> None:
    (folder / "limits.yaml").write_text("plugins: {posts: {}}\n", encoding="utf-8")
    row = replace(site().rows["A"], verdict=Verdict((), ("one length alone gives the scale",)))
    write_map(SiteMap({"A": row}, {"savmap": "0.0.7"}), folder / "map.json")
    run_of_a = RowRun(status="mapped", footage={"pass 1": FootageFile(name="walk-17.mp4")})
    write_log(RunLog(rows={"A": run_of_a}, ended="2026-11-20T10:00:00Z"), folder / "run.json")
    assert run(folder, "--limits", folder / "limits.yaml", "-o", folder / "check.html")[0] is None
    page = (folder / "check.html").read_text(encoding="utf-8")
    first_page = page[: page.index('id="worst"')]
    for words in (
        f"{folder / 'map.json'} (SHA-256 {sha256(folder / 'map.json')[:12]}",
        "on 2026-11-20 with savmap 0.0.7",
        "row A: walk-17.mp4",
        f"<dd>{folder / 'limits.yaml'}</dd>",
        "trusted</span>",
        "one length alone gives the scale",
        "<li>rust</li>",
    ):
        assert words in first_page
    write_log(RunLog(rows={"B": run_of_a}, ended="2026-11-20T10:00:00Z"), folder / "run.json")
    run(folder, "-o", folder / "check.html")
    page = (folder / "check.html").read_text(encoding="utf-8")
    assert "walk-17.mp4" not in page, "another run's record"
    assert "date not recorded with savmap 0.0.7" in page


def test_the_sheet_to_sign_has_all_that_is_not_in_order_with_boxes(folder: Path) -> None:
    _, output = run(folder, "-o", folder / "check.html")
    assert f"wrote {folder / 'check-form.html'}\n" in output
    sheet = (folder / "check-form.html").read_text(encoding="utf-8")
    assert "size: A4" in sheet
    assert [title in sheet for title in ("height of post 2", "height of post 3", "height of post 1")] == [
        True,
        True,
        False,
    ]
    assert sheet.count("confirmed") == sheet.count("rejected") == 2
    assert "500 \u00b1 10 mm" in sheet
    assert '1000 mm<br><span class="quiet">made up' in sheet
    for words in ("SHA-256", "1 red, 1 amber, 0 unknown, 1 green", "rust", "decision", "qualification", "signature"):
        assert words in sheet
    assert 'href="check-form.html"' in (folder / "check.html").read_text(encoding="utf-8")


def test_it_is_written_beside_the_map_where_no_name_is_given(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (folder / "elsewhere").mkdir()
    monkeypatch.chdir(folder / "elsewhere")
    error, _ = run("..")
    assert error is None
    assert (folder / "inspection.html").is_file()
    assert list(Path().iterdir()) == []


def test_plugins_are_asked_with_depths_and_the_other_rows(
    installed: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    row = site().rows["A"]
    write_map(SiteMap({"A": row, "B": replace(row, name="B")}, {}), tmp_path / "map.json")
    asked: list[tuple[Any, Any]] = []

    def inspect(self: Posts, others: Any, depths: Any) -> RowInspection:
        asked.append((others, depths))
        return RowInspection()

    monkeypatch.setattr(Posts, "inspect", hookimpl(inspect))
    depths = FaceDepths(*np.eye(3), 1.0, np.zeros(1), np.zeros((1, 1, 1), np.float32), np.zeros((1, 1, 3)))
    monkeypatch.setattr(
        "savmap.apps.inspection.api.kept_depths", lambda folder, row: depths if row.name == "A" else None
    )
    savmap.inspect(tmp_path)
    assert [(list(others), given is depths) for others, given in asked] == [(["B"], True), (["A"], False)]
    assert [post.id for post in asked[0][0]["B"]] == ["post 1", "post 2", "post 3"]


def test_parts_of_rows_are_shown_on_sheets_and_written_as_files(folder: Path) -> None:
    _, output = run(folder, "-o", folder / "check.html")
    assert f"wrote {folder / 'check-sheets'}\n" in output
    assert sorted(path.name for path in (folder / "check-sheets").iterdir()) == [
        "A-post_1-LEFT.jpg",
        "A-post_2.jpg",
        "A-post_3.jpg",
    ]
    picture = cv2.imread(str(folder / "check-sheets" / "A-post_1-LEFT.jpg"))
    assert picture.shape == (300, 10, 3)
    sheets = (folder / "check-sheets.html").read_text(encoding="utf-8")
    assert sheets.count("<figure>") == sheets.count("Remarks:") == sheets.count("damaged") == 3
    assert "1 pixel is 10.0 mm: dents smaller than about 30 mm cannot be seen" in sheets
    assert "height of post 3: 1500 \u00b1 10 mm" in sheets
    first = sheets[: sheets.index("</ol>")]
    marks = dict(re.findall(r'<li style="bottom:([0-9.]+)%">([0-9.]+) m', first))
    assert marks == {"0.0": "0", "16.7": "0.5", "33.3": "1", "50.0": "1.5", "66.7": "2", "83.3": "2.5", "100.0": "3"}
    assert "<strong>LEFT</strong>" in sheets
    assert 'href="check-sheets.html"' in (folder / "check.html").read_text(encoding="utf-8")


def test_without_an_orthophoto_there_are_no_pictures(folder: Path) -> None:
    (folder / "face-A.jpg").unlink()
    assert run(folder, "-o", folder / "check.html")[0] is None
    assert not (folder / "check-sheets.html").exists()
    assert "<img" not in (folder / "check.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("plugins:\n  posts: {hight_m: {amber: 1, red: 2}}\n", "unknown key `hight_m`: did you mean `height_m`"),
        ("plugins:\n  posts: {height_m: {amber: 1, red: 1}}\n", "amber and red must differ"),
        (
            "plugins:\n  posts: {height_m: {amber: 1, red: 2}}\n",
            "`height_m`: small values are bad here, so red must be",
        ),
        ("plugins:\n  pots: {}\n", "plugins.pots: no such plugin; installed are "),
        ("plugin: {}\n", ":1: unknown key `plugin`: did you mean `plugins`?"),
        ("[1", "not valid YAML"),
        ("", "a file of limits is a mapping (see docs/inspection.md)"),
    ],
)
def test_limits_that_are_wrong_are_told_in_one_line(folder: Path, text: str, says: str) -> None:
    (folder / "limits.yaml").write_text(text, encoding="utf-8")
    error, _ = run(folder, "--limits", folder / "limits.yaml", "-o", folder / "check.html")
    assert isinstance(error, SiteError)
    assert str(error).startswith(str(folder / "limits.yaml"))
    assert says in str(error)
    assert "\n" not in str(error)
    assert not (folder / "check.html").exists()


def test_a_folder_without_a_map_is_told_how_to_get_one(tmp_path: Path) -> None:
    error, _ = run(tmp_path)
    assert isinstance(error, OutputError)
    assert str(error).startswith(f"{tmp_path / 'map.json'}: cannot be read (no such file")
    assert str(error).endswith(": there is no map; `savmap map` makes one")
    assert list(tmp_path.iterdir()) == []


def test_the_output_is_a_page(folder: Path) -> None:
    error, _ = run(folder, "-o", folder / "check.pdf")
    assert isinstance(error, OutputError)
    assert "name it .html" in str(error)
    assert not (folder / "check.csv").exists()
