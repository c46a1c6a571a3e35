"""`savmap compare`: two map files make lines, a JSON file, a page and an exit code."""

import json
import re
from dataclasses import replace
from pathlib import Path

import pytest
from made_up_dates import dated_site as site
from made_up_dates import grey_photo
from typer.testing import CliRunner

import savmap
from savmap.apps.dates.files import compare_files
from savmap.cli.app import app
from savmap.errors import ChangedError, NothingComparedError, OutputError
from savmap.maps.map_file import write_map
from savmap.maps.orthophoto_file import write_orthophoto
from savmap.maps.run_record import RowRun, RunLog, write_log


@pytest.fixture
def files(tmp_path: Path) -> tuple[Path, Path]:
    """Maps of two dates, each with an orthophoto beside it."""
    paths = []
    for name, made in (("old", site(1)), ("new", site(2, lifted_m=0.06))):
        (tmp_path / name).mkdir()
        write_map(made, tmp_path / name / "map.json")
        write_orthophoto("A", grey_photo(90), tmp_path / name)
        paths.append(tmp_path / name / "map.json")
    return paths[0], paths[1]


def run(*arguments: object) -> tuple[BaseException | None, str]:
    result = CliRunner().invoke(app, ["compare", *map(str, arguments)])
    return result.exception, result.output


def test_command_says_what_changed(files: tuple[Path, Path]) -> None:
    error, output = run(*files)
    assert error is None
    assert re.search(r"moved    bay 3 / beam 3     y \+\d\d mm", output)
    assert re.search(r"changed  bay 3 / opening 2  size y \+\d\d mm", output)
    assert re.search(r"changed  bay 3 / opening 3  size y -\d\d mm", output)
    assert "1 moved, 24 same; openings: 2 changed, 18 same" in output


def test_changes_end_with_their_own_code_if_asked(files: tuple[Path, Path]) -> None:
    error, _ = run(*files, "--exit-code")
    assert isinstance(error, ChangedError)
    assert error.exit_code == 13
    assert run(files[0], files[0], "--exit-code")[0] is None


def test_maps_that_say_nothing_of_one_another_have_their_own_code(files: tuple[Path, Path], tmp_path: Path) -> None:
    made = site(1)
    write_map(replace(made, rows={"B": replace(made.rows["A"], name="B")}), tmp_path / "renamed.json")
    write_map(replace(made, rows={"A": replace(made.rows["A"], structures={})}), tmp_path / "empty.json")
    for name, why in (("renamed", "no row in common"), ("empty", "nothing in common was found in row A")):
        assert run(files[0], tmp_path / f"{name}.json")[0] is None, "not asked for"
        error, _ = run(files[0], tmp_path / f"{name}.json", "--exit-code")
        assert isinstance(error, NothingComparedError)
        assert error.exit_code == 14
        assert str(error).startswith(f"{tmp_path / name}.json: cannot be compared with {files[0]}: {why}")


def test_a_row_that_cannot_be_compared_hides_no_change_and_is_no_success(
    files: tuple[Path, Path], tmp_path: Path
) -> None:
    for name, made in (("old", site(1)), ("same", site(2)), ("new", site(2, lifted_m=0.06))):
        gone = replace(made.rows["A"], name="B", structures={} if name != "old" else made.rows["A"].structures)
        write_map(replace(made, rows={**made.rows, "B": gone}), tmp_path / f"{name}.json")
    error, _ = run(tmp_path / "old.json", tmp_path / "same.json", "--exit-code")
    assert isinstance(error, NothingComparedError)
    assert "nothing is known of row B" in str(error)
    assert isinstance(run(tmp_path / "old.json", tmp_path / "new.json", "--exit-code")[0], ChangedError)


@pytest.mark.slow
def test_a_scale_that_differs_is_a_change(files: tuple[Path, Path], tmp_path: Path) -> None:
    made = site(2)
    row = made.rows["A"]
    larger = {
        name: tuple(replace(one, vertices=1.063 * one.vertices) for one in group)
        for name, group in row.structures.items()
    }
    write_map(replace(made, rows={"A": replace(row, structures=larger)}), tmp_path / "larger.json")
    error, output = run(files[0], tmp_path / "larger.json", "--exit-code", "-o", tmp_path / "compare.html")
    assert isinstance(error, ChangedError)
    said = re.search(r"scale of the new map against the old one's: x \+6\.\d+ % \(\+- 0\.\d+ %", output)
    assert said is not None
    page = (tmp_path / "compare.html").read_text(encoding="utf-8")
    assert "differ in scale by more than their references allow" in page
    assert "scale of the new map against the old one" in page
    assert "rows of another scale" in page
    assert "Nothing changed by more than chance." not in page


def test_json_holds_all_elements(files: tuple[Path, Path], tmp_path: Path) -> None:
    assert run(*files, "--json", tmp_path / "changes.json")[0] is None
    content = json.loads((tmp_path / "changes.json").read_text(encoding="utf-8"))
    assert content["format"] == "savmap-comparison"
    assert [one["new"] for one in content["rows"][0]["elements"] if one["state"] == "moved"] == ["bay 3 / beam 3"]
    assert len(content["rows"][0]["openings"]) == 20


def test_page_shows_both_dates_and_the_photographs(files: tuple[Path, Path], tmp_path: Path) -> None:
    write_log(RunLog(rows={"A": RowRun(status="mapped")}, ended="2026-05-01T10:00:00Z"), files[0].parent / "run.json")
    compare_files(*files, 0.05, tmp_path / "compare.html")
    page = (tmp_path / "compare.html").read_text(encoding="utf-8")
    assert f"<dd>{files[0]}, mapped on 2026-05-01</dd>" in page
    assert f"<dd>{files[1]}, date not recorded</dd>" in page
    assert "<div><dt>upright: stand or lean otherwise</dt><dd>0</dd></div>" in page
    assert "both read the same" in page
    assert page.count('<image href="data:image/jpeg;base64,') == 2
    assert "Row A: both dates" in page
    assert re.search(r"<title>bay 3 / beam 3: moved y \+\d\d mm", page)
    assert "expected to be chance" in page


def test_page_says_where_nothing_changed(files: tuple[Path, Path], tmp_path: Path) -> None:
    compare_files(files[0], files[0], 0.05, tmp_path / "compare.html")
    assert "Nothing changed by more than chance." in (tmp_path / "compare.html").read_text(encoding="utf-8")


def test_page_escapes_what_structures_are_called(tmp_path: Path) -> None:
    made = site(1)
    rows = {
        "A": replace(
            made.rows["A"],
            structures={
                "shelves": (
                    replace(made.rows["A"].structures["shelves"][0], id="<script>alert(1)</script>"),
                    *made.rows["A"].structures["shelves"][1:],
                )
            },
        )
    }
    write_map(replace(made, rows=rows), tmp_path / "old.json")
    less = replace(made.rows["A"], structures={"shelves": made.rows["A"].structures["shelves"][1:]})
    write_map(replace(made, rows={"A": less}), tmp_path / "new.json")
    compare_files(tmp_path / "old.json", tmp_path / "new.json", 0.05, tmp_path / "compare.html")
    page = (tmp_path / "compare.html").read_text(encoding="utf-8")
    assert "&lt;script&gt;alert(1)" in page
    assert "<script>alert(1)" not in page


def test_page_draws_each_plugins_own_structure(tmp_path: Path) -> None:
    paths = []
    for name, made in (("old", site(1)), ("new", site(2, lifted_m=0.06))):
        row = made.rows["A"]
        namesake = replace(row.structures["shelves"][1], id="bay 3 / beam 3", label="lamp")
        rows = {"A": replace(row, structures={**row.structures, "zones": (namesake,)})}
        write_map(replace(made, rows=rows), tmp_path / f"{name}.json")
        paths.append(tmp_path / f"{name}.json")
    compare_files(*paths, 0.05, tmp_path / "compare.html")
    page = (tmp_path / "compare.html").read_text(encoding="utf-8")
    drawn = re.search(r'<path d="M(\S+)[^>]*><title>bay 3 / beam 3: moved', page)
    assert drawn is not None
    assert float(drawn[1].split(",")[0]) > 5000, "not the lamp of that id, which is at 0.1 m"


def test_command_takes_folders_and_writes_the_viewer(files: tuple[Path, Path]) -> None:
    old, new = (file.parent for file in files)
    error, output = run(old, new, "--view", "-o", new / "pages" / "compare.html")
    assert error is None
    assert f"wrote {new / 'view.html'}" in output
    assert '<a href="../view.html">Viewer</a>' in (new / "pages" / "compare.html").read_text(encoding="utf-8")
    assert (new / "face" / "old" / "A.js").is_file()


def test_page_is_named_html(files: tuple[Path, Path], tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"name it \.html"):
        compare_files(*files, 0.05, tmp_path / "compare.pdf")


def test_python_compares_records_and_files(files: tuple[Path, Path]) -> None:
    from_files = savmap.compare(*files)
    assert from_files.rows[0].changes[0].name == "bay 3 / beam 3"
    from_records = savmap.compare(savmap.load_map(files[0]), savmap.load_map(files[1]), level=0.01)
    assert len(from_records.rows[0].changes) == 3
    assert from_records.level == 0.01
    old, new = (file.parent for file in files)
    from_folders = savmap.compare(str(old), new)
    assert [one.name for one in from_folders.rows[0].changes] == [one.name for one in from_files.rows[0].changes]


def test_python_says_which_folder_has_no_map(files: tuple[Path, Path], tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"map\.json: cannot be read \(no such file"):
        savmap.compare(tmp_path, files[1])
