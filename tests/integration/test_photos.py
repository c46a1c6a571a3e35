"""`python -m bench photos`: what counts as found, wrong and judged on labelled photographs, and how photographs are shown to a network."""

import argparse
import hashlib
import json
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from savmap.errors import OutputError
from savmap.types import Thresholds

ROOT = Path(__file__).parents[2]
BENCH = ROOT / "bench"
CLASSES = ("upright", "beam")
SIZE = 300, 400
RED, BLUE, GREY = (200, 30, 30), (30, 30, 200), (120, 120, 120)
POSTS = [(60, 20, 72, 280), (300, 20, 312, 280)]
BEAMS = [(72, 80, 300, 94), (72, 200, 300, 214)]
Bytes = NDArray[np.uint8]
KEPT = ("chuttersnap", "ruchindra-gunasekara", "nana-smirnova", "4481259", "4481534", "4483610")
"""In the names of photographs that are kept for acceptance."""


def shape(label: str, box: tuple[int, int, int, int], front: bool = True) -> dict[str, Any]:
    left, top, right, bottom = box
    corners = [[left, top], [right, top], [right, bottom], [left, bottom]]
    return {"label": label, "points": corners, "shape_type": "polygon", "flags": {"front": front}}


SHAPES = [*(shape("upright", box) for box in POSTS), *(shape("beam", box) for box in BEAMS)]


def rack() -> Bytes:
    image = np.full((*SIZE, 3), GREY, np.uint8)
    for boxes, colour in ((BEAMS, RED), (POSTS, BLUE)):
        for left, top, right, bottom in boxes:
            image[top:bottom, left:right] = colour
    return image


def labelme(folder: Path, shapes: list[dict[str, Any]], name: str = "made") -> Path:
    path = folder / f"{name}.json"
    path.write_text(json.dumps({"imagePath": f"{name}.png", "shapes": shapes}))
    return path


def truth(folder: Path, shapes: list[dict[str, Any]], image: Bytes | None = None) -> Any:
    from bench.photos import read_pieces, truth_of

    return truth_of(read_pieces(labelme(folder, shapes)), rack() if image is None else image, CLASSES)


def by_colour(image: Bytes) -> NDArray[np.float32]:
    red, blue = (image[..., k].astype(np.float32) for k in (0, 2))
    beam, upright = (red - blue > 80).astype(np.float32), (blue - red > 80).astype(np.float32)
    return np.stack([1 - beam - upright, upright, beam])


def scored(folder: Path, shapes: list[dict[str, Any]], predicted: Bytes) -> Any:
    """Scores of a mask (H, W) of the classes' numbers."""
    from bench.photos import score

    maps = np.stack([(predicted == k).astype(np.float32) for k in range(3)])
    return score(maps, truth(folder, shapes), CLASSES, Thresholds.of(0.5))


@pytest.mark.parametrize("way", ["letterboxed", "tiles", "scales"])
def test_every_way_reads_at_the_photographs_own_places(way: str, tmp_path: Path) -> None:
    from bench.photos import WAYS, score

    known = truth(tmp_path, SHAPES)
    maps = WAYS[way](by_colour, rack(), known.thickness_px)
    assert maps.shape == (3, *SIZE)
    found = score(maps, known, CLASSES, Thresholds.of(0.5))
    for name in CLASSES:
        assert found[name].iou > 0.95
        assert [member.found for member in found[name].members] == [True, True]
        assert (found[name].wrong, found[name].regions) == (0, 2)


def test_tiles_show_members_ten_pixels_thick() -> None:
    from bench.photos import WAYS

    seen: list[Bytes] = []

    def predict(view: Bytes) -> NDArray[np.float32]:
        seen.append(view)
        return by_colour(view)

    WAYS["tiles"](predict, np.ascontiguousarray(rack().repeat(4, 0).repeat(4, 1)), 48.0)
    assert {view.shape for view in seen} == {(480, 640, 3)}
    assert [int((by_colour(view)[1].sum(axis=1)).max()) for view in seen] == [pytest.approx(20, abs=1)]


@pytest.mark.parametrize("length", [640, 641, 1200, 1280, 3000])
def test_tiles_cover_all_and_overlap_by_a_quarter(length: int) -> None:
    from bench.photos import starts

    places = list(starts(length, 640))
    assert places[0] == 0
    assert places[-1] == length - 640
    assert all(second - first <= 480 for first, second in pairwise(places))


@pytest.mark.parametrize(("share", "found"), [(0.45, False), (0.55, True)])
def test_a_member_is_found_along_half_its_length(share: float, found: bool, tmp_path: Path) -> None:
    predicted = np.zeros(SIZE, np.uint8)
    predicted[20 : 20 + round(260 * share), 60:72] = 1
    first, second = scored(tmp_path, SHAPES, predicted)["upright"].members
    assert (first.found, second.found) == (found, False)
    assert first.share == pytest.approx(share, abs=0.01)


@pytest.mark.parametrize(("width", "found"), [(6, False), (8, True)])
def test_a_slice_is_found_over_most_of_its_width(width: int, found: bool, tmp_path: Path) -> None:
    predicted = np.zeros(SIZE, np.uint8)
    predicted[20:280, 60 : 60 + width] = 1
    assert scored(tmp_path, SHAPES, predicted)["upright"].members[0].found == found


def test_goods_that_hide_a_member_shorten_it(tmp_path: Path) -> None:
    predicted = np.zeros(SIZE, np.uint8)
    predicted[20:100, 60:72] = 1
    goods = shape("background", (40, 150, 80, 280))
    (hidden, _) = scored(tmp_path, [*SHAPES, goods], predicted)["upright"].members
    (whole, _) = scored(tmp_path, SHAPES, predicted)["upright"].members
    assert hidden.found
    assert not whole.found


def test_ignored_and_rear_pixels_are_not_judged(tmp_path: Path) -> None:
    rear, clutter = shape("upright", (150, 100, 160, 190), False), shape("ignore", (200, 100, 240, 190))
    predicted = np.zeros(SIZE, np.uint8)
    for left, top, right, bottom in (*POSTS, (150, 100, 160, 190), (200, 100, 240, 190)):
        predicted[top:bottom, left:right] = 1
    with_them = scored(tmp_path, [clutter, rear, *SHAPES], predicted)["upright"]
    without = scored(tmp_path, SHAPES, predicted)["upright"]
    assert with_them.iou == 1
    assert len(with_them.members) == 2
    assert (with_them.wrong, with_them.regions) == (0, 4)
    assert without.iou < 0.7
    assert (without.wrong, without.regions) == (2, 4)


@pytest.mark.parametrize(("side", "wrong"), [(12, 0), (13, 1)])
def test_small_regions_are_not_counted(side: int, wrong: int, tmp_path: Path) -> None:
    predicted = np.zeros(SIZE, np.uint8)
    predicted[150 : 150 + side, 150 : 150 + side] = 2
    beam = scored(tmp_path, SHAPES, predicted)["beam"]
    assert (beam.wrong, beam.regions) == (wrong, wrong)


@pytest.mark.parametrize(("above", "wrong"), [(30, 0), (40, 1)])
def test_a_region_must_lie_partly_on_a_member(above: int, wrong: int, tmp_path: Path) -> None:
    predicted = np.zeros(SIZE, np.uint8)
    predicted[94 - 14 : 94 + above, 100:150] = 2
    assert scored(tmp_path, SHAPES, predicted)["beam"].wrong == wrong


def test_pieces_of_a_post_in_line_are_one_member(tmp_path: Path) -> None:
    pieces = [
        shape("upright", (60, 20, 72, 80)),
        shape("upright", (66, 94, 72, 140)),
        shape("upright", (61, 150, 73, 280)),
        shape("upright", (76, 20, 88, 280)),
        shape("beam", (100, 80, 200, 94)),
        shape("beam", (210, 80, 300, 94)),
    ]
    found = truth(tmp_path, pieces).members
    assert [member.label for member in found] == ["upright", "upright", "beam", "beam"]
    assert sorted(len(member.rows) for member in found[:2]) == [60 * 12 + 46 * 6 + 130 * 12, 260 * 12]


def test_contrast_is_the_mean_over_both_sides(tmp_path: Path) -> None:
    image = np.full((*SIZE, 3), 100, np.uint8)
    image[:, 60:72], image[:, 72:] = 110, 150
    (post,) = truth(tmp_path, [SHAPES[0]], image).members
    assert post.contrast == pytest.approx((10 + 40) / 2, abs=1)
    assert post.thickness_px == 12


def test_figures_by_contrast_add_up(tmp_path: Path) -> None:
    from bench.photos import ClassScore, Seen, total

    members = tuple(Seen(contrast, share) for contrast, share in ((3, 0.9), (8, 0.2), (15, 0.5), (16, 0.7), (90, 0.1)))
    figures = total([ClassScore(30, 40, members, 1, 4), ClassScore(0, 0, (), 0, 0)])
    assert [*figures.values()] == [0.75, 0.75, 60, 25, 100, 50, 50]


@pytest.mark.parametrize(
    ("shapes", "words"),
    [([shape("lamp", (0, 0, 9, 9))], "unknown label lamp"), ([shape("ignore", (0, 0, 9, 9))], "no front member")],
)
def test_labels_of_no_use_are_refused(shapes: list[dict[str, Any]], words: str, tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=words):
        _ = truth(tmp_path, shapes).thickness_px


def test_figures_of_each_network_way_and_class(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from bench import photos

    parser = argparse.ArgumentParser()
    photos.add_arguments(parser)
    labels = _made(tmp_path, rack())
    given = ["--labels", str(labels), "--pictures", str(tmp_path), "--ways", "letterboxed"]
    figures = photos.run(parser.parse_args(given))
    assert "shelves.int8.onnx, letterboxed: IoU, found %, wrong % of upright, beam" in capsys.readouterr().out
    assert set(figures["shelves.int8.onnx, letterboxed, beam"]) >= {"IoU", "found %", "wrong %"}


def test_wide_photographs_are_measured_at_1280(tmp_path: Path) -> None:
    from bench.photos import others

    image = np.ascontiguousarray(rack().repeat(4, 0).repeat(4, 1))
    _made(tmp_path, image)
    (photograph,) = others(tmp_path / "labels", tmp_path, CLASSES)
    assert photograph.image.shape == (960, 1280, 3)


def _made(folder: Path, image: Bytes) -> Path:
    """A photograph in a folder, and the folder of its labels."""
    labels = folder / "labels"
    labels.mkdir()
    labelme(labels, SHAPES)
    cv2.imwrite(str(folder / "made.png"), image[:, :, ::-1])
    return labels


def test_unseen_photographs_have_no_line_of_their_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from bench import photos

    _made(tmp_path, rack())
    content = (tmp_path / "made.png").read_bytes()
    sha256 = hashlib.sha256(content).hexdigest()
    (tmp_path / f"{sha256}.png").write_bytes(content)
    (tmp_path / "photos.json").write_text(json.dumps([{"name": "made", "path": "made.png", "sha256": sha256}]))
    monkeypatch.setattr(photos, "DATA", tmp_path)
    monkeypatch.setattr(photos, "SETS", dict.fromkeys(photos.SETS, ("photos.json", "labels")))
    printed: dict[str, str] = {}
    for name in photos.SETS:
        parser = argparse.ArgumentParser()
        photos.add_arguments(parser)
        photos.run(parser.parse_args(["--set", name, "--cache", str(tmp_path), "--ways", "letterboxed"]))
        printed[name] = capsys.readouterr().out
    assert "made" in printed["dev"]
    assert "made" not in printed["unseen"]
    assert "all 1 " in printed["unseen"]


@pytest.mark.parametrize(
    ("folder", "index", "labels"),
    [
        (BENCH / "photo_data", "photos.json", "labels"),
        (BENCH / "photo_data", "unseen.json", "unseen"),
        (ROOT / "plugins" / "shelves" / "training", "photos.json", "labels"),
    ],
)
def test_listed_photographs_are_labelled(folder: Path, index: str, labels: str) -> None:
    from bench.photos import read_pieces

    entries = json.loads((folder / index).read_text())
    assert len({entry["sha256"] for entry in entries}) == len(entries)
    names = [entry["name"] for entry in entries]
    assert sorted(path.stem for path in (folder / labels).iterdir()) == sorted(names)
    for entry in entries:
        assert not any(name in entry["path"] for name in KEPT)
        assert len(entry["commit"]) == 40
        assert len(entry["sha256"]) == 64
        pieces = read_pieces(folder / labels / f"{entry['name']}.json")
        assert {piece.label for piece in pieces} <= {*CLASSES, "background", "ignore"}
        if folder == BENCH / "photo_data":
            assert {piece.label for piece in pieces if piece.front} & set(CLASSES)


def test_no_photograph_is_in_two_lists() -> None:
    data, training = BENCH / "photo_data", ROOT / "plugins" / "shelves" / "training"
    dev, unseen, trained = (
        json.loads(path.read_text()) for path in (data / "photos.json", data / "unseen.json", training / "photos.json")
    )
    assert len(dev) >= 25
    assert len({entry["repository"] for entry in dev}) >= 10
    assert not {e["repository"] for e in unseen} & {e["repository"] for e in [*dev, *trained]}
    assert not {e["sha256"] for e in dev} & {e["sha256"] for e in trained}


def test_a_teacher_completes_labels_where_they_say_nothing() -> None:
    from bench.photo_tiles import completed

    mask = np.array([[0, 1, 1, 255, 255, 2]], np.uint8)
    maps = np.full((5, 1, 6), 0.025, np.float32)
    for place, value, sure in ((0, 2, 0.9), (1, 3, 0.5), (2, 1, 0.5), (3, 4, 0.9), (4, 4, 0.5), (5, 0, 0.9)):
        maps[value, 0, place] = sure
    assert completed(mask, maps).tolist() == [[0, 3, 1, 4, 255, 2]]
