"""Rows and panoramas of the old date alone: where they lie in the page and beside it."""

import base64
import gzip
import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_up_dates import dated_site, grey_photo
from made_up_map import jpeg, stills

from savmap.maps.comparison import compare_maps
from savmap.report.viewer import Before, View, write_view
from savmap.report.viewer.gone import old_place
from savmap.types import Placement, SiteMap

OLD, NEW = dated_site(1, moved_m=0.7), dated_site(2)
NONE = np.zeros((3, 3))


def data_of(page: Path) -> dict[str, Any]:
    packed = re.search(r'id="map">([^<]*)</script>', page.read_text(encoding="utf-8"))
    assert packed
    found: dict[str, Any] = json.loads(gzip.decompress(base64.b64decode(packed[1])))
    return found


def with_gone(**places: Placement) -> SiteMap:
    return SiteMap({**OLD.rows, "B": replace(OLD.rows["A"], name="B")}, {}, {}, places)


def test_row_of_the_old_date_is_in_the_page(tmp_path: Path) -> None:
    old = with_gone()
    before = Before(old, compare_maps(old, NEW), {"B": grey_photo(40)})
    write_view(View(NEW, before=before), tmp_path / "view.html")
    kept, gone = data_of(tmp_path / "view.html")["rows"]
    assert ("gone" in kept, gone["gone"], gone["name"], gone["structures"]) == (False, True, "B", [])
    assert gone["placement"] is None
    ids = [one["id"] for one in gone["before"]["structures"]]
    assert ids == [one.id for one in old.rows["B"].structures["shelves"]]
    assert gone["before"]["face"]["pictures"] == ["face/old/small/B.js", "face/old/B.js"]
    assert (tmp_path / "face" / "old" / "B.js").is_file()


def test_gone_row_is_placed_as_its_neighbour_is() -> None:
    old = with_gone(A=Placement(10.0, 4.0, 90.0, NONE), B=Placement(10.0, 0.0, -90.0, NONE))
    new = SiteMap(NEW.rows, {}, {}, {"A": Placement(3.0, 1.0, 0.0, NONE)})
    before = Before(old, compare_maps(old, new))
    found = old_place(before, new, "B")
    assert found is not None
    # row B is turned by half a turn, and 4 m along -z of the old site: along +x of row A, which begins 0.7 m further on
    assert [found.x_m, found.z_m] == pytest.approx([3.0 + 4.0 + 0.7, 1.0], abs=0.03)
    assert abs(found.heading_deg) == pytest.approx(180.0, abs=0.3)
    assert old_place(before, SiteMap(NEW.rows, {}), "B") is None  # nobody knows how the sites lie on one another


def test_old_panoramas_are_copied_and_carried(tmp_path: Path) -> None:
    spring, autumn = tmp_path / "spring", tmp_path / "autumn"
    write_view(View(OLD, stills={"A": stills()}), spring / "view.html")
    (spring / "pano" / "A-00003.js").write_text("alert(1)")  # nothing that savmap wrote
    motion = compare_maps(OLD, NEW).rows[0].motion
    assert motion is not None
    before = Before(OLD, compare_maps(OLD, NEW), folder=spring)
    write_view(View(NEW, before=before), autumn / "view.html")
    (row,) = data_of(autumn / "view.html")["rows"]
    frames = [still.frame for still in stills()]
    assert [one["frame"] for one in row["before"]["stills"]] == row["before"]["frames"]["number"] == frames
    places = np.array(row["before"]["frames"]["position"]).reshape(-1, 3) * 1e-5
    assert np.allclose(places, motion.points(OLD.rows["A"].trajectory.world_from_rig[frames, :3, 3]), atol=1e-5)
    path = autumn / "pano" / "old" / "A-00006.js"
    written = path.read_text(encoding="utf-8")
    assert written.startswith('savmapPart("pano/old/A-00006.js", "data:image/jpeg;base64,')
    assert base64.b64decode(written.split(",")[2].split('"')[0]) == jpeg(64, 32, 94).tobytes()
    write_view(View(NEW), autumn / "view.html")
    assert not path.exists()


def test_old_path_without_pictures_takes_no_room(tmp_path: Path) -> None:
    write_view(View(NEW, before=Before(OLD, compare_maps(OLD, NEW), folder=tmp_path / "none")), tmp_path / "view.html")
    (row,) = data_of(tmp_path / "view.html")["rows"]
    assert row["before"]["stills"] == row["before"]["frames"]["position"] == []
