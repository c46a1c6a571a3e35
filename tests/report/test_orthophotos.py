"""The orthophoto with the wireframe over it: on the page, and as an SVG beside the JPEG."""

import base64
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from made_up_page import EVIL, drawings, report, row

from savmap.report import orthophotos
from savmap.report.orthophotos import overlay_text, scaled_down, write_overlay
from savmap.report.page import page_text
from savmap.types import Orthophoto

SVG = "{http://www.w3.org/2000/svg}"


def photo(width: int = 1400, height: int = 1100) -> Orthophoto:
    """5 mm a pixel from x = -0.3 m, y = -0.2 m on; noise, which packs badly."""
    noise = np.random.default_rng(0).integers(0, 255, (height, width, 3), np.uint8)
    content = np.asarray(cv2.imencode(".jpg", noise)[1], np.uint8).ravel()
    return Orthophoto(np.array([-0.3, -0.2, 0.0]), np.eye(3)[0], np.eye(3)[1], 0.005, width, height, content)


def test_outlines_lie_where_the_picture_shows_them(tmp_path: Path) -> None:
    write_overlay("A", photo(), drawings(row("A")), tmp_path / "face-A.jpg", tmp_path / "face-A.svg")
    (svg,) = [ElementTree.parse(tmp_path / "face-A.svg").getroot()]
    assert (svg.get("width"), svg.get("height"), svg.get("viewBox")) == ("1400", "1100", "0 0 14000 11000")
    (image,) = svg.iter(f"{SVG}image")
    assert image.get("href") == "face-A.jpg"
    shapes = {title.text: path.get("d") for path in svg.iter(f"{SVG}path") for title in path.iter(f"{SVG}title")}
    # post 2: x from 3.0 to 3.1 m, y from 0 to 5 m
    assert shapes["post 2"] == "M6600 10600h200v-10000h-200z"
    assert {text.text for text in svg.iter(f"{SVG}text")} >= {"post 1", "bay 1 / bar 2"}


def test_names_are_escaped_and_links_quoted() -> None:
    shown = [replace(one, name=EVIL) if one.name else one for one in drawings(row("A"))]
    text = overlay_text(EVIL, photo(40, 30), shown, "face-%2F A#1.jpg")
    assert EVIL not in text
    assert 'href="face-%252F%20A%231.jpg"' in text
    ElementTree.fromstring(text)


def test_page_shows_a_small_picture_of_rows_that_have_one() -> None:
    own = report(["A2", "A10"], placed=False)
    without = page_text(own)
    text = page_text(replace(own, photos={"A2": photo()}))
    assert "<image" not in without
    assert text.count("<image") == 1
    assert "Row A2: orthophoto" in text
    assert len(text) - len(without) < 200_000
    data = text.split("data:image/jpeg;base64,")[1].split('"')[0]
    assert cv2.imdecode(np.frombuffer(base64.b64decode(data), np.uint8), cv2.IMREAD_COLOR) is not None


def test_small_pictures_are_not_enlarged(monkeypatch: pytest.MonkeyPatch) -> None:
    small = cv2.imdecode(np.frombuffer(scaled_down(photo(300, 200)), np.uint8), cv2.IMREAD_COLOR)
    assert small is not None
    assert small.shape == (200, 300, 3)
    monkeypatch.setattr(orthophotos, "MOST_BYTES", 5000)
    assert len(scaled_down(photo(300, 200))) <= 5000
