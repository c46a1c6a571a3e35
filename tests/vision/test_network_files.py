"""A network whose weights lie in files beside it."""

from pathlib import Path

import numpy as np

from savmap.files.atomic import sha256
from savmap.vision.networks.segmenter import Segmenter
from savmap.vision.networks.session import network_digest, network_files

from .weights import MODEL, retrain, with_weights_beside

LONG = f"weights/{'w' * 150}.bin"
"""Its length takes two bytes."""


def test_weights_beside_a_network_are_found(tmp_path: Path) -> None:
    for name in ("net.onnx.data", LONG):
        model = with_weights_beside(tmp_path / "net.onnx", name)
        assert network_files(model) == (model, tmp_path / name)
        picture = np.zeros((480, 640, 3), np.uint8)
        assert Segmenter(model).probabilities(picture).shape == (2, 480, 640)


def test_other_weights_are_another_network(tmp_path: Path) -> None:
    model = with_weights_beside(tmp_path / "net.onnx", "net.onnx.data")
    before = network_digest(model)
    retrain(tmp_path / "net.onnx.data")
    assert network_digest(model) != before


def test_a_single_file_has_its_own_digest() -> None:
    assert network_files(MODEL) == (MODEL,)
    assert network_digest(MODEL) == sha256(MODEL)
