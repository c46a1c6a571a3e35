"""A network with its weights in a file beside it, as exporters write large ones."""

from pathlib import Path

import onnx
from onnx.external_data_helper import convert_model_to_external_data

MODEL = Path(__file__).parents[2] / "plugins/lights/savmap_lights/model/lights.onnx"


def with_weights_beside(path: Path, location: str) -> Path:
    """The plugin lights' network at a path, and the file of this name in the same folder."""
    model = onnx.load(MODEL)
    convert_model_to_external_data(model, location=location, size_threshold=1000)
    (path.parent / location).parent.mkdir(parents=True, exist_ok=True)
    onnx.save(model, path)
    return path


def retrain(weights: Path) -> None:
    """Change a weight."""
    data = bytearray(weights.read_bytes())
    data[100] ^= 1
    weights.write_bytes(data)
