"""Reading of signs, and the vote of many readings."""

import numpy as np
import pytest

from savmap.types import ViewSpec
from savmap_signs import reading
from savmap_signs.lab.artwork import artwork
from savmap_signs.reading import Inscription, vote

from .drawn_signs import panorama_of, plate

SPEC = ViewSpec("signs lower", yaw_deg=0.0, hfov_deg=110.0)


def test_vote_takes_the_text_of_most_readings() -> None:
    inscription = vote([{"text:A21-03": 0.98}, {"text:A21-08": 0.8}, {"text:A21-03": 0.9}, {}], None, 0.5)
    assert inscription.text == "A21-03"
    assert 0.6 < inscription.confidence < 0.9
    assert vote([{"text:A21-03": 0.99}], None, 0.5) == Inscription(), "read once"
    contradicting = [{f"text:A2{number % 3}": 0.95} for number in range(6)]
    assert vote(contradicting, None, 0.6).text == ""


def test_vote_takes_only_texts_that_match_the_pattern() -> None:
    readings = [{"text:A21 - 03": 0.9}, {"text:A21-03": 0.9}, *[{"text:EXIT": 0.99}] * 3]
    assert vote(readings, r"[A-Z]\d{2}-\d{2}", 0.5).text == "A21-03"
    assert vote(readings[2:], r"[A-Z]\d{2}-\d{2}", 0.5).text == ""


def test_vote_takes_a_code_that_checks_itself_once_and_others_twice() -> None:
    assert vote([{"QRCode:bay 7": 1.0}], None, 0.6).code == "QRCode:bay 7"
    assert vote([{"QRCode:bay 7": 1.0}, {"QRCode:bay 8": 1.0}], None, 0.6).code == ""
    for code in ("tag36h11:7", "ITF:1234", "Codabar:12"):
        assert vote([{code: 1.0}], None, 0.6).code == ""
        assert vote([{code: 1.0}, {code: 1.0}], None, 0.6).code == code


def test_read_gives_nothing_without_the_extra_and_notes_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reading, "PACKAGES", {"not_there_at_all": "rapidocr"})
    panorama = panorama_of(plate((0.0, 0.0, 1.0), (0.3, 0.15)), "A21-03", 256)
    assert reading.read(panorama, SPEC, np.array([[200.0, 200], [300, 200], [300, 250], [200, 250]])) == {}
    assert "pip install 'savmap[signs]'" in str(reading.missing_packages_note())


@pytest.mark.slow
def test_read_reads_a_sign_in_a_panorama() -> None:
    from savmap.geometry.pinhole import project

    corners = plate((0.2, -0.3, 1.5), (0.3, 0.15), 20.0)
    readings = reading.read(panorama_of(corners, "A21-03", 2048), SPEC, project(corners, SPEC.camera))
    assert list(readings) == ["text:A21-03"]
    assert readings["text:A21-03"] > 0.9


def test_read_codes_gives_the_kind_of_code() -> None:
    style = ((230, 230, 230), (10, 10, 10), "DejaVuSans-Bold", False)
    printed = artwork("", (0.2, 0.2), *style, "qr", "A21-03")
    tag = artwork("", (0.2, 0.2), *style, "tag36h11", "7")
    assert reading.read_codes(np.ascontiguousarray(printed[..., 0])) == {"QRCode:A21-03": 1.0}
    assert reading.read_codes(np.ascontiguousarray(tag[..., 0])) == {"tag36h11:7": 1.0}
