"""A real YOLO-seg export with random weights, read by savmap and by ultralytics. Only where ultralytics is installed."""

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from savmap.vision.networks.segmenter import Segmenter

ultralytics = pytest.importorskip("ultralytics", reason="ultralytics is no dependency; see bench/yolo_export.py")
torch = pytest.importorskip("torch")
tasks = pytest.importorskip("ultralytics.nn.tasks")
pytestmark = pytest.mark.filterwarnings("ignore")
SHARE = 0.004
MARGIN_PX = 15
"""Twice, and one more, what savmap lets a mask go on beyond its box: a cell of the grid of masks."""
DOUBLED = 0.8
"""ultralytics keeps both of two instances that share most of their masks where their boxes differ enough."""


def made(architecture: str) -> Any:
    """A network of two classes with random weights that is sure of a few boxes: its classes' biases are set by a picture."""
    torch.manual_seed(0)
    layout = {**tasks.yaml_model_load(architecture), "nc": 2}
    Path(architecture).write_text(json.dumps(layout), encoding="utf-8")
    model = ultralytics.YOLO(str(Path(architecture).absolute()), task="segment")
    model.model.eval().names = {0: "upright", 1: "beam"}
    head = model.model.model[-1]
    for layers in head.cv3:
        torch.nn.init.normal_(layers[-1].weight, std=3.0)
        torch.nn.init.zeros_(layers[-1].bias)
    with torch.no_grad():
        rows = model.model(torch.from_numpy(picture()).permute(2, 0, 1)[None] / 255.0)[0]
        rows = rows[0] if isinstance(rows, tuple | list) else rows
        logits = torch.logit(rows[0, 4:6].max(dim=0).values.double(), eps=1e-12)
        shift = float(torch.quantile(logits, 1 - SHARE)) - float(np.log(1 / 3))
        for layers in head.cv3:
            layers[-1].bias -= shift
    return model


def picture(width: int = 320, height: int = 256) -> np.ndarray:
    """Blurred noise."""
    noise = np.random.default_rng(1).integers(0, 255, (height // 16, width // 16, 3)).astype(np.uint8)
    return np.asarray(cv2.resize(noise, (width, height), interpolation=cv2.INTER_CUBIC), np.uint8)


@pytest.mark.parametrize("architecture", ["yolov8n-seg.yaml", "yolo11n-seg.yaml"])
@pytest.mark.parametrize(("width", "height"), [(320, 256), (400, 300)])
def test_masks_are_ultralytics_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, architecture: str, width: int, height: int
) -> None:
    monkeypatch.chdir(tmp_path)
    path = Path(made(architecture).export(format="onnx", imgsz=[256, 320], simplify=False))
    network = Segmenter(path, 1, providers=("cpu",))
    assert (network.kind, network.classes, network.input_size) == ("YOLO-seg", ("upright", "beam"), (320, 256))
    image = picture(width, height)
    segmentation = network.predict(image)
    own = ultralytics.YOLO(str(path), task="segment")
    told = own.predict(image[:, :, ::-1], conf=0.25, iou=0.7, retina_masks=True, verbose=False)[0]
    kinds = told.boxes.cls.numpy().astype(int)
    assert len(kinds) > 1
    for number in set(kinds):
        theirs = (told.masks.data.numpy()[kinds == number] > 0.5).any(axis=0)
        ours = segmentation.maps[number + 1] > 0.5
        near = cv2.dilate(theirs.astype(np.uint8), np.ones((MARGIN_PX, MARGIN_PX), np.uint8)) > 0
        assert (ours & theirs).sum() > DOUBLED * theirs.sum()
        assert not (ours & ~near).any()
