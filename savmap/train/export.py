"""A trained network to an ONNX file that says what it is, how it was trained and under which licence."""

import json
import logging
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path

import onnx
import torch
from torch import Tensor, nn

from savmap.files.atomic import write_bytes
from savmap.train.fitted import HEIGHT, WIDTH
from savmap.train.network import SegmentationNetwork

MODEL_VERSION = "1"
LICENCE = "Apache-2.0; encoder initialised from EfficientNet-Lite0 ImageNet weights (Google, Apache-2.0)"


class WithProbabilities(nn.Module):
    """The network followed by softmax, written out because onnxruntime's Softmax over channels is slow."""

    def __init__(self, network: SegmentationNetwork) -> None:
        super().__init__()
        self.network = network

    def forward(self, image: Tensor) -> Tensor:
        weights = torch.exp(torch.clamp(self.network(image), -40.0, 40.0))
        return weights / weights.sum(dim=1, keepdim=True)


def metadata(classes: Sequence[str], recipe: Mapping[str, object]) -> dict[str, str]:
    """The metadata that `savmap.vision.networks.segmenter` reads, and the training recipe."""
    return {
        "savmap.format": "semantic",
        "savmap.version": MODEL_VERSION,
        "savmap.classes": json.dumps(list(classes)),
        "savmap.input_size": f"{WIDTH}x{HEIGHT}",
        "savmap.output": "probabilities",
        "savmap.recipe": json.dumps(recipe, sort_keys=True),
        "savmap.licence": LICENCE,
    }


def graph(network: SegmentationNetwork) -> onnx.ModelProto:
    """The network as an ONNX model: `image` (1, 3, 480, 640) float32 RGB 0..255 -> `probabilities`, weights inside."""
    example = (torch.zeros(1, 3, HEIGHT, WIDTH),)
    logging.getLogger("torch.onnx").setLevel(logging.ERROR)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        program = torch.onnx.export(
            WithProbabilities(network).eval(),
            example,
            input_names=["image"],
            output_names=["probabilities"],
            opset_version=18,
            dynamo=True,
            verbose=False,
        )
    if program is None:
        raise RuntimeError("torch gave no ONNX program")
    return program.model_proto


def export(network: SegmentationNetwork, classes: Sequence[str], recipe: Mapping[str, object], output: Path) -> None:
    """Write the ONNX file whole or not at all. Raises OutputError."""
    model = graph(network)
    onnx.helper.set_model_props(model, metadata(classes, recipe))
    onnx.checker.check_model(model)
    write_bytes(output, model.SerializeToString())


def with_recipe(file: Path, recipe: Mapping[str, object]) -> None:
    """Put what is known by now of how it was trained into a file. Raises OutputError."""
    model = onnx.load(file)
    known = {entry.key: entry.value for entry in model.metadata_props}
    onnx.helper.set_model_props(model, known | {"savmap.recipe": json.dumps(recipe, sort_keys=True)})
    write_bytes(file, model.SerializeToString())
