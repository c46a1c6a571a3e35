"""A network in 8-bit integers: half the time on processors with VNNI, for a thousandth of IoU.

    python -m savmap.lab.train.quantise shelves.onnx --data data/fast --data data/painted -o shelves.int8.onnx

Weights are signed, one scale a channel; activations unsigned, their ranges taken from some pictures that training saw
(static quantisation, Jacob et al., Quantization and Training of Neural Networks, 2018; done by onnxruntime). Softmax
stays in float32.
"""

import argparse
import tempfile
import warnings
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
import onnx
from numpy.typing import NDArray
from onnxruntime.quantization import CalibrationDataReader, QuantFormat, QuantType, quantize_static
from onnxruntime.quantization.shape_inference import quant_pre_process

from savmap.errors import ModelError, ending_in_one_line
from savmap.files.atomic import write_bytes
from savmap.lab.train.data.dataset import Sample, split
from savmap.lab.train.data.sets import read_sets
from savmap.vision.networks.segmenter import Segmenter, network_input

OPERATORS = ["Conv", "Add", "Clip", "Relu", "Resize", "DepthToSpace"]


class Pictures(CalibrationDataReader):
    """Pictures as the network takes them, one after another."""

    def __init__(self, samples: Sequence[Sample], size: tuple[int, int]) -> None:
        self.waiting: Iterator[Sample] = iter(samples)
        self.size = size

    def get_next(self) -> Mapping[str, NDArray[np.float32]] | None:
        sample = next(self.waiting, None)
        return None if sample is None else {"image": network_input(sample.load()[0], self.size)}


def quantise(model: Path, data: Sequence[Path], output: Path, count: int = 32, seed: int = 0) -> None:
    """Write the network of `model` in 8-bit integers, its ranges from `count` training pictures of the data sets.

    Raises ModelError for a model that is none of savmap's, OutputError for a data set that cannot be read.
    """
    classes = Segmenter(model, providers=("cpu",)).classes
    training = [sample for dataset in read_sets(data, classes) for sample in split(dataset.samples)[0]]
    write_quantised(model, training, output, count, seed)


def write_quantised(model: Path, training: Sequence[Sample], output: Path, count: int = 32, seed: int = 0) -> None:
    """Write the network of `model` in 8-bit integers, its ranges from `count` of the pictures. Raises ModelError,
    OutputError."""
    segmenter = Segmenter(model, providers=("cpu",))
    if segmenter.kind != "semantic" or segmenter.input_size is None:
        raise ModelError(f"{model}: is {segmenter.kind}; only networks that `savmap train` wrote are quantised here")
    chosen = np.random.default_rng(seed).choice(len(training), min(count, len(training)), replace=False)
    pictures = Pictures([training[number] for number in chosen], segmenter.input_size)
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        prepared, quantised = Path(folder) / "plain.onnx", Path(folder) / "int8.onnx"
        quant_pre_process(model, prepared, skip_symbolic_shape=True)
        quantize_static(
            prepared,
            quantised,
            pictures,
            quant_format=QuantFormat.QDQ,
            activation_type=QuantType.QUInt8,
            weight_type=QuantType.QInt8,
            per_channel=True,
            op_types_to_quantize=OPERATORS,
        )
        result = onnx.load(quantised)
    original = {entry.key: entry.value for entry in onnx.load(model).metadata_props}
    onnx.helper.set_model_props(result, {**original, "savmap.precision": "int8"})
    write_bytes(output, result.SerializeToString())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("model", type=Path)
    parser.add_argument("--data", type=Path, action="append", required=True, help="a data set; may be repeated")
    parser.add_argument("--pictures", type=int, default=32, help="how many to take the activations' ranges from")
    parser.add_argument("-o", "--output", type=Path, required=True)
    given = parser.parse_args()
    with ending_in_one_line():
        quantise(given.model, given.data, given.output, given.pictures)


if __name__ == "__main__":
    main()
