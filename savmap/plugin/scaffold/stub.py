"""The network of a new plugin: a tiny ONNX file that keeps to the contract and sees whatever is painted magenta.

`stub.onnx` is one 1x1 convolution of pictures of 640x480 (opset 13, IR version 8), which gives the logits of background
and class. What the file says of itself comes behind it byte by byte, so that onnx need not be there: an ONNX file is a
protocol buffer, whose fields are known by number (onnx.proto).
"""

import json
from pathlib import Path

METADATA, KEY, VALUE = 14, 1, 2


def stub_network(label: str, version: str) -> bytes:
    """The ONNX file of a network for one class: its logit is 0.08 (red - 2 green + blue) - 16 of values 0..255."""
    metadata = {
        "savmap.format": "semantic",
        "savmap.version": version,
        "savmap.classes": json.dumps([label]),
        "savmap.output": "logits",
        "savmap.recipe": json.dumps({"stub": "sees what is magenta; to be replaced by a trained network"}),
    }
    entries = [_field(KEY, key.encode()) + _field(VALUE, value.encode()) for key, value in metadata.items()]
    return Path(__file__).with_name("stub.onnx").read_bytes() + b"".join(_field(METADATA, each) for each in entries)


def _field(number: int, content: bytes) -> bytes:
    """A field of bytes: its number and kind, and its length, seven bits a byte, before it."""
    length, size = len(content), bytearray()
    while length > 0x7F:
        size.append(length & 0x7F | 0x80)
        length >>= 7
    return bytes([number << 3 | 2, *size, length]) + content
