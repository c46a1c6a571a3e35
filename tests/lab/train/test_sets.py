"""Sets of other tools: COCO instances, YOLO segments and LabelMe's files."""

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
from savmap.lab.train.data.coco import mask_of, unpacked
from savmap.lab.train.data.dataset import IGNORE, group_of, held_out
from savmap.lab.train.data.sets import read_set, samples_of

from .conftest import edited, masks, write_dataset

CLASSES = ["crossbar", "column"]


@pytest.mark.parametrize("name", ["coco.json", "data.yaml", "images"])
def test_masks_come_back_to_the_pixel(both: Path, name: str) -> None:
    dataset = read_set(both / name, CLASSES)
    assert dataset.folder == both
    assert len(dataset.samples) == 2
    _, mask = dataset.samples[0].load()
    _, truth = masks(1)[0]
    assert np.array_equal(mask, np.array([0, 2, 1], np.uint8)[truth])
    assert dataset.samples[0].group == f"set/{group_of('a-00000')}"


def test_a_folder_is_recognised_by_what_is_in_it(both: Path, tmp_path: Path) -> None:
    with pytest.raises(
        OutputError, match=r"several kinds \(.*set/coco\.json, .*set/images, .*set/data\.yaml\); give one of them"
    ):
        read_set(both, CLASSES)
    (both / "data.yaml").unlink()
    with pytest.raises(OutputError, match=r"several kinds \(.*coco\.json, .*images\)"):
        read_set(both, CLASSES)
    (both / "coco.json").rename(tmp_path / "elsewhere.json")
    assert read_set(both, CLASSES).renderer == "labelled (LabelMe)"
    for file in (both / "images").glob("*.json"):
        file.unlink()
    with pytest.raises(OutputError, match=r"no dataset\.json, nor labels of another kind"):
        read_set(both, CLASSES)
    (tmp_path / "elsewhere.json").rename(both / "coco.json")
    assert read_set(both, CLASSES).renderer == "labelled (COCO)"
    own = write_dataset(tmp_path / "own", 2)
    assert read_set(own, CLASSES).renderer == read_set(own / "dataset.json", CLASSES).renderer == "made up"
    (both / "coco.json").rename(own / "coco.json")
    with pytest.raises(OutputError, match=r"several kinds \(.*dataset\.json, .*coco\.json\)"):
        read_set(own, CLASSES)
    with pytest.raises(OutputError, match="no such file or folder"):
        read_set(tmp_path / "none", CLASSES)


def test_as_cvat_lays_it_out(both: Path) -> None:
    (both / "annotations").mkdir()
    (both / "coco.json").rename(both / "annotations" / "instances_default.json")
    (both / "images").rename(both / "default")
    (both / "images").mkdir()
    (both / "default").rename(both / "images" / "default")
    (both / "data.yaml").unlink()
    dataset = read_set(both, CLASSES)
    assert dataset.samples[0].group.startswith("set/")
    assert dataset.folder == both


def test_classes_by_other_names(both: Path) -> None:
    with pytest.raises(OutputError, match=r"has no class post \(it has column, crossbar\).* say --class THEIRS=post"):
        read_set(both / "coco.json", ["post"])
    for name in ("coco.json", "data.yaml"):
        dataset = read_set(both / name, ["post"], {"column": "post"})
        assert set(np.unique(dataset.samples[0].load()[1])) == {0, 1}
    own = write_dataset(both.parent / "own", 1)
    assert np.array_equal(
        read_set(own, ["post"], {"column": "post"}).samples[0].load()[1], read_set(own, ["column"]).samples[0].load()[1]
    )


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


def test_holes_parts_and_runs(both: Path) -> None:
    square = [[10, 10, 40, 10, 40, 40, 10, 40], [100, 10, 120, 10, 120, 30, 100, 30]]
    runs = {"counts": [640 * 480 - 480, 480], "size": [480, 640]}

    def edit(content: Any) -> None:
        first, second = content["images"]
        column = {"image_id": first["id"], "category_id": 1, "segmentation": square}
        crowd = {"image_id": second["id"], "category_id": 2, "segmentation": runs, "iscrowd": 1}
        content["annotations"] = [column, crowd]

    dataset = read_set(edited(both / "coco.json", edit), CLASSES)
    parts, crowd = dataset.samples[0].load()[1], dataset.samples[1].load()[1]
    assert (parts == 2).sum() == 30 * 30 + 20 * 20
    assert (crowd[:, -1] == 1).all()
    assert (crowd == 1).sum() == 480


def test_packed_runs() -> None:
    assert unpacked("03") == [0, 3]
    assert unpacked("52203") == [5, 2, 2, 2, 5]
    assert unpacked("522O") == [5, 2, 2, 1]
    assert unpacked("PPP1") == [32768]
    assert mask_of([1, 2, 3], 2, 3).tolist() == [[False, True, False], [True, False, False]]
    for wrong in ("5p", "P", "\n"):
        with pytest.raises(ValueError, match="run-length string"):
            unpacked(wrong)


def drop(key: str) -> Callable[[Any], None]:
    return lambda content: content["annotations"][0].pop(key)


def put(key: str, value: object) -> Callable[[Any], None]:
    return lambda content: content["annotations"][0].update({key: value})


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        (drop("image_id"), r"`annotations\[0\]\.image_id` is missing"),
        (put("image_id", 99), r"annotations\[0\]: there is no image 99"),
        (put("category_id", 99), r"annotations\[0\]: there is no category 99"),
        (put("segmentation", []), r"annotations\[0\]: has a box, but no outline"),
        (put("segmentation", [[1, 2, 3]]), r"annotations\[0\]: a polygon is three corners or more"),
        (put("segmentation", "x"), r"`annotations\[0\]\.segmentation"),
        (
            put("segmentation", {"counts": [5], "size": [480, 640]}),
            r"annotations\[0\]: runs of 5 pixels in a picture of",
        ),
        (
            put("segmentation", {"counts": [5], "size": [1, 5]}),
            r"annotations\[0\]: its mask is 5x1, its picture 640x480",
        ),
        (
            put("segmentation", {"counts": "P", "size": [480, 640]}),
            r"annotations\[0\]: a run-length string that breaks off",
        ),
        (lambda content: content["images"].append(content["images"][0]), "id 1 stands twice in images"),
        (
            lambda content: content["images"][0].update(file_name="gone.jpg"),
            r"its picture gone\.jpg is neither beside it",
        ),
        (lambda content: content["images"][0].update(width=5), r"a-00000\.jpg: is 640x480, but coco\.json says 5x480"),
        (lambda content: content.update(images=[], annotations=[]), "names no pictures"),
        (lambda content: content.pop("categories"), "is not COCO"),
    ],
)
def test_a_malformed_coco_file_gets_one_line(both: Path, edit: Callable[[Any], None], words: str) -> None:
    with pytest.raises(OutputError, match=words) as error:
        read_set(edited(both / "coco.json", edit), CLASSES)
    assert "\n" not in str(error.value)
    assert "coco.json" in str(error.value)


@pytest.mark.parametrize(
    ("file", "text", "words"),
    [
        ("labels/a-00000.txt", "0 0.1 0.1 0.2 0.2\n", r"a-00000\.txt:1: is a box; label outlines"),
        ("labels/a-00000.txt", "\nx y\n", r"a-00000\.txt:2: a class's number and corners are expected, not `x y`"),
        ("labels/a-00000.txt", "7 0 0 1 0 1 1\n", r"a-00000\.txt:1: data\.yaml names no class 7"),
        ("labels/a-00000.txt", "0 0 0 1 0 1\n", r"a-00000\.txt:1: a polygon is three corners"),
        ("labels/a-00000.txt", "0 0 0 nan 0 1 1\n", r"a-00000\.txt:1: a corner is not a finite number"),
        ("labels/a-00000.txt", "0 0 0 640 0 640 480\n", r"a-00000\.txt:1: corners are shares of width and height"),
        ("images/a-00000.jpg", "", r"a-00000\.jpg: the picture cannot be read"),
        ("data.yaml", "names: [column, crossbar]\ntrain: pictures\n", r"data\.yaml: there is no pictures beside it"),
        ("data.yaml", "names: 3\ntrain: images\n", r"data\.yaml: `names"),
        ("data.yaml", "names: [column, crossbar]\n", r"data\.yaml: names no pictures"),
        ("data.yaml", "a: [\n", r"data\.yaml:2: is not YAML"),
        ("data.yaml", "date: !!float x\n", r"data\.yaml:1: is not YAML"),
        ("data.yaml", "[]", r"data\.yaml: is not a data\.yaml"),
    ],
)
def test_a_malformed_yolo_set_gets_one_line(both: Path, file: str, text: str, words: str) -> None:
    (both / file).write_text(text, encoding="utf-8")
    with pytest.raises(OutputError, match=words) as error:
        read_set(both / "data.yaml", CLASSES)
    assert "\n" not in str(error.value)


def test_a_yolo_picture_without_a_file_of_labels_shows_nothing(both: Path) -> None:
    (both / "labels" / "a-00000.txt").unlink()
    (both / "train.txt").write_text("images/a-00000.jpg\nimages/a-00020.jpg\n", encoding="utf-8")
    (both / "data.yaml").write_text("names: {0: column, 1: crossbar}\ntrain: train.txt\n", encoding="utf-8")
    dataset = read_set(both / "data.yaml", CLASSES)
    assert [bool(sample.load()[1].any()) for sample in dataset.samples] == [False, True]
    (both / "labels" / "a-00020.txt").unlink()
    with pytest.raises(
        OutputError, match=r"data\.yaml: none of its pictures has labels \(such as .*labels/a-00000\.txt\)"
    ):
        read_set(both / "data.yaml", CLASSES)


def test_yolo_labels_beside_the_pictures_in_a_set_below_a_folder_called_images(tmp_path: Path) -> None:
    folder = tmp_path / "images" / "set"
    (folder / "train").mkdir(parents=True)
    cv2.imwrite(str(folder / "train" / "a.png"), np.zeros((48, 64, 3), np.uint8))
    (folder / "train" / "a.txt").write_text("0 0 0 1 0 1 1 0 1\n", encoding="utf-8")
    (folder / "data.yaml").write_text("names: [column]\ntrain: train\n", encoding="utf-8")
    assert read_set(folder, ["column"]).samples[0].labels.mask().all()


def test_a_picture_is_as_large_as_it_is_shown(tmp_path: Path) -> None:
    lying = Image.new("RGB", (64, 48), "white")
    turned = lying.getexif()
    turned[0x0112] = 6
    lying.save(tmp_path / "a.jpg", exif=turned)
    content = {
        "images": [{"id": 1, "file_name": "a.jpg", "width": 48, "height": 64}],
        "annotations": [{"image_id": 1, "category_id": 1, "segmentation": [[0, 0, 48, 0, 48, 32, 0, 32]]}],
        "categories": [{"id": 1, "name": "column"}],
    }
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
    assert not {one.image_digest for one in training} & {one.image_digest for one in validation}


def test_paths_of_windows_are_read(both: Path) -> None:
    def windows(content: Any) -> None:
        for image in content["images"]:
            image["file_name"] = "C:\\data\\images\\" + image["file_name"]

    pictures = [sample.image for sample in read_set(both / "coco.json", CLASSES).samples]
    assert [sample.image for sample in read_set(edited(both / "coco.json", windows), CLASSES).samples] == pictures
    (both / "train.txt").write_text("".join(f"images\\{picture.name}\n" for picture in pictures), encoding="utf-8")
    (both / "data.yaml").write_text("names: [crossbar, column]\ntrain: .\\train.txt\n", encoding="utf-8")
    assert [sample.image for sample in read_set(both / "data.yaml", CLASSES).samples] == sorted(pictures)


def test_pictures_in_another_normal_form_are_found(both: Path) -> None:
    def composed(content: Any) -> None:
        content["images"][0]["file_name"] = "\u00fc.jpg"

    first = read_set(both / "coco.json", CLASSES).samples[0].image
    first.rename(first.with_name("u\u0308.jpg"))
    samples = read_set(edited(both / "coco.json", composed), CLASSES).samples
    assert any(sample.image.name == "u\u0308.jpg" for sample in samples)
