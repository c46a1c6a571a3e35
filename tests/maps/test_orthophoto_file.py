"""Orthophotos as files: they say where they lie, whatever the row is called, and are whole or not there."""

import json
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
    assert {each.name for each in tmp_path.iterdir()} == {path.name, path.with_suffix(".json").name}
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
