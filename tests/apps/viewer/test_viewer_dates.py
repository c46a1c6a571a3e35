"""Two dates in the viewer's page: what it holds of the old one, and when it is written."""

import base64
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_up_dates import dated_site, grey_photo
from made_up_map import data_of, jpeg, stills
from typer.testing import CliRunner

from savmap.apps.dates.comparison.compare import compare_maps
from savmap.apps.dates.comparison.records import Comparison, RowComparison, RowMotion
from savmap.apps.viewer.beside import viewed
from savmap.apps.viewer.data import Before, old_place
from savmap.apps.viewer.page import View, write_view
from savmap.cli.app import app
from savmap.maps.map_file import write_map
from savmap.maps.orthophoto_file import write_orthophoto
from savmap.types import Placement, SiteMap

OLD = dated_site(1, without=("bay 4 / beam 2",), moved_m=0.7)
NEW = dated_site(2, lifted_m=0.03, without=("bay 2 / beam 3",))


def written(folder: Path, old: SiteMap, new: SiteMap, **options: Any) -> dict[str, Any]:
    write_view(View(new, before=Before(old, compare_maps(old, new), **options)), folder / "view.html")
    return data_of(folder / "view.html")


def test_old_elements_lie_in_the_new_frame(tmp_path: Path) -> None:
    (row,) = written(tmp_path, OLD, NEW)["rows"]
    motion = compare_maps(OLD, NEW).rows[0].motion
    assert motion is not None
    places = np.array(row["before"]["positions"]).reshape(-1, 3) * 1e-5
    old = OLD.rows["A"].structures["shelves"]
    assert np.allclose(places, motion.points(np.concatenate([one.vertices for one in old])), atol=1e-5)
    assert motion.shift_m[0] == pytest.approx(0.7, abs=0.02)
    assert [entry["id"] for entry in row["before"]["structures"]] == [one.id for one in old]


def test_changes_name_elements_of_both_dates(tmp_path: Path) -> None:
    (row,) = written(tmp_path, OLD, NEW)["rows"]
    old, new = ([entry["id"] for entry in part["structures"]] for part in (row["before"], row))
    told = {
        (change["state"], None if change["old"] is None else old[change["old"]], change["new"] and new[change["new"]])
        for change in row["before"]["changes"]
        if change["state"] != "same"
    }
    assert told == {
        ("missing", "bay 2 / beam 3", None),
        ("new", None, "bay 4 / beam 2"),
        ("moved", "bay 3 / beam 3", "bay 3 / beam 3"),
    }
    figures = next(one["tested"] for one in row["before"]["changes"] if one["state"] == "moved")
    ((by, sigma),) = ((by, sigma) for what, by, sigma, told_ in figures if what == "y" and told_)
    assert by * 1e-5 == pytest.approx(0.03, abs=0.005)
    assert 0 < sigma * 1e-5 < 0.005


def test_rows_of_one_date_are_told(tmp_path: Path) -> None:
    old = SiteMap({**OLD.rows, "B": replace(OLD.rows["A"], name="B")}, {})
    new = SiteMap({**NEW.rows, "C": replace(NEW.rows["A"], name="C")}, {})
    data = written(tmp_path, old, new)
    assert (data["dates"]["missing"], data["dates"]["new"]) == (["B"], ["C"])
    assert data["rows"][1]["before"] is None


def test_rows_with_nothing_in_common_have_no_old_date(tmp_path: Path) -> None:
    before = Before(OLD, Comparison((RowComparison("A", "A", None),), (), (), 0.1), {"A": grey_photo(50)})
    write_view(View(NEW, before=before), tmp_path / "view.html")
    assert data_of(tmp_path / "view.html")["rows"][0]["before"] is None
    assert not (tmp_path / "face").exists()


def test_old_orthophoto_is_carried_and_goes_with_the_dates(tmp_path: Path) -> None:
    (row,) = written(tmp_path, OLD, NEW, photos={"A": grey_photo(50)})["rows"]
    face, x = row["before"]["face"], row["before"]["motion"]["shift_m"][0]
    assert face["origin_m"][0] == pytest.approx(-0.5 + x, abs=0.01)
    assert face["width_m"] == pytest.approx(15.0, rel=1e-3)
    assert {path.name for path in (tmp_path / "face" / "old").iterdir()} == {"A.js", "small"}
    write_view(View(NEW), tmp_path / "view.html")
    assert not list((tmp_path / "face").rglob("*.js"))


def test_covariances_turn_with_the_frame(tmp_path: Path) -> None:
    quarter = RowMotion(np.zeros(3), 90.0, np.eye(4), np.zeros(3), np.zeros(3), 9)
    long = [
        replace(one, covariances=np.tile(np.diag([9e-6, 4e-6, 1e-6]), (4, 1, 1)))
        for one in (*OLD.rows["A"].structures["shelves"],)
    ]
    old = SiteMap({"A": replace(OLD.rows["A"], structures={"shelves": tuple(long)})}, {})
    before = Before(old, Comparison((RowComparison("A", "A", quarter),), (), (), 0.1))
    write_view(View(NEW, before=before), tmp_path / "view.html")
    (row,) = data_of(tmp_path / "view.html")["rows"]
    assert np.allclose(row["before"]["covariances"][:6], [1e-6, 0, 0, 4e-6, 0, 9e-6], atol=1e-12)


@pytest.fixture
def folders(tmp_path: Path) -> tuple[Path, Path]:
    for name, made in (("old", OLD), ("new", NEW)):
        (tmp_path / name).mkdir()
        write_map(made, tmp_path / name / "map.json")
        write_orthophoto("A", grey_photo(90), tmp_path / name)
    return tmp_path / "old", tmp_path / "new"


def test_page_against_an_old_map_is_written_once(folders: tuple[Path, Path]) -> None:
    old, new = folders
    page, written_now = viewed(new)
    assert written_now
    assert data_of(page)["dates"] is None
    assert viewed(new, against=old) == (page, True)
    assert viewed(new, against=old / "map.json") == viewed(new) == (page, False)  # none is asked for
    assert data_of(page)["dates"] is not None
    write_map(dated_site(3), old / "map.json")
    assert viewed(new, against=old) == (page, True)
    assert viewed(new, fresh=True) == (page, True)
    assert data_of(page)["dates"] is None


def test_view_command_takes_an_old_date(folders: tuple[Path, Path]) -> None:
    old, new = folders
    result = CliRunner().invoke(app, ["view", str(new), "--against", str(old), "--no-open"])
    assert result.exit_code == 0, result.output
    assert data_of(new / "view.html")["rows"][0]["before"]["face"]["pictures"] == [
        "face/old/small/A.js",
        "face/old/A.js",
    ]


def test_report_tells_what_changed(folders: tuple[Path, Path], tmp_path: Path) -> None:
    old, new = folders
    page = tmp_path / "report.html"
    arguments = ["report", str(new / "map.json"), "-o", str(page)]
    assert CliRunner().invoke(app, arguments).exit_code == 0
    assert 'id="changes"' not in page.read_text(encoding="utf-8")
    result = CliRunner().invoke(app, [*arguments, "--against", str(old)])
    assert result.exit_code == 0, result.output
    section = page.read_text(encoding="utf-8").split('<section id="changes">')[1].split("</section>")[0]
    assert "1 missing, 1 moved, 1 new, 22 same" in section
    assert re.search(r"bay 3 / beam 3.*?y \+\d+ mm", section, re.DOTALL)


MOVED, LATER = dated_site(1, moved_m=0.7), dated_site(2)
NONE = np.zeros((3, 3))


def with_gone(**places: Placement) -> SiteMap:
    return SiteMap({**MOVED.rows, "B": replace(MOVED.rows["A"], name="B")}, {}, {}, places)


def test_row_of_the_old_date_is_in_the_page(tmp_path: Path) -> None:
    old = with_gone()
    before = Before(old, compare_maps(old, LATER), {"B": grey_photo(40)})
    write_view(View(LATER, before=before), tmp_path / "view.html")
    kept, gone = data_of(tmp_path / "view.html")["rows"]
    assert ("gone" in kept, gone["gone"], gone["name"], gone["structures"]) == (False, True, "B", [])
    assert gone["placement"] is None
    ids = [one["id"] for one in gone["before"]["structures"]]
    assert ids == [one.id for one in old.rows["B"].structures["shelves"]]
    assert gone["before"]["face"]["pictures"] == ["face/old/small/B.js", "face/old/B.js"]
    assert (tmp_path / "face" / "old" / "B.js").is_file()


def test_gone_row_is_placed_as_its_neighbour_is() -> None:
    old = with_gone(A=Placement(10.0, 4.0, 90.0, NONE), B=Placement(10.0, 0.0, -90.0, NONE))
    new = SiteMap(LATER.rows, {}, {}, {"A": Placement(3.0, 1.0, 0.0, NONE)})
    before = Before(old, compare_maps(old, new))
    found = old_place(before, new, "B")
    assert found is not None
    # row B is turned by half a turn, and 4 m along -z of the old site: along +x of row A, which begins 0.7 m further on
    assert [found.x_m, found.z_m] == pytest.approx([3.0 + 4.0 + 0.7, 1.0], abs=0.03)
    assert abs(found.heading_deg) == pytest.approx(180.0, abs=0.3)
    assert old_place(before, SiteMap(LATER.rows, {}), "B") is None  # nobody knows how the sites lie on one another


def test_old_panoramas_are_copied_and_carried(tmp_path: Path) -> None:
    spring, autumn = tmp_path / "spring", tmp_path / "autumn"
    write_view(View(MOVED, stills={"A": stills()}), spring / "view.html")
    (spring / "pano" / "A-00003.js").write_text("alert(1)")  # nothing that savmap wrote
    motion = compare_maps(MOVED, LATER).rows[0].motion
    assert motion is not None
    before = Before(MOVED, compare_maps(MOVED, LATER), folder=spring)
    write_view(View(LATER, before=before), autumn / "view.html")
    (row,) = data_of(autumn / "view.html")["rows"]
    frames = [still.frame for still in stills()]
    assert [one["frame"] for one in row["before"]["stills"]] == row["before"]["frames"]["number"] == frames
    places = np.array(row["before"]["frames"]["position"]).reshape(-1, 3) * 1e-5
    assert np.allclose(places, motion.points(MOVED.rows["A"].trajectory.world_from_rig[frames, :3, 3]), atol=1e-5)
    path = autumn / "pano" / "old" / "A-00006.js"
    written = path.read_text(encoding="utf-8")
    assert written.startswith('savmapPart("pano/old/A-00006.js", "data:image/jpeg;base64,')
    assert base64.b64decode(written.split(",")[2].split('"')[0]) == jpeg(64, 32, 94).tobytes()
    write_view(View(LATER), autumn / "view.html")
    assert not path.exists()


def test_old_path_without_pictures_takes_no_room(tmp_path: Path) -> None:
    write_view(
        View(LATER, before=Before(MOVED, compare_maps(MOVED, LATER), folder=tmp_path / "none")), tmp_path / "view.html"
    )
    (row,) = data_of(tmp_path / "view.html")["rows"]
    assert row["before"]["stills"] == row["before"]["frames"]["position"] == []
