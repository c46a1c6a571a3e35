"""A network in training's form from an ONNX file that `export` wrote: what ships can be trained further.

The file's weights keep their names. Its normalisations were folded into the convolutions before them; they come back as ones that
change nothing but add the folded bias, so the network gives the file's own output. Training on must leave their statistics alone.
"""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import onnx
import torch
from onnx import numpy_helper
from torch import Tensor, nn

from savmap.errors import ModelError
from savmap.files.atomic import reason
from savmap.train.checkpoint import LAST_LAYER, Recipe
from savmap.train.network import SegmentationNetwork, build

PREFIX, BIAS = "network.", "_bias"
ADVICE = "fine-tuning begins from a float32 file that `savmap train` wrote"


def load_onnx(path: Path, classes: Sequence[str]) -> tuple[SegmentationNetwork, list[Recipe]]:
    """Network and history of a file; where it was made for other classes, the last layer is new.

    Raises ModelError for a file that is missing, is none of ours, or is in 8-bit integers.
    """
    model = _read(path)
    about = {entry.key: entry.value for entry in model.metadata_props}
    found = {one.name.removeprefix(PREFIX): _tensor(one) for one in model.graph.initializer if one.dims}
    network = build(len(classes), None)
    state = {name: value.clone() for name, value in network.state_dict().items()}
    same = about.get("savmap.classes") == json.dumps(list(classes))
    wanted = {name for name, _ in network.named_parameters() if same or not name.startswith(LAST_LAYER)}
    normalisations = _normalisations(network)
    for name in wanted - {part for one in normalisations.values() for part in (f"{one}.weight", f"{one}.bias")}:
        state[name] = _fitting(path, name, found, state[name])
    for convolution, normalisation in normalisations.items():
        layer = network.get_submodule(normalisation)
        assert isinstance(layer, nn.BatchNorm2d)
        bias = _fitting(path, f"{convolution}.weight{BIAS}", found, state[f"{normalisation}.bias"])
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
    """Names of the convolutions that a normalisation follows, and of that."""
    found = {}
    for name, module in network.named_modules():
        if isinstance(module, nn.BatchNorm2d):
            parent, _, index = name.rpartition(".")
            found[f"{parent}.{int(index) - 1}"] = name
    return found


def _fitting(path: Path, name: str, found: Mapping[str, Tensor], like: Tensor) -> Tensor:
    value = found.get(name)
    if value is None or value.shape != like.shape or value.dtype != like.dtype:
        raise ModelError(f"{path}: has no weights `{name}` of size {'x'.join(map(str, like.shape))}; {ADVICE}")
    return value
