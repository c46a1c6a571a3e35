"""`savmap export`: PLY, CSV and plugins' formats, whole or not at all."""

import csv
import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from savmap.cli.commands.results import export
from savmap.errors import OutputError, PluginError, SiteError
from savmap.maps.exports import format_of
from savmap.maps.exports.marks import bytes_of, colours
from savmap.maps.map_file import write_map
from savmap.plugin import manager
from savmap.plugin.hookspecs import Exporter, hookimpl
from savmap.plugin.manager import exporters
from savmap.types import Alignment, FrameTable, Placement, RowMap, SiteMap, Structure, Trajectory


def thing(name: str, label: str, x: float) -> Structure:
    vertices = x + np.array([[0.0, 0, 0], [1, 0, 0], [1, 2, 0]])
    labels = tuple(f"{name} / {corner}" for corner in "abc")
    return Structure(name, label, vertices, np.tile(1e-4 * np.eye(3), (3, 1, 1)), labels, np.array([[0, 1], [1, 2]]))


def row(name: str) -> RowMap:
    path = Trajectory(np.arange(2), np.tile(np.eye(4), (2, 1, 1)), np.full((2, 3), 0.01))
    table = FrameTable(np.arange(2.0), ("pass 1",) * 2)
    found = {"racks": (thing("post 1", "post", 0.0), thing("bar 1", "bar", 5.0)), "lamps": ()}
    return RowMap(name, table, {}, path, found, (), {})


@pytest.fixture
def one(tmp_path: Path) -> Path:
    write_map(SiteMap({"A": row("A")}, {"savmap": "0"}), tmp_path / "one.json")
    return tmp_path / "one.json"


@pytest.fixture
def two(tmp_path: Path) -> Path:
    write_map(SiteMap({"A": row("A"), "B": row("B")}, {"savmap": "0"}), tmp_path / "two.json")
    return tmp_path / "two.json"


def test_ply_has_vertices_edges_and_a_colour_for_each_label(
    one: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "new" / "map.ply"
    export(one, path, "ply")
    assert capsys.readouterr().out.splitlines()[0] == f"wrote {path}"
    head, body = path.read_text(encoding="ascii").split("end_header\n")
    assert head.startswith("ply\nformat ascii 1.0\n")
    assert "element vertex 6\n" in head
    assert "element edge 4\n" in head
    lines = [line.split() for line in body.splitlines()]
    assert [float(value) for value in lines[5][:3]] == [6.0, 7.0, 5.0]
    colour = {label: tuple(map(str, bytes_of(value))) for label, value in colours(["post", "bar"]).items()}
    assert [tuple(line[3:]) for line in lines[:6]] == [*[colour["post"]] * 3, *[colour["bar"]] * 3]
    assert lines[6:] == [["0", "1"], ["1", "2"], ["3", "4"], ["4", "5"]]


def test_a_row_without_a_place_is_noted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    placed, aligned = Placement(0, 0, 0, np.zeros((3, 3))), Alignment(5.0, 6.0, 0.0, np.zeros((3, 3)))
    site = SiteMap({"A": row("A"), "B": row("B")}, {"savmap": "0"}, placements={"A": placed}, alignment=aligned)
    write_map(site, tmp_path / "map.json")
    export(tmp_path / "map.json", tmp_path / "b.json", "nerfstudio", "B")
    assert "note: row B has no place in the site's frame" in capsys.readouterr().out
    frames = json.loads((tmp_path / "b.json").read_text())["frames"]
    assert np.array(frames[0]["transform_matrix"])[:3, 3] == pytest.approx([0, 0, 0])
    export(tmp_path / "map.json", tmp_path / "a.json", "nerfstudio", "A")
    assert "note" not in capsys.readouterr().out


def test_csv_has_a_line_a_vertex(two: Path, tmp_path: Path) -> None:
    export(two, tmp_path / "map.csv", "csv")
    with (tmp_path / "map.csv").open(encoding="utf-8", newline="") as file:
        lines = list(csv.DictReader(file))
    assert len(lines) == 12
    last = lines[-1]
    assert (last["row"], last["plugin"], last["label"], last["vertex"]) == ("B", "racks", "bar", "bar 1 / c")
    assert [float(last[f"{axis}_m"]) for axis in "xyz"] == [6.0, 7.0, 5.0]
    assert float(last["sigma_x_m"]) == pytest.approx(0.01)


def test_csv_for_excel_has_the_mark_of_utf_8(two: Path, tmp_path: Path) -> None:
    for bom in (False, True):
        export(two, tmp_path / f"{bom}.csv", bom=bom)
    assert (tmp_path / "True.csv").read_bytes() == b"\xef\xbb\xbf" + (tmp_path / "False.csv").read_bytes()
    with pytest.raises(SiteError, match="--bom is for CSV, not for ply"):
        export(two, tmp_path / "map.ply", "ply", bom=True)
    assert not (tmp_path / "map.ply").exists()


def test_rows_with_frames_of_their_own_are_not_mixed(two: Path, tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"rows A, B have no place in the site's frame: .* or choose one with --row"):
        export(two, tmp_path / "map.ply", "ply")
    export(two, tmp_path / "map.ply", "ply", row="B")
    assert "row B" in (tmp_path / "map.ply").read_text(encoding="ascii")
    with pytest.raises(SiteError, match="--row C"):
        export(two, tmp_path / "map.ply", "ply", row="C")


def placed_site(tmp_path: Path, *names: str) -> Path:
    """Two rows, those of `names` placed: A at (10, -3), a quarter turn to the left; B as the site's frame."""
    places = {
        "A": Placement(10.0, -3.0, 90.0, np.diag([0.01, 0.04, 0.0])),
        "B": Placement(0.0, 0.0, 0.0, np.diag([0.0, 0.0, np.degrees(0.1) ** 2])),
    }
    rows = {"A": row("A"), "B": row("B")}
    write_map(SiteMap(rows, {"savmap": "0"}, placements={name: places[name] for name in names}), tmp_path / "site.json")
    return tmp_path / "site.json"


def test_rows_that_are_placed_are_exported_in_the_sites_frame(tmp_path: Path) -> None:
    site = placed_site(tmp_path, "A", "B")
    export(site, tmp_path / "map.csv", "csv")
    with (tmp_path / "map.csv").open(encoding="utf-8", newline="") as file:
        lines = [line for line in csv.DictReader(file) if line["structure"] == "bar 1"]
    first, other = lines[2], lines[5]
    assert (first["row"], first["frame"], other["row"], other["frame"]) == ("A", "site", "B", "site")
    assert [float(first[f"{axis}_m"]) for axis in "xyz"] == pytest.approx([10 + 5, 7, -3 - 6])
    assert [float(first[f"sigma_{axis}_m"]) for axis in "xyz"] == pytest.approx([0.1005, 0.01, 0.2002], abs=1e-4)
    assert [float(other[f"{axis}_m"]) for axis in "xyz"] == pytest.approx([6, 7, 5])
    assert [float(other[f"sigma_{axis}_m"]) for axis in "xyz"] == pytest.approx([0.5001, 0.01, 0.6001], abs=1e-4)
    export(site, tmp_path / "map.ply", "ply")
    head, body = (tmp_path / "map.ply").read_text(encoding="ascii").split("end_header\n")
    assert "comment savmap site, rows A, B, metres\n" in head
    assert "element vertex 12\n" in head
    assert [float(value) for value in body.splitlines()[5].split()[:3]] == pytest.approx([15, 7, -9])
    assert body.splitlines()[-1] == "10 11"


def test_a_row_without_a_place_keeps_its_own_frame(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    site = placed_site(tmp_path, "A")
    export(site, tmp_path / "map.csv", "csv")
    with (tmp_path / "map.csv").open(encoding="utf-8", newline="") as file:
        frames = {(line["row"], line["frame"]) for line in csv.DictReader(file)}
    assert frames == {("A", "site"), ("B", "row")}
    capsys.readouterr()
    export(site, tmp_path / "map.ply", "ply")
    said = capsys.readouterr().out
    assert "note: rows B have no place in the site's frame and are left out" in said
    assert "rows A, metres" in (tmp_path / "map.ply").read_text(encoding="ascii")
    export(site, tmp_path / "map.ply", "ply", row="B")
    assert "row B, metres" in (tmp_path / "map.ply").read_text(encoding="ascii")


def test_unknown_format_names_the_known_ones(one: Path, tmp_path: Path) -> None:
    with pytest.raises(SiteError, match="format obj: known formats are colmap, csv, "):
        export(one, tmp_path / "map.obj", "obj")


def test_a_plugins_format_is_written_whole_or_not_at_all(
    one: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def half(site: SiteMap, path: Path) -> None:
        path.write_text("half", encoding="utf-8")
        if "A" in site.rows:
            raise ValueError("no more")

    def fine(site: SiteMap, path: Path) -> None:
        path.write_text("fine", encoding="utf-8")

    def formats(self: object) -> Mapping[str, Exporter]:
        return {"half": half, "csv": fine}

    monkeypatch.setattr(manager.load_class("lights"), "exporters", hookimpl(formats), raising=False)
    before = set(tmp_path.iterdir())
    with pytest.raises(PluginError, match="exporter `half` failed: ValueError: no more"):
        export(one, tmp_path / "map.half", "half")
    assert set(tmp_path.iterdir()) == before
    export(one, tmp_path / "map.csv", "csv")
    assert (tmp_path / "map.csv").read_text(encoding="utf-8") == "fine"
    with pytest.raises(OutputError, match="cannot be written"):
        export(one, one / "map.csv", "csv")


@pytest.mark.parametrize(("file", "name"), [("a.ply", "ply"), ("hall.lif.json", "lif"), ("b.x", "x")])
def test_the_ending_tells_the_format(file: str, name: str) -> None:
    assert format_of(Path(file), (*exporters(), "x")) == name


@pytest.mark.parametrize("file", ["a", "a.json", "a.zip", "lif.json", ".ply"])
def test_an_ending_that_tells_none_is_refused_with_the_formats(file: str) -> None:
    with pytest.raises(SiteError, match=r"its ending tells no format; give one with --format: colmap, csv, dxf"):
        format_of(Path(file), exporters())
