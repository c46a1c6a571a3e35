import json
from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper

from savmap.errors import ModelError
from savmap.plugin.scaffold.stub import stub_network
from savmap.types import Thresholds
from savmap.vision.networks.segmenter import Segmentation, Segmenter, regions

WIDTH, HEIGHT = 64, 48
GOOD = {"savmap.format": "semantic", "savmap.classes": json.dumps(["post"]), "savmap.output": "logits"}


def write_model(path: Path, metadata: dict[str, str], channels: int = 2, layers: int = 3, coarse: int = 1) -> Path:
    """A network whose first logit is 0 and whose second is (red - 128) / 8; further ones repeat it."""
    weights = np.zeros((channels, layers, 1, 1), np.float32)
    weights[1:, 0] = 1 / 8
    bias = np.full(channels, -16.0, np.float32)
    bias[0] = 0
    node = helper.make_node("Conv", ["image", "weights", "bias"], ["out"], strides=[coarse, coarse])
    graph = helper.make_graph(
        [node],
        "red",
        [helper.make_tensor_value_info("image", TensorProto.FLOAT, [1, layers, HEIGHT, WIDTH])],
        [helper.make_tensor_value_info("out", TensorProto.FLOAT, [1, channels, HEIGHT // coarse, WIDTH // coarse])],
        [onnx.numpy_helper.from_array(weights, "weights"), onnx.numpy_helper.from_array(bias, "bias")],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    helper.set_model_props(model, metadata)
    path.write_bytes(model.SerializeToString())
    return path


def picture(width: int = WIDTH, height: int = HEIGHT) -> np.ndarray:
    """Black with a red bar in the columns of the second quarter."""
    image = np.zeros((height, width, 3), np.uint8)
    image[:, width // 4 : width // 2, 0] = 255
    return image


def test_classes_and_probabilities(tmp_path: Path) -> None:
    segmenter = Segmenter(write_model(tmp_path / "m.onnx", GOOD))
    maps = segmenter.probabilities(picture())
    assert segmenter.classes == ("post",)
    assert segmenter.input_size == (WIDTH, HEIGHT)
    assert maps.shape == (2, HEIGHT, WIDTH)
    assert maps.dtype == np.float32
    assert np.allclose(maps.sum(axis=0), 1, atol=1e-6)
    assert np.all(maps[1, :, WIDTH // 4 : WIDTH // 2] > 0.99)
    assert np.all(maps[1, :, WIDTH // 2 :] < 0.01)


def test_a_coarser_output_is_interpolated(tmp_path: Path) -> None:
    maps = Segmenter(write_model(tmp_path / "m.onnx", GOOD, coarse=4)).probabilities(picture())
    assert maps.shape == (2, HEIGHT, WIDTH)
    assert np.all(maps[1, :, WIDTH // 4 + 4 : WIDTH // 2 - 4] > 0.99)
    assert np.all(maps[1, :, WIDTH // 2 + 4 :] < 0.01)
    with pytest.raises(ModelError, match="or 2, 4 or 8 times as coarse, not"):
        Segmenter(write_model(tmp_path / "m.onnx", GOOD, coarse=16))


@pytest.mark.parametrize("scale", [2, 0.5])
def test_a_view_of_another_size_comes_back_in_its_own(tmp_path: Path, scale: float) -> None:
    width, height = int(WIDTH * scale), int(HEIGHT * scale)
    maps = Segmenter(write_model(tmp_path / "m.onnx", GOOD)).probabilities(picture(width, height))
    assert maps.shape == (2, height, width)
    columns = np.flatnonzero(maps[1, height // 2] > 0.5)
    assert (columns[0], columns[-1]) == (width // 4, width // 2 - 1)


def test_missing_file(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match=r"none\.onnx: no such model file; train one"):
        Segmenter(tmp_path / "none.onnx")


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"savmap.format": "boxes"}, "savmap.format"),
        ({"savmap.classes": "post"}, "the classes in its metadata cannot be read"),
        ({"savmap.classes": "[]"}, "a list of names is expected"),
        ({"savmap.classes": '["post", "bar"]'}, "its output must be"),
        ({"savmap.output": "logit"}, "savmap.output must be `logits` or `probabilities`, not `logit`"),
    ],
)
def test_metadata_that_breaks_the_contract(tmp_path: Path, changed: dict[str, str], message: str) -> None:
    with pytest.raises(ModelError, match=message):
        Segmenter(write_model(tmp_path / "m.onnx", GOOD | changed))


def test_no_metadata_or_a_wrong_input(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match=r"savmap\.format"):
        Segmenter(write_model(tmp_path / "m.onnx", {}))
    with pytest.raises(ModelError, match="its input must be"):
        Segmenter(write_model(tmp_path / "m.onnx", GOOD, layers=4))


def two_blobs() -> np.ndarray:
    probability = np.zeros((HEIGHT, WIDTH), np.float32)
    probability[4:10, 4:10] = 0.9
    probability[10, 10] = 0.7
    probability[30:32, 40:42] = 0.8
    return probability


def test_regions_touching_at_a_corner_are_one() -> None:
    found = regions("post", two_blobs(), 0.5, 1)
    assert [int(d.mask.sum()) for d in found] == [37, 4]
    assert found[0].score == pytest.approx((36 * 0.9 + 0.7) / 37, abs=1e-6)
    assert found[0].probability is found[1].probability


def test_small_regions_weak_pixels_and_regions_without_a_seed_are_left_out() -> None:
    assert len(regions("post", two_blobs(), 0.5, 5)) == 1
    assert int(regions("post", two_blobs(), 0.75, 5)[0].mask.sum()) == 36
    assert len(regions("post", two_blobs(), Thresholds.of(0.5, seed=0.85), 1)) == 1
    assert len(regions("post", two_blobs(), Thresholds.of(0.5, seed=0.75), 1)) == 2


def test_detections_are_labelled_by_class() -> None:
    blank = np.zeros((HEIGHT, WIDTH), np.float32)
    found = Segmentation(("post", "bar"), np.stack([1 - two_blobs(), blank, two_blobs()])).detections(0.5, 1)
    assert [d.label for d in found] == ["bar", "bar"]


def test_a_network_with_broken_metadata_is_one_line(tmp_path: Path) -> None:
    content = stub_network("post", "1").replace(b"semantic", b"sem\xb0ntic")
    (tmp_path / "a.onnx").write_bytes(content)
    with pytest.raises(ModelError, match="a text in it is not UTF-8"):
        Segmenter(tmp_path / "a.onnx")


@pytest.mark.parametrize("sides", [(0, 640), (480, 1 << 40), (1, 1)])
def test_a_network_of_absurd_pictures_is_one_line(tmp_path: Path, sides: tuple[int, int]) -> None:
    model = onnx.load_from_string(stub_network("post", "1"))
    for dim, side in zip(model.graph.input[0].type.tensor_type.shape.dim[2:], sides, strict=True):
        dim.dim_value = side
    (tmp_path / "a.onnx").write_bytes(model.SerializeToString())
    with pytest.raises(ModelError, match=rf"takes pictures of {sides[1]}x{sides[0]}; sides are 8 to 8192 pixels"):
        Segmenter(tmp_path / "a.onnx")
