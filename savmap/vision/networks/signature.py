"""An ONNX file's signature, by which its adapter is chosen: inputs, outputs and metadata."""

import ast
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from savmap.errors import ModelError

Side = int | None


@dataclass(frozen=True)
class Tensor:
    """An input or output: its name, its shape (None for a dimension that is not fixed), and onnxruntime's name of its
    type."""

    name: str
    shape: tuple[Side, ...]
    kind: str

    def __str__(self) -> str:
        sides = ", ".join("?" if side is None else str(side) for side in self.shape)
        return f"{self.name} ({sides})"


MOST_SHOWN = 40
"""Letters of a text in a file's metadata: that may be of any length."""


@dataclass(frozen=True)
class OnnxSignature:
    """A file's inputs, outputs and metadata."""

    path: Path
    inputs: tuple[Tensor, ...]
    outputs: tuple[Tensor, ...]
    metadata: Mapping[str, str]

    def __str__(self) -> str:
        tensors = f"inputs {_listed(self.inputs)}; outputs {_listed(self.outputs)}"
        named = [
            f"{key} = {self.metadata[key][:MOST_SHOWN]}" for key in ("savmap.format", "task") if key in self.metadata
        ]
        return "; ".join([tensors, *named])

    def of_rank(self, rank: int) -> tuple[Tensor, ...]:
        """Outputs with so many dimensions."""
        return tuple(output for output in self.outputs if len(output.shape) == rank)

    @property
    def takes_picture(self) -> bool:
        """Whether the only input is one picture in planes, (1, 3, height, width), of float32 or float16."""
        if len(self.inputs) != 1 or self.inputs[0].kind not in ("tensor(float)", "tensor(float16)"):
            return False
        shape = self.inputs[0].shape
        return len(shape) == 4 and shape[0] in (1, None) and shape[1] in (3, None)

    @property
    def input_size(self) -> tuple[int, int] | None:
        """Width and height of the input, where they are fixed."""
        height, width = self.inputs[0].shape[2:]
        return (width, height) if width is not None and height is not None else None

    @property
    def names(self) -> tuple[str, ...] | None:
        """The classes that the metadata names: `savmap.classes`, a JSON list, or `names` as ultralytics writes it, a
        dictionary of numbers to names. None where it names none. Raises ModelError for what cannot be read."""
        try:
            if "savmap.classes" in self.metadata:
                return _checked(json.loads(self.metadata["savmap.classes"]))
            if "names" in self.metadata:
                named = ast.literal_eval(self.metadata["names"])
                return _checked(_in_order(named) if isinstance(named, dict) else named)
        except (ValueError, SyntaxError, TypeError, RecursionError, MemoryError) as error:
            raise ModelError(f"{self.path}: the classes in its metadata cannot be read: {error}") from error
        return None


def read_signature(path: Path, session: Any) -> OnnxSignature:
    """The signature of a file that onnxruntime has opened. Raises ModelError where its texts cannot be read."""
    try:
        metadata = dict(session.get_modelmeta().custom_metadata_map)
        return OnnxSignature(path, _tensors(session.get_inputs()), _tensors(session.get_outputs()), metadata)
    except UnicodeDecodeError as error:
        raise ModelError(f"{path}: a text in it is not UTF-8; export it again") from error


def _tensors(nodes: Sequence[Any]) -> tuple[Tensor, ...]:
    return tuple(
        Tensor(node.name, tuple(side if isinstance(side, int) else None for side in node.shape), node.type)
        for node in nodes
    )


def _in_order(named: Mapping[Any, object]) -> list[object]:
    """The names of a dictionary from numbers (or their digits) to names."""
    by_number = {int(key): name for key, name in named.items()}
    if sorted(by_number) != list(range(len(named))):
        raise ValueError(f"numbers from 0 are expected, not {', '.join(map(str, named))}")
    return [by_number[number] for number in range(len(named))]


def _checked(names: object) -> tuple[str, ...]:
    if not isinstance(names, list) or not names or not all(isinstance(name, str) for name in names):
        raise ValueError(f"a list of names is expected, not {names!r}")
    return tuple(names)


def _listed(tensors: Sequence[Tensor]) -> str:
    return ", ".join(map(str, tensors))
