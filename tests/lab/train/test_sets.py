"""Sets of other tools: COCO instances and LabelMe's files."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from PIL import Image

from savmap.errors import OutputError
from savmap.lab.label.formats import LabelledPicture, write_set
from savmap.lab.label.polygons import outlines
from savmap.lab.train.data.dataset import IGNORE, group_of, held_out
from savmap.lab.train.data.sets import Shapes, read_set, samples_of

from .conftest import edited, masks, write_dataset

CLASSES = ["crossbar", "column"]
KINDS = ["coco.json", "images"]
Edit = Callable[[Any], Any]


def coco_of(picture: str, size: tuple[int, int], segmentation: object) -> dict[str, Any]:
    """COCO's content with one column."""
    return {
        "images": [{"id": 1, "file_name": picture, "width": size[0], "height": size[1]}],
        "annotations": [{"image_id": 1, "category_id": 1, "segmentation": segmentation}],
        "categories": [{"id": 1, "name": "column"}],
    }


def mask_of(folder: Path, size: tuple[int, int], segmentation: object) -> np.ndarray:
    """The mask of a black picture with such a column."""
    cv2.imwrite(str(folder / "a.png"), np.zeros((size[1], size[0], 3), np.uint8))
    (folder / "coco.json").write_text(json.dumps(coco_of("a.png", size, segmentation)), encoding="utf-8")
    return read_set(folder, ["column"]).samples[0].labels.mask()


@pytest.mark.parametrize("name", KINDS)
def test_masks_come_back_to_the_pixel(both: Path, name: str) -> None:
    dataset = read_set(both / name, CLASSES)
    assert dataset.folder == both
    assert len(dataset.samples) == 2
    _, mask = dataset.samples[0].load()
    assert np.array_equal(mask, np.array([0, 2, 1], np.uint8)[masks(1)[0][1]])
    assert dataset.samples[0].group == f"set/{group_of('a-00000')}"


def test_a_folder_is_recognised_by_what_is_in_it(both: Path, tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"kinds \(.*set/coco\.json, .*set/images\); give one"):
        read_set(both, CLASSES)
    (both / "coco.json").rename(tmp_path / "elsewhere.json")
    assert read_set(both, CLASSES).renderer == "labelled (LabelMe)"
    with pytest.raises(OutputError, match=r"a-00000\.json: is LabelMe's of one picture; give the folder that it is in"):
        read_set(both / "images" / "a-00000.json", CLASSES)
    for file in (both / "images").glob("*.json"):
        file.unlink()
    with pytest.raises(OutputError, match=r"no dataset\.json, nor labels of another kind"):
        read_set(both, CLASSES)
    (tmp_path / "elsewhere.json").rename(both / "coco.json")
    assert read_set(both, CLASSES).renderer == "labelled (COCO)"
    made = write_dataset(tmp_path / "made", 2)
    assert read_set(made, CLASSES).renderer == read_set(made / "dataset.json", CLASSES).renderer == "made up"
    with pytest.raises(OutputError, match="no such file or folder"):
        read_set(tmp_path / "none", CLASSES)


def test_as_cvat_lays_it_out(both: Path) -> None:
    (both / "annotations").mkdir()
    (both / "coco.json").rename(both / "annotations" / "instances_default.json")
    (both / "images").rename(both / "default")
    (both / "images").mkdir()
    (both / "default").rename(both / "images" / "default")
    dataset = read_set(both, CLASSES)
    assert dataset.samples[0].group.startswith("set/")
    assert dataset.folder == both


@pytest.mark.parametrize("name", [*KINDS, "dataset.json"])
def test_classes_by_other_names(both: Path, name: str) -> None:
    source = (write_dataset(both.parent / "made", 1) if name == "dataset.json" else both) / name
    with pytest.raises(OutputError, match=r"has no class post \(it has column, crossbar\).* say --class THEIRS=post"):
        read_set(source, ["post"])
    assert set(np.unique(read_set(source, ["post"], {"column": "post"}).samples[0].load()[1])) == {0, 1}


def test_pictures_of_other_sizes_keep_their_shapes(both: Path) -> None:
    image, mask = masks(1)[0]
    wide = cv2.copyMakeBorder(image, 0, 0, 0, 640, cv2.BORDER_CONSTANT)
    write_set(both.parent / "wide", ["column"], [LabelledPicture("w-1", wide, {"column": outlines(mask == 1)})])
    picture, labels = read_set(both.parent / "wide" / "coco.json", ["column"]).samples[0].load()
    assert picture.shape == (480, 640, 3)
    assert (labels[:120] == IGNORE).all()
    assert (labels[360:] == IGNORE).all()
    assert (labels[130:350, 51:54] == 1).all()
    assert (labels[130:350, 60:190] == 0).all()


@pytest.mark.parametrize(
    ("segmentation", "columns"),
    [
        ([[0, 0, 2, 0, 2, 4, 0, 4], [5, 0, 8, 0, 8, 4, 5, 4]], [0, 1, 5, 6, 7]),
        ({"counts": [4 * 7, 4], "size": [4, 8]}, [7]),
        ({"counts": "PPP1PPP1", "size": [256, 256]}, list(range(128, 256))),
        ({"counts": "44`04", "size": [4, 8]}, [1, 6, 7]),
    ],
    ids=["parts", "runs", "a long run, packed", "differences, packed"],
)
def test_coco_parts_and_runs(tmp_path: Path, segmentation: Any, columns: list[int]) -> None:
    size = (8, 4) if isinstance(segmentation, list) else tuple(segmentation["size"][::-1])
    mask = mask_of(tmp_path, size, segmentation)
    assert np.flatnonzero(mask.all(axis=0)).tolist() == np.flatnonzero(mask.any(axis=0)).tolist() == columns


def drop(key: str) -> Edit:
    return lambda content: content["annotations"][0].pop(key)


def put(key: str, value: object) -> Edit:
    return lambda content: content["annotations"][0].update({key: value})


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        (drop("image_id"), r"`annotations\[0\]\.image_id` is missing"),
        (put("image_id", 99), r"annotations\[0\]: there is no image 99"),
        (put("category_id", 99), r"annotations\[0\]: there is no category 99"),
        (put("segmentation", []), r"annotations\[0\]: has a box, but no outline"),
        (put("segmentation", [[1, 2, 3]]), r"annotations\[0\]: a polygon is three corners or more"),
        (
            put("segmentation", {"counts": [5], "size": [480, 640]}),
            r"\[0\]: its mask does not fill its picture of 640x",
        ),
        (put("segmentation", {"counts": "\n", "size": [480, 640]}), r"\[0\]: its mask is not a run-length string"),
        (lambda content: content["images"].append(content["images"][0]), "id 1 stands twice in images"),
        (lambda content: content["images"][0].update(file_name="no.jpg"), r"its picture no\.jpg is neither beside it"),
        (lambda content: content["images"][0].update(width=5), "is 640x480 but its labels are of 5x480"),
        (lambda content: content.update(images=[], annotations=[]), "names no pictures"),
        (lambda content: content.pop("categories"), "is not COCO"),
    ],
)
def test_a_malformed_coco_file_gets_one_line(both: Path, edit: Edit, words: str) -> None:
    with pytest.raises(OutputError, match=words) as error:
        read_set(edited(both / "coco.json", edit), CLASSES)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        (lambda content: content["shapes"][0].pop("label"), r"`shapes\[0\]\.label` is missing"),
        (lambda content: content["shapes"][0].update(points=[[1, 2], [3, 4]]), r"\[0\]: a polygon is three corners"),
        (
            lambda content: content["shapes"][0].update(points=[[1, 2], [3, "x"]]),
            r"`shapes\[0\]\.points\[1\]\[1\]`: a num",
        ),
        (lambda content: content["shapes"][0].update(shape_type="circle"), r"\[0\]: is a circle; draw polygons or"),
        (lambda content: content.update(imagePath="no.jpg"), r"its picture no\.jpg is neither beside it"),
        (lambda content: content.update(imageWidth=5), "is 640x480 but its labels are of 5x480"),
        (lambda content: content.update(imagePath="a-00020.jpg"), r"a-00020\.jpg is labelled in another file too"),
    ],
)
def test_a_malformed_labelme_file_gets_one_line(both: Path, edit: Edit, words: str) -> None:
    edited(both / "images" / "a-00000.json", edit)
    with pytest.raises(OutputError, match=words) as error:
        read_set(both / "images", CLASSES)
    assert "\n" not in str(error.value)


def test_what_is_corrected_in_labelme_is_trained_on(both: Path) -> None:
    def shape(label: str, points: list[list[float]], kind: str | None) -> dict[str, object]:
        return {"label": label, "points": points, "shape_type": kind, "group_id": None, "flags": {}}

    def correct(content: Any) -> None:
        content["shapes"] = [
            shape("column", [[40, 30], [10, 10]], "rectangle"),
            shape("column", [[600, 400], [620, 400], [620, 420], [600, 420]], "oriented_rectangle"),
            shape("goods", [[15, 10], [20, 10], [20, 30], [15, 30]], None),
        ]
        content["imagePath"] = "..\\images\\a-00000.jpg"
        content["imageData"] = "a copy of the picture"

    file = edited(both / "images" / "a-00000.json", correct)
    first, second = read_set(both / "images", CLASSES).samples
    mask = first.load()[1]
    assert (mask == 2).sum() == 30 * 20 - 5 * 20 + 20 * 20
    assert not mask[10:30, 15:20].any()
    assert (second.load()[1] == 1).any()
    edited(file, lambda content: content.update(shapes=[]))
    assert not read_set(both / "images", CLASSES).samples[0].load()[1].any()
    file.unlink()
    assert [sample.image.stem for sample in read_set(both / "images", CLASSES).samples] == ["a-00020"]


def test_a_picture_is_as_large_as_it_is_shown(tmp_path: Path) -> None:
    lying = Image.new("RGB", (64, 48), "white")
    turned = lying.getexif()
    turned[0x0112] = 6
    lying.save(tmp_path / "a.jpg", exif=turned)
    content = coco_of("a.jpg", (48, 64), [[0, 0, 48, 0, 48, 32, 0, 32]])
    (tmp_path / "coco.json").write_text(json.dumps(content), encoding="utf-8")
    picture, mask = read_set(tmp_path, ["column"]).samples[0].load()
    assert picture.shape == (480, 640, 3)
    assert (mask[:238, 145:495] == 1).all()
    assert (mask[242:, 145:495] == 0).all()


def test_a_picture_that_stands_in_two_sets_is_of_one_scene(both: Path) -> None:
    again = shutil.copytree(both, both.parent / "again")
    samples = samples_of([read_set(folder / "coco.json", CLASSES) for folder in (both, again)])
    assert [sample.group for sample in samples] == ["set/0", "set/1"] * 2
    training, validation = held_out(samples, 0.5)
    assert not {sample.image_digest for sample in training} & {sample.image_digest for sample in validation}


def test_paths_of_windows_and_names_in_another_normal_form(both: Path) -> None:
    def windows(content: Any) -> None:
        for image in content["images"]:
            image["file_name"] = "C:\\data\\images\\" + image["file_name"]
        content["images"][0]["file_name"] = "C:\\\u00fc.jpg"

    first, second = (sample.image for sample in read_set(both / "coco.json", CLASSES).samples)
    pictures = [second, first.rename(first.with_name("u\u0308.jpg"))]
    assert [sample.image for sample in read_set(edited(both / "coco.json", windows), CLASSES).samples] == pictures


def test_other_outlines_have_another_digest() -> None:
    square = np.array([[0.0, 0], [4, 0], [4, 4], [0, 4]])
    shapes = [Shapes(8, 8, [(1, [square])]), Shapes(8, 8, [(1, [square + 1])]), Shapes(8, 8, [(2, [square])])]
    assert shapes[0].digest == Shapes(8, 8, [(1, [square])]).digest
    assert len({one.digest for one in shapes}) == 3
