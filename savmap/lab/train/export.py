"""A trained network to an ONNX file that says what it is, how it was trained and under which licence; and back.

A file's weights keep their names. Its normalisations were folded into the convolutions before them; they come back as
ones that change nothing but add the folded bias, so the network gives the file's own output. Training on must leave
their statistics alone.
"""

import json
import logging
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import onnx
import torch
from onnx import numpy_helper
from torch import Tensor, nn

from savmap.errors import ModelError
from savmap.files.atomic import reason, write_bytes
from savmap.lab.train.checkpoint import LAST_LAYER, Recipe
from savmap.lab.train.data.dataset import HEIGHT, WIDTH
from savmap.lab.train.network import SegmentationNetwork, build

MODEL_VERSION = "1"
LICENCE = "Apache-2.0; encoder initialised from EfficientNet-Lite0 ImageNet weights (Google, Apache-2.0)"
PREFIX, BIAS = "network.", "_bias"
ADVICE = "fine-tuning begins from a float32 file that `savmap train` wrote"


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
        **_warning(recipe),
    }


def _warning(recipe: Mapping[str, object]) -> dict[str, str]:
    """The metadata's entry for a network that is of no use."""
    return {"savmap.warning": str(recipe["warning"])} if "warning" in recipe else {}


def graph(network: nn.Module) -> onnx.ModelProto:
    """The network as an ONNX model: `image` (1, 3, 480, 640) float32 RGB 0..255 -> `probabilities`, weights inside. A
    module other than `SegmentationNetwork` gives probabilities itself."""
    example = (torch.zeros(1, 3, HEIGHT, WIDTH),)
    logging.getLogger("torch.onnx").setLevel(logging.ERROR)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        program = torch.onnx.export(
            WithProbabilities(network).eval() if isinstance(network, SegmentationNetwork) else network,
            example,
            input_names=["image"],
            output_names=["probabilities"],
            opset_version=18,
            dynamo=True,
            verbose=False,
        )
    if program is None:
        raise RuntimeError("torch gave no ONNX program")
    return without_traces(program.model_proto)


def without_traces(model: onnx.ModelProto) -> onnx.ModelProto:
    """The model without the exporter's notes on its nodes and values: they name files of the machine that wrote it."""
    for part in (*model.graph.node, *model.graph.value_info):
        del part.metadata_props[:]
    return model


def export(network: nn.Module, classes: Sequence[str], recipe: Mapping[str, object], output: Path) -> None:
    """Write the ONNX file whole or not at all. Raises OutputError."""
    model = graph(network)
    onnx.helper.set_model_props(model, metadata(classes, recipe))
    onnx.checker.check_model(model)
    write_bytes(output, model.SerializeToString())


def with_recipe(file: Path, recipe: Mapping[str, object]) -> None:
    """Replace the recipe in a file's metadata. Raises OutputError."""
    set_metadata(file, {"savmap.recipe": json.dumps(recipe, sort_keys=True)} | _warning(recipe))


def set_metadata(file: Path, entries: Mapping[str, str]) -> None:
    """Add entries to a file's metadata, or replace them. Raises OutputError."""
    model = onnx.load(file)
    properties = {entry.key: entry.value for entry in model.metadata_props}
    onnx.helper.set_model_props(model, {**properties, **entries})
    write_bytes(file, model.SerializeToString())


def load_onnx(path: Path, classes: Sequence[str]) -> tuple[SegmentationNetwork, list[Recipe]]:
    """Network and history of a file. If it was made for other classes, the last layer is new.

    Raises ModelError for a file that is missing, is none of ours, or is in 8-bit integers.
    """
    model = _read(path)
    about = {entry.key: entry.value for entry in model.metadata_props}
    weights = {tensor.name.removeprefix(PREFIX): _tensor(tensor) for tensor in model.graph.initializer if tensor.dims}
    network = build(len(classes), None)
    state = {name: value.clone() for name, value in network.state_dict().items()}
    same = about.get("savmap.classes") == json.dumps(list(classes))
    wanted = {name for name, _ in network.named_parameters() if same or not name.startswith(LAST_LAYER)}
    normalisations = _normalisations(network)
    for name in wanted - {part for layer in normalisations.values() for part in (f"{layer}.weight", f"{layer}.bias")}:
        state[name] = _fitting(path, name, weights, state[name])
    for convolution, normalisation in normalisations.items():
        layer = network.get_submodule(normalisation)
        assert isinstance(layer, nn.BatchNorm2d)
        bias = _fitting(path, f"{convolution}.weight{BIAS}", weights, state[f"{normalisation}.bias"])
        ones = torch.ones_like(bias)
        state |= {f"{normalisation}.weight": ones, f"{normalisation}.bias": bias}
        state |= {f"{normalisation}.running_mean": 0 * ones, f"{normalisation}.running_var": ones - layer.eps}
    network.load_state_dict(state)
    try:
        return network, [json.loads(about.get("savmap.recipe", "{}"))]
    except ValueError as error:
        raise ModelError(f"{path}: its recipe (savmap.recipe in its metadata) is not JSON; {ADVICE}") from error


def _read(path: Path) -> onnx.ModelProto:
    try:
        return onnx.load(path)
    except OSError as error:
        raise ModelError(f"{path}: cannot be read ({reason(error)}); {ADVICE}") from error
    except Exception as error:  # protobuf's own, which has no stubs
        raise ModelError(f"{path}: not an ONNX model; {ADVICE}") from error


def _tensor(initializer: onnx.TensorProto) -> Tensor:
    return torch.from_numpy(np.array(numpy_helper.to_array(initializer)))


def _normalisations(network: SegmentationNetwork) -> Mapping[str, str]:
    """The convolutions that a normalisation follows, each with that normalisation's name."""
    names = {}
    for name, module in network.named_modules():
        if isinstance(module, nn.BatchNorm2d):
            parent, _, index = name.rpartition(".")
            names[f"{parent}.{int(index) - 1}"] = name
    return names


def _fitting(path: Path, name: str, weights: Mapping[str, Tensor], like: Tensor) -> Tensor:
    value = weights.get(name)
    if value is None or value.shape != like.shape or value.dtype != like.dtype:
        raise ModelError(f"{path}: has no weights `{name}` of size {'x'.join(map(str, like.shape))}; {ADVICE}")
    return value
