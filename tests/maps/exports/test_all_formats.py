"""What holds for every format: the same map gives the same bytes, hostile names do no harm, a missing library is named
with its extra, and a map that a format cannot hold is refused, with nothing written."""

import io
import os
import subprocess
import sys
import zipfile
from dataclasses import replace
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

import savmap
from savmap.errors import OutputError, visible
from savmap.maps.exports import OneFrame
from savmap.maps.map_file import read_map, write_map
from savmap.plugin.manager import exporters
from savmap.types import FrameTable, MapWarning, RowMap, SiteMap, Trajectory, Verdict
from savmap.types.maps import UNCHECKED

from .plans.made_up_hall import hall

LIBRARIES = {
    "usdc": ("pxr.Sdf", "usd"),
    "ifc": ("ifcopenshell", "bim"),
    "ifc4x3": ("ifcopenshell", "bim"),
    "dxf": ("ezdxf", "cad"),
    "mcap": ("mcap", "ros"),
    "rosbag2": ("mcap_ros2", "ros"),
    "rrd": ("rerun", "rerun"),
}
PLANS = ("nav2", "lif", "geojson")
ARCHIVES = ("tum", "colmap", "nav2")
AGAIN = """
import sys
from pathlib import Path
from savmap.plugin.manager import exporters
from savmap.maps.map_file import read_map

for name in sys.argv[2:]:
    exporters()[name](read_map(Path(sys.argv[1])), Path(sys.argv[1]).parent / f"{name}.zip")
"""


def each(*names: str) -> list[object]:
    return [
        pytest.param(name, marks=[pytest.mark.extra(LIBRARIES[name][1])] if name in LIBRARIES else []) for name in names
    ]


FORMATS = [name for name, exporter in exporters().items() if isinstance(exporter, OneFrame)]
SAME = [name for name in FORMATS if name != "rrd"]  # rerun's recordings hold the time when they were made


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a map, and with its exports as another process writes them, whose sets have another order."""
    map_file = tmp_path_factory.mktemp("written") / "map.json"
    write_map(hall(), map_file)
    here = [name for name in SAME if name not in LIBRARIES or find_spec(LIBRARIES[name][0].partition(".")[0])]
    settings = {"PYTHONHASHSEED": "7", "SOURCE_DATE_EPOCH": "1770000000"}
    command = [sys.executable, "-c", AGAIN, str(map_file), *here]
    subprocess.run(command, check=True, timeout=600, env={**os.environ, **settings})
    return map_file.parent


@pytest.mark.slow
@pytest.mark.parametrize("name", each(*SAME))
def test_the_same_map_gives_the_same_bytes(
    name: str, written: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1770000000")
    first = savmap.export(read_map(written / "map.json"), tmp_path / "first.zip", name)
    assert first.read_bytes() == (written / f"{name}.zip").read_bytes()


@pytest.mark.parametrize("name", each(*LIBRARIES))
def test_a_missing_library_is_named(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    module, extra = LIBRARIES[name]
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(OutputError, match=rf"needs {module}: pip install 'savmap\[{extra}\]'"):
        savmap.export(hall(), tmp_path / "map", name)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", each(*FORMATS))
def test_hostile_names_do_no_harm(name: str, tmp_path: Path) -> None:
    path = savmap.export(hall(), tmp_path / "out" / ("a.zip" if name in ARCHIVES else "a"), name)
    assert [written.name for written in tmp_path.iterdir()] == ["out"]
    assert [written.name for written in path.parent.iterdir()] == [path.name]
    if path.suffix == ".zip":
        with zipfile.ZipFile(path) as archive:
            names, texts = archive.namelist(), [archive.read(member) for member in archive.namelist()]
        assert not [part for text in names for part in text.split("/") if part in ("", ".", "..")]
    else:
        texts = [path.read_bytes()]
    if name in (*PLANS, "csv", "ply", "glb"):
        assert not any("\u202e".encode() in text for text in texts)


SILENT = ("usdc", "rrd")  # binary: as usda and mcap


@pytest.mark.parametrize("name", each(*(name for name in FORMATS if name not in SILENT)))
def test_what_must_be_checked_and_what_nothing_checks_is_said(name: str, tmp_path: Path) -> None:
    """Nav2, LIF and PLY of a row that must be checked said nothing; a length 20 cm too long was in no format."""
    whole, warning = hall(), MapWarning("lens-seam", figure="3 cm")
    parts = {
        plugin: tuple(replace(part, attributes={**part.attributes, UNCHECKED: 0.47}) for part in group)
        for plugin, group in whole.rows["A"].structures.items()
    }
    doubted = replace(whole.rows["A"], structures=parts, verdict=Verdict((warning,)))
    path = savmap.export(replace(whole, rows={**whole.rows, "A": doubted}), tmp_path / "a.zip", name)
    if name in ("mcap", "rosbag2"):
        reader = import_module("mcap.reader").make_reader(io.BytesIO(path.read_bytes()))
        texts = [message.data for _, _, message in reader.iter_messages()]
    elif name in ARCHIVES:
        with zipfile.ZipFile(path) as archive:
            texts = [archive.read(member) for member in archive.namelist()]
    else:
        texts = [path.read_bytes()]
    assert any(b"the pictures are bent at a seam, 3 cm" in text for text in texts)
    assert any(b"0.47" in text for text in texts)


@pytest.mark.parametrize("name", each("nav2", "lif", "tum", "colmap", "nerfstudio"))
def test_a_map_with_nothing_in_it_is_refused(name: str, tmp_path: Path) -> None:
    nowhere = Trajectory(np.zeros(0, np.int64), np.zeros((0, 4, 4)))
    empty = RowMap("A", FrameTable(np.zeros(0), ()), {}, nowhere, {}, ())
    for path in (tmp_path / "a.txt", tmp_path / "a.zip"):
        with pytest.raises(OutputError, match=r"stands in the way|no camera path"):
            savmap.export(SiteMap({"A": empty}, {}), path, name)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", each(*(name for name in SAME if name != "csv")))
def test_a_row_without_a_place_is_left_out_and_named(
    name: str, tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1770000000")
    placed, last = hall(), list(hall().rows)[-1]
    places = {row: place for row, place in placed.placements.items() if row != last}
    savmap.export(replace(placed, placements=places), tmp_path / "a.zip", name)
    (record,) = caplog.records
    assert record.message.startswith(
        f"rows {visible(last)} have no place in the site's frame and are left out: give them a `place`"
    )
    rest = {row: one for row, one in placed.rows.items() if row != last}
    savmap.export(replace(placed, rows=rest, placements=places), tmp_path / "b.zip", name)
    assert (tmp_path / "a.zip").read_bytes() == (tmp_path / "b.zip").read_bytes()


@pytest.mark.parametrize("name", each(*(name for name in FORMATS if name != "csv")))
def test_rows_without_a_common_frame_are_refused(name: str, tmp_path: Path) -> None:
    unplaced = replace(hall(), placements={})
    with pytest.raises(OutputError, match=r"have no place in the site's frame: .* or choose one with --row"):
        savmap.export(unplaced, tmp_path / "a.zip", name)
    assert not list(tmp_path.iterdir())
