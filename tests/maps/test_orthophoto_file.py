"""Orthophotos as files: they say where they lie, whatever the row is called, and are whole or not there."""

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from savmap.errors import OutputError
from savmap.maps.orthophoto_file import orthophoto_files, read_orthophotos, write_orthophoto
from savmap.types import Orthophoto

UNSAFE = '../A/1 "<b>" ü'


def photo() -> Orthophoto:
    shade = np.tile(np.arange(40, dtype=np.uint8), (20, 1))
    content = np.asarray(cv2.imencode(".jpg", shade)[1], np.uint8).ravel()
    return Orthophoto(np.array([-0.3, 0.1, 0.0]), np.eye(3)[0], np.eye(3)[1], 0.005, 40, 20, content)


@pytest.mark.parametrize("row", ["A", UNSAFE])
def test_picture_and_json_say_where_it_lies(row: str, tmp_path: Path) -> None:
    path = write_orthophoto(row, photo(), tmp_path)
    assert path.parent == tmp_path
    assert {each.name for each in tmp_path.iterdir()} == {each.name for each in orthophoto_files(row, tmp_path)}
    content = json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))
    assert (content["row"], content["picture"], content["mm_per_pixel"]) == (row, path.name, 5.0)
    along = np.array(content["face_from_pixel"]) @ [0, 19, 1]
    assert np.array(content["origin_m"])[:2] + along[:2] == pytest.approx([-0.2975, 0.1025])
    jpeg = path.read_bytes()
    assert jpeg[2:4] == b"\xff\xfe"
    size = int.from_bytes(jpeg[4:6], "big")
    assert json.loads(jpeg[6 : 4 + size]) == content
    assert cv2.imread(str(path)).shape == (20, 40, 3)


def test_what_was_written_is_read_again(tmp_path: Path) -> None:
    write_orthophoto(UNSAFE, photo(), tmp_path)
    read = read_orthophotos(["B", UNSAFE], tmp_path)
    assert list(read) == [UNSAFE]
    assert read[UNSAFE].on_picture(np.array([[-0.3, 0.1, 0.0], [-0.2, 0.2, 0.3]])) == pytest.approx(
        np.array([[0, 20], [20, 0]])
    )


def test_damaged_json_is_named(tmp_path: Path) -> None:
    write_orthophoto("A", photo(), tmp_path)
    orthophoto_files("A", tmp_path)[1].write_text('{"row": "A"}', encoding="utf-8")
    with pytest.raises(OutputError, match=r"face-A\.json: "):
        read_orthophotos(["A"], tmp_path)


def tilted() -> Orthophoto:
    """A picture in a plane that is not the row's x and y."""
    right, up = np.array([0.8, 0.0, 0.6]), np.array([0.0, 1.0, 0.0])
    return replace(photo(), origin=1.5 * right + 0.25 * up + np.array([-0.006, 0.0, 0.008]), right=right, up=up)


@pytest.mark.parametrize("row", ["A", UNSAFE])
def test_world_file_places_pixels_in_the_plane(row: str, tmp_path: Path) -> None:
    own = tilted()
    write_orthophoto(row, own, tmp_path)
    a, d, b, e, c, f = map(float, orthophoto_files(row, tmp_path)[2].read_text(encoding="ascii").split())
    for column, line in ((0, 0), (39, 19), (7, 3)):
        along = own.face_from_pixel @ [column, line, 1]
        place = own.origin + along[0] * own.right + along[1] * own.up
        assert (a * column + b * line + c, d * column + e * line + f) == pytest.approx(
            (place @ own.right, place @ own.up), abs=1e-8
        )


@pytest.mark.extra("validators")
@pytest.mark.parametrize("row", ["A", UNSAFE])
def test_another_reader_finds_the_picture_in_its_plane(row: str, tmp_path: Path) -> None:
    import rasterio

    write_orthophoto(row, tilted(), tmp_path)
    picture, _, world, gdal = orthophoto_files(row, tmp_path)
    for _ in range(2):
        with rasterio.open(picture) as found:
            assert (found.width, found.height) == (40, 20)
            assert tuple(found.bounds) == pytest.approx((1.5, 0.25, 1.7, 0.35), abs=1e-9)
            if gdal.is_file():
                assert found.tags()["savmap_row"] == row
                assert found.tags()["savmap_right"] == "0.800000000 0.000000000 0.600000000"
                assert "plane of its face" in found.crs.to_wkt()
                assert not found.crs.is_geographic
        gdal.unlink(missing_ok=True)
    assert world.is_file()
