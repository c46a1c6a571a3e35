"""Many readings to one text, and reading itself where the extra is there."""

import importlib.util

import numpy as np
import pytest

from savmap.types import ViewSpec
from savmap_signs import reading
from savmap_signs.artwork import artwork
from savmap_signs.texts import Words, voted

from .drawn_signs import panorama_of, plate

READS = pytest.mark.skipif(importlib.util.find_spec("rapidocr") is None, reason="the extra `signs` is not installed")
SPEC = ViewSpec("signs lower", yaw_deg=0.0, hfov_deg=110.0)


def test_the_text_most_readings_say_wins() -> None:
    readings = [{"text:A21-03": 0.98}, {"text:A21-08": 0.8}, {"text:A21-03": 0.9}, {}]
    words = voted(readings, None, 0.5)
    assert words.text == "A21-03"
    assert 0.6 < words.confidence < 0.9


def test_a_single_reading_is_not_believed() -> None:
    assert voted([{"text:A21-03": 0.99}], None, 0.5) == Words()


def test_readings_that_contradict_one_another_say_nothing() -> None:
    readings = [{f"text:A2{number % 3}": 0.95} for number in range(6)]
    assert voted(readings, None, 0.6).text == ""


def test_the_pattern_keeps_what_fits_and_nothing_else() -> None:
    readings = [
        {"text:A21 - 03": 0.9},
        {"text:A21-03": 0.9},
        {"text:EXIT": 0.99},
        {"text:EXIT": 0.99},
        {"text:EXIT": 0.99},
    ]
    assert voted(readings, r"[A-Z]\d{2}-\d{2}", 0.5).text == "A21-03"
    assert voted(readings[2:], r"[A-Z]\d{2}-\d{2}", 0.5).text == ""


def test_a_code_checks_itself_unless_another_was_read() -> None:
    assert voted([{"QRCode:bay 7": 1.0}], None, 0.6).code == "QRCode:bay 7"
    assert voted([{"QRCode:bay 7": 1.0}, {"QRCode:bay 8": 1.0}], None, 0.6).code == ""


def test_without_the_extra_nothing_is_read_and_one_line_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reading, "NEEDED", {"not_there_at_all": "rapidocr"})
    panorama = panorama_of(plate((0.0, 0.0, 1.0), (0.3, 0.15)), "A21-03", 256)
    assert reading.read(panorama, SPEC, np.array([[200.0, 200], [300, 200], [300, 250], [200, 250]])) == {}
    assert "pip install 'savmap[signs]'" in str(reading.advice())


@READS
def test_a_sign_in_a_panorama_is_read() -> None:
    from savmap.geometry.pinhole import project

    corners = plate((0.2, -0.3, 1.5), (0.3, 0.15), 20.0)
    said = reading.read(panorama_of(corners, "A21-03", 2048), SPEC, project(corners, SPEC.camera))
    assert list(said) == ["text:A21-03"]
    assert said["text:A21-03"] > 0.9


@READS
@pytest.mark.parametrize("code", ["tag36h11:7", "ITF:1234", "Codabar:12"])
def test_codes_that_are_seen_where_there_are_none_must_be_read_twice(code: str) -> None:
    assert voted([{code: 1.0}], None, 0.6).code == ""
    assert voted([{code: 1.0}, {code: 1.0}], None, 0.6).code == code


def test_codes_are_read_with_their_kind() -> None:
    style = ((230, 230, 230), (10, 10, 10), "DejaVuSans-Bold", False)
    printed = artwork("", (0.2, 0.2), *style, "qr", "A21-03")
    tag = artwork("", (0.2, 0.2), *style, "tag36h11", "7")
    assert reading.codes(np.ascontiguousarray(printed[..., 0])) == {"QRCode:A21-03": 1.0}
    assert reading.codes(np.ascontiguousarray(tag[..., 0])) == {"tag36h11:7": 1.0}
