"""The network of a new plugin: a tiny ONNX file that keeps to the contract and sees whatever is painted magenta.

One 1x1 convolution gives the logits of background and class. The file is put together byte by byte, so that neither
onnx nor torch need be there: an ONNX file is a protocol buffer, whose fields are known by number (onnx.proto, opset 13,
IR version 8).
"""

import json
import struct
from collections.abc import Sequence

SIZE = (640, 480)
WEIGHTS = (0.08, -0.16, 0.08)
MARGIN = -16.0
FLOAT, INTS = 1, 7
IR_VERSION, OPSET = 8, 13


def stub_network(label: str, version: str) -> bytes:
    """The ONNX file of a network for one class: its logit is 0.08 (red - 2 green + blue) - 16 of values 0..255."""
    width, height = SIZE
    node = _text(1, "image") + _text(1, "weights") + _text(1, "biases") + _text(2, "logits") + _text(4, "Conv")
    node += _message(5, _text(1, "kernel_shape") + _number(8, 1) + _number(8, 1) + _number(20, INTS))
    graph = _message(1, node) + _text(2, "stub")
    graph += _message(5, _tensor("weights", (2, 3, 1, 1), (0.0, 0.0, 0.0, *WEIGHTS)))
    graph += _message(5, _tensor("biases", (2,), (0.0, MARGIN)))
    graph += _message(11, _value("image", (1, 3, height, width)))
    graph += _message(12, _value("logits", (1, 2, height, width)))
    metadata = {
        "savmap.format": "semantic",
        "savmap.version": version,
        "savmap.classes": json.dumps([label]),
        "savmap.output": "logits",
        "savmap.recipe": json.dumps({"stub": "sees what is magenta; to be replaced by a trained network"}),
    }
    model = _number(1, IR_VERSION) + _text(2, "savmap") + _message(7, graph) + _message(8, _number(2, OPSET))
    return model + b"".join(_message(14, _text(1, key) + _text(2, value)) for key, value in metadata.items())


def _varint(value: int) -> bytes:
    digits = [value >> shift & 0x7F for shift in range(0, max(value.bit_length(), 1), 7)]
    return bytes([*(digit | 0x80 for digit in digits[:-1]), digits[-1]])


def _number(field: int, value: int) -> bytes:
    return _varint(field << 3) + _varint(value)


def _message(field: int, content: bytes) -> bytes:
    return _varint(field << 3 | 2) + _varint(len(content)) + content


def _text(field: int, text: str) -> bytes:
    return _message(field, text.encode())


def _tensor(name: str, shape: Sequence[int], values: Sequence[float]) -> bytes:
    """A TensorProto of 32-bit floats."""
    dims = b"".join(_number(1, side) for side in shape)
    return dims + _number(2, FLOAT) + _text(8, name) + _message(9, struct.pack(f"<{len(values)}f", *values))


def _value(name: str, shape: Sequence[int]) -> bytes:
    """A ValueInfoProto of a tensor of 32-bit floats."""
    dims = b"".join(_message(1, _number(1, side)) for side in shape)
    return _text(1, name) + _message(2, _message(1, _number(1, FLOAT) + _message(2, dims)))
