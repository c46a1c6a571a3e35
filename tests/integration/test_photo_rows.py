"""Rows whose face is a photograph: what is laid on the plane lies where the truth says, and photographs are known by digest."""

import hashlib
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

POST, BEAM, FLANK, GOODS = (200, 0, 0), (0, 0, 200), (0, 120, 0), (90, 90, 90)


def _painted() -> Any:
    """A picture of two posts and two beams, the upper one with an underside, and one post with a flank."""
    picture = np.full((200, 160, 3), GOODS, np.uint8)
    picture[40:60], picture[60:66], picture[140:160] = BEAM, FLANK, BEAM
    picture[:, 10:20] = picture[:, 140:150] = POST
    picture[:, 20:26] = FLANK
    return picture


def _face(**changes: Any) -> Any:
    from bench.photo_rows import BayPicture, Face

    entry = {
        "name": "painted",
        "entry": {},
        "corners": ((0.0, 0.0), (160.0, 0.0), (160.0, 200.0), (0.0, 200.0)),
        "radial": 0.0,
        "size_px": (160, 200),
        "pixels_a_metre": 100.0,
        "posts": ((10.0, 20.0), (140.0, 150.0)),
        "bays": (BayPicture((26.0, 140.0), ((160.0, 140.0, 160.0, 140.0), (60.0, 40.0, 66.0, 40.0))),),
        "row": (0, 0, 1, 0, 1),
    }
    return Face(**{**entry, **changes})


def test_a_photo_rows_edges_lie_where_its_truth_says() -> None:
    from bench.photo_rows import photo_row

    row = photo_row(_face(), _painted())
    assert np.allclose(row.posts, [[0, 0.1], [1.24, 1.34], [2.48, 2.58]])
    assert np.allclose(row.beams, [[[0.4, 0.6], [1.4, 1.6]]] * 2)
    is_post = (row.picture[100] == POST).all(axis=1)
    assert np.flatnonzero(np.diff(is_post.astype(int))).tolist() == [9, 123, 133, 247]
    is_beam = (row.picture[:, 60] == BEAM).all(axis=1)
    assert np.flatnonzero(np.diff(is_beam.astype(int))).tolist() == [39, 59, 139, 159]


def test_a_photo_rows_flanks_and_undersides_are_left_out() -> None:
    from bench.photo_rows import photo_row

    row = photo_row(_face(), _painted())
    assert not (row.picture == FLANK).all(axis=2).any()


def test_rows_left_out_of_a_bay_move_no_front() -> None:
    from bench.photo_rows import BayPicture, photo_row

    beams = ((160.0, 140.0, 160.0, 140.0), (60.0, 40.0, 60.0, 40.0))
    row = photo_row(_face(bays=(BayPicture((26.0, 140.0), beams, ((58.0, 70.0), (80.0, 90.0))),)), _painted())
    is_beam = (row.picture[:, 60] == BEAM).all(axis=1)
    assert np.flatnonzero(np.diff(is_beam.astype(int)))[-2:].tolist() == [139, 159]


def test_half_a_bay_goes_on_as_its_mirror_image() -> None:
    from bench.photo_rows import BayPicture, photo_row

    picture = _painted()
    picture[:, 30:32] = 255
    bay = BayPicture((26.0, 80.0), ((60.0, 40.0, 66.0, 40.0),), mirrored="right")
    row = photo_row(_face(bays=(bay,)), picture)
    white = np.flatnonzero((row.picture[100, :118] == 255).all(axis=1))
    assert white.tolist() == [14, 15, 112, 113]


def test_a_lens_s_distortion_is_undone() -> None:
    from bench.photo_rows import distorted, undistorted

    points, size = np.array([[3.0, 4.0], [300.0, 20.0], [600.0, 390.0]]), np.array([600, 400])
    assert np.allclose(distorted(undistorted(points, size, 0.1), size, 0.1), points, atol=1e-6)


def test_the_faces_of_the_bench_are_whole() -> None:
    from bench.photo_rows import beams_m, read_faces

    faces = read_faces()
    assert len(faces) >= 6
    for face in faces.values():
        assert len(face.entry["commit"]) == 40
        assert len(face.entry["sha256"]) == 64
        assert max(face.row[::2]) < len(face.posts)
        for number in face.row[1::2]:
            heights = np.ravel(beams_m(face, number))
            assert len(heights) >= 6
            assert (np.diff(heights) > 0).all()
            assert heights[0] > 0


def test_photo_row_footage_has_each_light_and_its_truth(tmp_path: Path) -> None:
    import yaml

    from bench.photo_rows import LIGHTS, Size, make_footage, photo_row
    from savmap.maps.survey import read_survey

    row = photo_row(_face(), _painted())
    folders = {light: tmp_path / light for light in LIGHTS}
    make_footage(row, "painted", folders, Size(3, 256))
    means = {}
    for light, folder in folders.items():
        capture = cv2.VideoCapture(str(folder / "footage.mp4"))
        means[light] = np.mean([capture.read()[1] for _ in range(3)])
        assert read_survey(folder / "survey.json").rows["A"]["sections"][0]["beams"] == [[0.4, 0.6], [1.4, 1.6]]
        site = yaml.safe_load((folder / "site.yaml").read_text(encoding="utf-8"))
        assert site["rows"]["A"]["plugins"]["shelves"]["lowest_beam_bottom_height_m"]["values"] == [0.4, 0.4]
    assert means["dim"] < 0.8 * means["colour"]


def test_a_photograph_is_known_by_its_digest(tmp_path: Path) -> None:
    from bench.photo_files import PhotoMissingError, photo

    content = cv2.imencode(".png", np.full((4, 6, 3), (0, 0, 255), np.uint8))[1].tobytes()
    digest = hashlib.sha256(content).hexdigest()
    entry = {"repository": "owner/name", "commit": "0" * 40, "path": "a b.PNG", "sha256": digest}
    (tmp_path / f"{digest}.png").write_bytes(content)
    assert photo(entry, tmp_path)[0, 0].tolist() == [255, 0, 0]
    (tmp_path / f"{digest}.png").write_bytes(content + b"x")
    with pytest.raises(PhotoMissingError, match="damaged"):
        photo(entry, tmp_path)


def test_a_photograph_that_cannot_be_had_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from bench import photo_files

    def _offline(*_: object, **__: object) -> None:
        raise OSError("no network")

    monkeypatch.setattr("urllib.request.urlopen", _offline)
    entry = {"repository": "owner/name", "commit": "0" * 40, "path": "a b.png", "sha256": "1" * 64}
    with pytest.raises(photo_files.PhotoMissingError, match=r"owner/name/0+/a%20b.png.*no network"):
        photo_files.photo(entry, tmp_path)
    assert not list(tmp_path.iterdir())


def test_a_photo_rows_map_is_good_only_within_its_limits() -> None:
    from bench.photo_rows import is_good, line, totals

    none = {"upright": 0, "beam": 0}
    good = {"mae_m": 0.006, "missing": none, "spurious": none, "warnings": [], "seconds": 1.0}
    off = {**good, "mae_m": 0.02}
    invented = {**good, "spurious": {"upright": 0, "beam": 1}, "warnings": ["look there"]}
    failed = {"error": "nothing seen", "warnings": ["nothing seen"], "seconds": 1.0}
    assert [is_good(figures) for figures in (good, off, invented, failed)] == [True, False, False, False]
    total = totals({"a": good, "b": off, "c": invented, "d": failed})["total"]
    assert (total["cases"], total["good"], total["wrong without a warning"], total["spurious"]) == (4, 1, 1, 1)
    assert "nothing seen" in line("d", failed)
