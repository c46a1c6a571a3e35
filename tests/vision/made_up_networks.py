"""Small networks with known answers in the layouts of other people's exports: their masks are where the picture is red."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

SIDE = 64
CELL = 4
GRID = SIDE // CELL
STEEP = 20.0

Box = tuple[float, float, float, float]
"""Centre, width, height, in pixels of the input."""


def constant(name: str, value: Any) -> onnx.NodeProto:
    return helper.make_node("Constant", [], [name], value=numpy_helper.from_array(np.asarray(value, np.float32)))


def redness(threshold: float, width: float, given: str = "images") -> list[onnx.NodeProto]:
    """Nodes to `red` (1, 1, h/4, w/4): positive where the mean of a cell's red is above `threshold`, a difference of `width` giving 20."""
    bounds = [("start", [0]), ("end", [1]), ("axis", [1])]
    return [
        *(
            helper.make_node("Constant", [], [name], value=numpy_helper.from_array(np.array(value, np.int64)))
            for name, value in bounds
        ),
        helper.make_node("Slice", [given, "start", "end", "axis"], ["channel"]),
        helper.make_node("AveragePool", ["channel"], ["mean"], kernel_shape=[CELL, CELL], strides=[CELL, CELL]),
        constant("threshold", threshold),
        constant("slope", STEEP / width),
        helper.make_node("Sub", ["mean", "threshold"], ["above"]),
        helper.make_node("Mul", ["above", "slope"], ["red"]),
    ]


def save(
    path: Path,
    nodes: Sequence[onnx.NodeProto],
    outputs: dict[str, Sequence[int | str]],
    metadata: dict[str, str],
    side: int | str = SIDE,
    half: bool = False,
) -> Path:
    kind = TensorProto.FLOAT16 if half else TensorProto.FLOAT
    graph = helper.make_graph(
        list(nodes),
        "made up",
        [helper.make_tensor_value_info("images", kind, [1, 3, side, side])],
        [helper.make_tensor_value_info(name, TensorProto.FLOAT, list(shape)) for name, shape in outputs.items()],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    helper.set_model_props(model, metadata)
    path.write_bytes(model.SerializeToString())
    return path


def yolo(
    path: Path,
    boxes: Sequence[tuple[Box, Sequence[float]]],
    names: dict[int, str] | str | None = None,
    complete: bool = False,
    dynamic: bool = False,
    half: bool = False,
    **metadata: str,
) -> Path:
    """A network as ultralytics exports it, with two prototypes, redness and its contrary, and boxes (box, scores of the classes)
    whose masks are the redness in them."""
    rows = np.array([[*box, *scores, 1.0, 0.0] for box, scores in boxes], np.float32)
    table = ends(boxes) if complete else rows.T
    cast = [helper.make_node("Cast", ["images"], ["full"], to=TensorProto.FLOAT)] if half else []
    nodes = [
        *cast,
        *redness(0.5, 1.0, "full" if half else "images"),
        helper.make_node("Neg", ["red"], ["other"]),
        helper.make_node("Concat", ["red", "other"], ["output1"], axis=1),
        constant("output0", table[None]),
    ]
    grid: int | str = "grid" if dynamic else GRID
    shapes: dict[str, Sequence[int | str]] = {"output0": (1, *table.shape), "output1": (1, 2, grid, grid)}
    own = {"task": "segment", "stride": "32", "imgsz": f"[{SIDE}, {SIDE}]", **metadata}
    if names is not None:
        own["names"] = str(names)
    return save(path, nodes, shapes, own, "side" if dynamic else SIDE, half)


def ends(boxes: Sequence[tuple[Box, Sequence[float]]]) -> np.ndarray:
    """Rows (n, 8) as exports have them that leave out double boxes themselves."""
    found = []
    for (x, y, width, height), scores in boxes:
        corners = (x - width / 2, y - height / 2, x + width / 2, y + height / 2)
        found.append([*corners, max(scores), int(np.argmax(scores)), 1.0, 0.0])
    return np.array(found, np.float32)


def detr(
    path: Path, logits: Sequence[Sequence[float]], names: tuple[str, str], boxes: str | None = None, **metadata: str
) -> Path:
    """A network with a query a row of `logits`, all of whose masks are the redness of a picture normalised by ImageNet's; `names` of the
    scores and the masks, `boxes` of the boxes."""
    count = len(logits)
    mean, deviation = 0.485, 0.229
    nodes = [
        *redness((0.5 - mean) / deviation, 1 / deviation),
        *(helper.make_node("Identity", ["red"], [f"red{number}"]) for number in range(count)),
        helper.make_node("Concat", [f"red{number}" for number in range(count)], [names[1]], axis=1),
        constant(names[0], np.array(logits)[None]),
    ]
    shapes: dict[str, Sequence[int | str]] = {names[0]: (1, *np.shape(logits)), names[1]: (1, count, GRID, GRID)}
    if boxes is not None:
        nodes.append(constant(boxes, np.full((1, count, 4), 0.5)))
        shapes[boxes] = (1, count, 4)
    return save(path, nodes, shapes, metadata)


def picture(width: int, height: int, *bars: tuple[int, int]) -> np.ndarray:
    """Black with red bars from column to column, the last one left out."""
    image = np.zeros((height, width, 3), np.uint8)
    for first, last in bars:
        image[:, first:last, 0] = 255
    return image


def edges(row: np.ndarray) -> list[float]:
    """Where along a row of probabilities these pass one half, pixels between linear interpolations."""
    at = np.flatnonzero((row[:-1] > 0.5) != (row[1:] > 0.5))
    return [float(n + (0.5 - row[n]) / (row[n + 1] - row[n])) for n in at]
