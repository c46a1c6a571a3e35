"""Other people's networks: each layout by a graph whose answer is known."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from onnx import helper

from savmap.errors import ModelError
from savmap.vision.networks.segmenter import Segmenter

from .made_up_networks import SIDE, constant, detr, edges, picture, redness, save, yolo
from .test_segmenter import GOOD, write_model

NAMES = {0: "post", 1: "bar"}
WHOLE = (SIDE / 2, SIDE / 2, SIDE, SIDE)
LEFT, RIGHT = (16.0, 32.0, 32.0, 64.0), (48.0, 32.0, 32.0, 64.0)
POST, BAR = (0.9, 0.1), (0.1, 0.8)


@pytest.mark.parametrize(("width", "height"), [(SIDE, SIDE), (128, 96), (96, 128), (32, 32)])
def test_yolo_masks_lie_where_the_picture_has_them(tmp_path: Path, width: int, height: int) -> None:
    network = Segmenter(yolo(tmp_path / "m.onnx", [(WHOLE, POST)], NAMES))
    maps = network.probabilities(picture(width, height, (width // 4, width // 2)))
    assert network.kind == "YOLO-seg"
    assert network.classes == ("post", "bar")
    assert maps.shape == (3, height, width)
    assert maps.dtype == np.float32
    assert edges(maps[1, height // 2]) == pytest.approx([width / 4 - 0.5, width / 2 - 0.5], abs=0.25)
    assert not maps[2].any()
    assert np.allclose(maps[0], 1 - maps[1])


def test_yolo_instances_that_touch_are_two(tmp_path: Path) -> None:
    network = Segmenter(yolo(tmp_path / "m.onnx", [(LEFT, POST), (RIGHT, POST)], NAMES))
    found = network.detections(picture(SIDE, SIDE, (0, SIDE)), 0.5, 12)
    assert [each.label for each in found] == ["post", "post"]
    columns = [np.flatnonzero(each.mask.any(axis=0)) for each in found]
    assert abs(columns[0][-1] - SIDE // 2) <= 4
    assert columns[1][0] == columns[0][-1] + 1
    assert not (found[0].mask & found[1].mask).any()
    assert found[0].probability is found[1].probability or np.shares_memory(found[0].probability, found[1].probability)


def test_yolo_finds_a_thing_once_and_nothing_it_is_unsure_of(tmp_path: Path) -> None:
    again = (SIDE / 2 + 1, SIDE / 2, SIDE, SIDE)
    inside = (SIDE / 2, SIDE / 2, SIDE / 2, SIDE / 2)
    boxes = [(again, (0.6, 0.1)), (WHOLE, POST), (inside, (0.5, 0.0)), (WHOLE, (0.1, 0.2))]
    found = Segmenter(yolo(tmp_path / "m.onnx", boxes, NAMES)).detections(picture(SIDE, SIDE, (16, 32)), 0.5, 12)
    assert [one.label for one in found] == ["post"]
    network = Segmenter(yolo(tmp_path / "m.onnx", [(WHOLE, POST), (WHOLE, BAR)], NAMES))
    found = network.detections(picture(SIDE, SIDE, (16, 32)), 0.5, 12)
    assert [one.label for one in found] == ["post", "bar"], "two classes may be at one place"


def test_a_mask_ends_with_its_box(tmp_path: Path) -> None:
    network = Segmenter(yolo(tmp_path / "m.onnx", [(LEFT, POST)], NAMES))
    (found,) = network.detections(picture(SIDE, SIDE, (8, 24), (48, 60)), 0.5, 12)
    assert np.flatnonzero(found.mask.any(axis=0)).tolist() == list(range(8, 24))


def test_yolo_exports_without_double_boxes_give_the_same(tmp_path: Path) -> None:
    boxes, image = [(LEFT, POST), (RIGHT, BAR)], picture(96, 64, (10, 80))
    plain = Segmenter(yolo(tmp_path / "a.onnx", boxes, NAMES)).predict(image)
    complete = Segmenter(yolo(tmp_path / "b.onnx", boxes, NAMES, complete=True)).predict(image)
    assert np.array_equal(plain.maps, complete.maps)
    assert plain.maps[1:].max(axis=(1, 2)).min() > 0.9


@pytest.mark.parametrize("kind", ["dynamic", "half"])
def test_yolo_exports_of_open_size_and_of_half_precision(tmp_path: Path, kind: str) -> None:
    network = Segmenter(yolo(tmp_path / "m.onnx", [(WHOLE, POST)], NAMES, **{kind: True}))  # type: ignore[arg-type]
    assert network.input_size == (SIDE, SIDE)
    maps = network.probabilities(picture(128, 96, (32, 64)))
    assert edges(maps[1, 48]) == pytest.approx([31.5, 63.5], abs=0.25)


@pytest.mark.parametrize(
    "class_names", [{"post": "pillar", "bar": "rail"}, {"0": "pillar", "1": "rail"}], ids=["names", "numbers"]
)
def test_classes_are_called_what_the_site_calls_them(tmp_path: Path, class_names: dict[str, str]) -> None:
    path = yolo(tmp_path / "m.onnx", [(LEFT, POST), (RIGHT, BAR)], NAMES)
    found = Segmenter(path, 1, class_names).detections(picture(SIDE, SIDE, (0, SIDE)), 0.5, 12)
    assert [one.label for one in found] == ["pillar", "rail"]
    only = Segmenter(path, 1, class_names, {"rail"})
    assert only.classes == ("rail",)
    assert only.probabilities(picture(SIDE, SIDE, (0, SIDE))).shape == (2, SIDE, SIDE)
    joined = Segmenter(path, 1, {"bar": "post"}).detections(picture(SIDE, SIDE, (0, SIDE)), 0.5, 12)
    assert [one.label for one in joined] == ["post", "post"]


def test_semantic_classes_are_renamed_and_summed(tmp_path: Path) -> None:
    two = GOOD | {"savmap.classes": '["post", "bar"]'}
    path = write_model(tmp_path / "m.onnx", two, channels=3)
    image = picture(64, 48, (16, 32))
    plain = Segmenter(path).probabilities(image)
    summed = Segmenter(path, 1, {"bar": "post"})
    assert summed.classes == ("post",)
    assert np.allclose(summed.probabilities(image)[1], plain[1] + plain[2], atol=1e-6)
    alone = Segmenter(path, 1, {}, {"bar"}).probabilities(image)
    assert np.allclose(alone[0], plain[0] + plain[1], atol=1e-6)


def test_a_class_name_that_the_network_has_not(tmp_path: Path) -> None:
    path = yolo(tmp_path / "m.onnx", [(WHOLE, POST)], NAMES)
    with pytest.raises(ModelError, match=r"`class_names` names `pots`, .*did you mean `post`\?"):
        Segmenter(path, 1, {"pots": "pillar"})


@pytest.mark.parametrize(
    ("names", "boxes", "logits"),
    [
        (("labels", "masks"), "dets", [[3.0, -3.0], [-3.0, -2.0]]),
        (("labels", "4245"), "dets", [[3.0, -3.0], [-3.0, -2.0]]),
        (("class_queries_logits", "masks_queries_logits"), None, [[4.0, 0.0, 0.0], [1.0, 0.0, 4.0]]),
        (("logits", "pred_masks"), "pred_boxes", [[4.0, 0.0, 0.0], [1.0, 0.0, 4.0]]),
    ],
    ids=["RF-DETR", "RF-DETR, masks unnamed", "Mask2Former", "DETR"],
)
def test_detr_layouts(tmp_path: Path, names: tuple[str, str], boxes: str | None, logits: list[list[float]]) -> None:
    path = detr(tmp_path / "m.onnx", logits, names, boxes, **{"savmap.classes": '["post", "bar"]'})
    network = Segmenter(path)
    assert (network.kind, network.classes) == ("DETR-like", ("post", "bar"))
    image = picture(128, 96, (32, 64))
    (found,) = network.detections(image, 0.5, 12)
    assert found.label == "post"
    assert edges(found.probability[48]) == pytest.approx([31.5, 63.5], abs=0.25)


def test_networks_without_names_number_their_classes(tmp_path: Path) -> None:
    assert Segmenter(yolo(tmp_path / "y.onnx", [(WHOLE, POST)])).classes == ("0", "1")
    path = detr(tmp_path / "m.onnx", [[-9.0, 5.0, -9.0]], ("labels", "masks"), "dets")
    assert Segmenter(path).classes == ("0", "1", "2")
    assert Segmenter(path, 1, {"1": "post"}, {"post"}).classes == ("post",)


def test_a_network_of_no_kind_that_is_taken(tmp_path: Path) -> None:
    table = constant("output0", np.zeros((1, 6, 10)))
    path = save(tmp_path / "m.onnx", [table], {"output0": (1, 6, 10)}, {"task": "detect"})
    with pytest.raises(ModelError) as told:
        Segmenter(path)
    line = str(told.value)
    assert told.value.exit_code == 6
    assert "\n" not in line
    for part in ("images (1, 3, 64, 64)", "output0 (1, 6, 10)", "task = detect", "semantic", "YOLO-seg", "DETR-like"):
        assert part in line


@pytest.mark.parametrize(
    ("metadata", "message"),
    [
        ({"names": "{0: 'post'}"}, r"1 classes and 2 masks make 7 numbers a box, but output0 .* has 8"),
        ({"names": "post, bar"}, "classes in its metadata cannot be read"),
        ({"names": "{}"}, "classes in its metadata cannot be read"),
        ({"names": "{1: 'post', 2: 'bar'}"}, "cannot be read: numbers from 0 are expected, not 1, 2"),
        ({"task": "detect"}, "of no kind that is taken"),
    ],
)
def test_yolo_metadata_that_does_not_fit(tmp_path: Path, metadata: dict[str, str], message: str) -> None:
    with pytest.raises(ModelError, match=message):
        Segmenter(yolo(tmp_path / "m.onnx", [(WHOLE, POST)], **metadata))
    digits = {"1": "bar", "0": "post"}
    assert Segmenter(yolo(tmp_path / "m.onnx", [(WHOLE, POST)], str(digits))).classes == ("post", "bar")


@pytest.mark.parametrize(("imgsz", "size"), [("[96, 64]", (64, 96)), ("96", (96, 96)), ("[0, 64]", (640, 640))])
def test_the_size_of_a_yolo_file_of_open_size(tmp_path: Path, imgsz: str, size: tuple[int, int]) -> None:
    assert Segmenter(yolo(tmp_path / "m.onnx", [(WHOLE, POST)], NAMES, dynamic=True, imgsz=imgsz)).input_size == size


def test_a_number_of_a_class_that_has_no_name(tmp_path: Path) -> None:
    network = Segmenter(yolo(tmp_path / "m.onnx", [(WHOLE, (0.1, 0.1, 0.9))], NAMES, complete=True))
    with pytest.raises(ModelError, match="gives class 2, but its metadata names 2 from 0"):
        network.predict(picture(SIDE, SIDE))


def test_a_network_that_cannot_be_run_is_told_in_one_line(tmp_path: Path) -> None:
    """A graph of open size that adds a picture of its own, 64x64."""
    nodes = [
        constant("own", np.zeros((1, 3, SIDE, SIDE))),
        helper.make_node("Add", ["images", "own"], ["sum"]),
        *redness(0.5, 1.0, "sum"),
        helper.make_node("Neg", ["red"], ["other"]),
        helper.make_node("Concat", ["red", "other"], ["output1"], axis=1),
        constant("output0", np.zeros((1, 8, 5))),
    ]
    shapes: dict[str, Sequence[int | str]] = {"output0": (1, 8, 5), "output1": (1, 2, "g", "g")}
    told = {"task": "segment", "imgsz": "[96, 128]", "names": str(NAMES)}
    path = save(tmp_path / "m.onnx", nodes, shapes, told, "side")
    with pytest.raises(ModelError, match=r"m\.onnx: cannot be run on a picture of 128x96 \(") as caught:
        Segmenter(path).predict(picture(SIDE, SIDE))
    assert "\n" not in str(caught.value)


def test_detr_that_is_as_sure_as_can_be(tmp_path: Path) -> None:
    network = Segmenter(detr(tmp_path / "m.onnx", [[-200.0, 200.0]], ("labels", "masks"), "dets"))
    assert [one.label for one in network.detections(picture(SIDE, SIDE, (16, 32)), 0.5, 12)] == ["1"]


def test_where_no_class_is_asked_for_all_is_background(tmp_path: Path) -> None:
    maps = Segmenter(yolo(tmp_path / "m.onnx", [(WHOLE, POST)], NAMES), 1, {}, ()).probabilities(picture(SIDE, SIDE))
    assert maps.shape == (1, SIDE, SIDE)
    assert np.all(maps == 1)


def test_detr_names_that_do_not_fit(tmp_path: Path) -> None:
    path = detr(tmp_path / "m.onnx", [[4.0, 0.0, 0.0]], ("logits", "pred_masks"), **{"savmap.classes": '["post"]'})
    with pytest.raises(ModelError, match=r"names 1 classes, but logits .* has 2"):
        Segmenter(path)


def test_nothing_found_is_nothing(tmp_path: Path) -> None:
    for path in (
        yolo(tmp_path / "a.onnx", [(WHOLE, (0.1, 0.1))], NAMES),
        detr(tmp_path / "b.onnx", [[-9.0, -9.0]], ("labels", "masks")),
    ):
        segmentation = Segmenter(path).predict(picture(96, 64, (16, 32)))
        assert segmentation.detections(0.5, 1) == []
        assert np.all(segmentation.maps[0] == 1)
        assert not segmentation.maps[1:].any()
