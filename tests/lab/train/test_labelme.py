"""LabelMe's files."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from savmap.errors import OutputError
from savmap.lab.train.data.sets import read_set

from .conftest import edited

CLASSES = ["crossbar", "column"]


def redrawn(both: Path, edit: Callable[[Any], None]) -> Path:
    edited(both / "images" / "a-00000.json", edit)
    return both / "images"


def shape(label: str, points: list[list[float]], kind: str | None = "polygon") -> dict[str, object]:
    return {"label": label, "points": points, "shape_type": kind, "group_id": None, "flags": {}}


def test_what_is_corrected_in_labelme_is_trained_on(both: Path) -> None:
    def correct(content: Any) -> None:
        content["shapes"] = [
            shape("column", [[40, 30], [10, 10]], "rectangle"),
            shape("column", [[600, 400], [620, 400], [620, 420], [600, 420]], "oriented_rectangle"),
            shape("goods", [[15, 10], [20, 10], [20, 30], [15, 30]], None),
        ]
        content["imagePath"] = "..\\images\\a-00000.jpg"
        content["imageData"] = "a copy of the picture"

    first, second = read_set(redrawn(both, correct), CLASSES).samples
    mask = first.load()[1]
    assert (mask == 2).sum() == 30 * 20 - 5 * 20 + 20 * 20
    assert (mask[10:30, 10:15] == 2).all()
    assert not mask[10:30, 15:20].any()
    assert (second.load()[1] == 1).any()
    empty = redrawn(both, lambda content: content.update(shapes=[]))
    assert not read_set(empty, CLASSES).samples[0].load()[1].any()
    (both / "images" / "a-00000.json").unlink()
    assert [sample.image.stem for sample in read_set(both / "images", CLASSES).samples] == ["a-00020"]


def test_labelme_classes_by_other_names(both: Path) -> None:
    with pytest.raises(
        OutputError, match=r"images: has no class post \(it has column, crossbar\).* say --class THEIRS=post"
    ):
        read_set(both / "images", ["post"])
    dataset = read_set(both / "images", ["post"], {"column": "post"})
    assert set(np.unique(dataset.samples[0].load()[1])) == {0, 1}


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        (lambda content: content["shapes"][0].pop("label"), r"`shapes\[0\]\.label` is missing"),
        (
            lambda content: content["shapes"][0].update(points=[[1, 2], [3, "x"]]),
            r"`shapes\[0\]\.points\[1\]\[1\]`: a number is expected",
        ),
        (
            lambda content: content["shapes"][0].update(points=[[1, 2], [3, 4]]),
            r"shapes\[0\]: a polygon is three corners",
        ),
        (
            lambda content: content["shapes"][0].update(shape_type="circle"),
            r"shapes\[0\]: is a circle; draw polygons or",
        ),
        (lambda content: content.update(imagePath="gone.jpg"), r"its picture gone\.jpg is neither beside it"),
        (lambda content: content.update(imageWidth=5), r"a-00000\.jpg: is 640x480, but a-00000\.json says 5x480"),
        (lambda content: content.update(imagePath="a-00020.jpg"), r"a-00020\.jpg is labelled in another file too"),
    ],
)
def test_a_malformed_labelme_file_gets_one_line(both: Path, edit: Callable[[Any], None], words: str) -> None:
    with pytest.raises(OutputError, match=words) as error:
        read_set(redrawn(both, edit), CLASSES)
    assert "\n" not in str(error.value)
    assert "a-000" in str(error.value)


def test_one_file_of_labelme_is_not_a_set(both: Path) -> None:
    with pytest.raises(OutputError, match=r"a-00000\.json: is LabelMe's of one picture; give the folder that it is in"):
        read_set(both / "images" / "a-00000.json", CLASSES)
    (both / "coco.json").rename(both / "images" / "coco.json")
    with pytest.raises(OutputError, match=r"\(.*images/coco\.json, LabelMe's files\); .*or move the others away"):
        read_set(both / "images", CLASSES)
