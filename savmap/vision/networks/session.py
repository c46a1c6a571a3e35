"""ONNX files opened by onnxruntime: the files of a network, the providers that run it, and its signature.

It runs on the first of the chosen execution providers that starts; the processor comes last and always starts. Without
a choice by name: CUDA, where the installed package of onnxruntime was built with it, then OpenVINO, where its own
package is installed. TensorRT, which builds its engine for minutes, and CoreML, which every macOS package has, are used
only if chosen by name.
"""

import ast
import hashlib
import importlib
import json
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import onnxruntime
from numpy.typing import NDArray

from savmap.errors import ModelError
from savmap.files.atomic import sha256

LOCATION = re.compile(rb"\x0a\x08location\x12([\x80-\xff]*[\x00-\x7f])")
"""How a tensor's external data begin: a StringStringEntryProto (onnx.proto) whose key is `location`; then the length of
the file's name."""
PROVIDERS = {
    "cpu": "CPUExecutionProvider",
    "cuda": "CUDAExecutionProvider",
    "tensorrt": "TensorrtExecutionProvider",
    "openvino": "OpenVINO",
    "coreml": "CoreMLExecutionProvider",
}
AUTOMATIC = ("cuda", "openvino")
FLOATING = ("cuda", "tensorrt", "coreml")
"""Providers that run 8-bit integers slower than float32, or not at all."""
INT8, FLOAT = ".int8.onnx", ".onnx"
Side = int | None
ADVICE = "train one with `savmap train`, or point `model` at a file that savmap reads (docs/networks.md)"
EXACT_INTEGERS = "session.x64quantprecision"
"""onnxruntime's setting for x86 processors without VNNI, which add two products of 8-bit integers in 16 bits: what does
not fit is cut off, and masks change. With it they multiply more slowly and exactly, so that a network sees the same on
all processors. Others pass it over."""
Run = Callable[[NDArray[np.float32]], list[Any]]
"""Runs the network: from its input (1, 3, h, w) to all its outputs. Raises ModelError where it fails."""


def network_files(model: Path) -> tuple[Path, ...]:
    """The ONNX file, then those with its weights that are there, by name. Raises OSError."""
    facts = model.stat()
    return (model, *(file for file in map(model.parent.joinpath, _named(model, facts.st_mtime_ns)) if file.is_file()))


def network_digest(model: Path) -> str:
    """SHA-256 of a network: of its file; or, with weights beside it, of a line for each file with its own. Raises
    OutputError, OSError."""
    digests = [sha256(file) for file in network_files(model)]
    return digests[0] if len(digests) == 1 else hashlib.sha256("\n".join(digests).encode()).hexdigest()


@cache
def _named(model: Path, changed_ns: int) -> tuple[str, ...]:
    """The files that an ONNX file named then."""
    return tuple(sorted(set(_locations(model.read_bytes()))))


def _locations(content: bytes) -> Iterator[str]:
    for match in LOCATION.finditer(content):
        length = sum((byte & 0x7F) << 7 * place for place, byte in enumerate(match[1]))
        yield content[match.end() : match.end() + length].decode(errors="surrogateescape")


@dataclass(frozen=True)
class Choice:
    """Providers by their short names, best first, and a note where one that was asked for is missing."""

    names: tuple[str, ...]
    note: str = ""


def choose(asked: Sequence[str], available: Sequence[str] | None = None) -> Choice:
    """Providers to run on: those asked for that are `available` (by onnxruntime's names; default: what is installed),
    else the automatic ones; the processor comes last, and does what the others cannot."""
    installed = _installed() if available is None else available
    present = [name for name, full in PROVIDERS.items() if full in installed]
    missing = [name for name in asked if name not in present]
    chosen = [name for name in asked or AUTOMATIC if name in present]
    if "cpu" in chosen:
        chosen = chosen[: chosen.index("cpu")]
    note = f"{' and '.join(missing)} not in this installation, which has {', '.join(present)}" if missing else ""
    return Choice((*chosen, "cpu"), note)


def file_for(model: Path, first: str) -> Path:
    """The file to run where `first` is the first provider: for some, the float32 network that lies beside one in 8-bit
    integers."""
    floating = model.with_name(model.name.removesuffix(INT8) + FLOAT)
    return floating if first in FLOATING and model.name.endswith(INT8) and floating.is_file() else model


def short(full: str) -> str:
    """The short name of one of onnxruntime's."""
    return next((name for name, provider in PROVIDERS.items() if provider == full), full)


def _installed() -> list[str]:
    providers: list[str] = onnxruntime.get_available_providers()
    return [*providers, PROVIDERS["openvino"]] if find_spec("openvino") else providers


def runtime_version() -> str:
    """onnxruntime's version, whichever of its packages is installed; and OpenVINO's."""
    return str(onnxruntime.__version__) + (f", OpenVINO {version('openvino')}" if find_spec("openvino") else "")


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


@dataclass(frozen=True)
class OnnxSignature:
    """A file's inputs, outputs and metadata."""

    path: Path
    inputs: tuple[Tensor, ...]
    outputs: tuple[Tensor, ...]
    metadata: Mapping[str, str]

    def __str__(self) -> str:
        inputs, outputs = (", ".join(map(str, tensors)) for tensors in (self.inputs, self.outputs))
        named = [f"{key} = {self.metadata[key][:40]}" for key in ("savmap.format", "task") if key in self.metadata]
        return "; ".join([f"inputs {inputs}", f"outputs {outputs}", *named])

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


@dataclass(frozen=True)
class OpenNetwork:
    """A network ready to run: the file that was read, its signature, the provider that runs it, and a note where that
    is not the provider that was asked for."""

    path: Path
    signature: OnnxSignature
    run: Run
    provider: str
    note: str = ""


def open_network(
    path: Path, threads: int = 1, asked: Sequence[str] = (), available: Sequence[str] | None = None
) -> OpenNetwork:
    """Open a file. `asked`: providers by their short names, none for the automatic choice; `available`: see `choose`.

    Raises ModelError for a file that is missing or is no ONNX model.
    """
    if not path.is_file():
        raise ModelError(f"{path}: no such model file; {ADVICE}")
    choice = choose(asked, available)
    notes = [choice.note] if choice.note else []
    failure: Exception | None = None
    for number, provider in enumerate(choice.names):
        file, by_openvino = file_for(path, provider), provider == "openvino"
        try:
            session = _session(file, threads, ["cpu"] if by_openvino else choice.names[number:])
            compiled = _compiled(file, threads) if by_openvino else None
        except Exception as error:
            failure = error
            notes.append(f"{provider} cannot run it ({_line(error)})")
            continue
        if compiled is not None or short(session.get_providers()[0]) == provider:
            signature = read_signature(file, session)
            note = f"{path}: {'; '.join(notes)}; it runs on {provider}" if notes else ""
            run = _run(signature, compiled or partial(session.run, None))
            return OpenNetwork(file, signature, run, provider, note)
        notes.append(f"{provider} does not start here")
    why = f" ({_line(failure)})" if failure else ""
    raise ModelError(f"{path}: not a usable ONNX model{why}; {ADVICE}") from failure


def _session(path: Path, threads: int, names: Sequence[str]) -> Any:
    settings = onnxruntime.SessionOptions()
    settings.intra_op_num_threads = threads
    settings.inter_op_num_threads = 1
    settings.log_severity_level = 4
    settings.add_session_config_entry(EXACT_INTEGERS, "1")
    providers = [PROVIDERS[name] for name in names if name != "openvino"]
    return onnxruntime.InferenceSession(str(path), settings, providers=providers, enable_fallback=0)


def _compiled(path: Path, threads: int) -> Callable[[Mapping[str, Any]], list[Any]]:
    """A network as OpenVINO runs it, in float32 where it is not of integers: for as many callers at once as there are
    processors, each in so many threads."""
    callers = os.cpu_count() or 1
    settings = {"NUM_STREAMS": callers, "INFERENCE_NUM_THREADS": callers * threads, "INFERENCE_PRECISION_HINT": "f32"}
    network = importlib.import_module("openvino").Core().compile_model(str(path), "CPU", settings)

    def run(inputs: Mapping[str, Any]) -> list[Any]:
        return [*network.create_infer_request().infer(dict(inputs)).values()]

    return run


def _run(signature: OnnxSignature, network: Callable[[dict[str, Any]], list[Any]]) -> Run:
    half = bool(signature.inputs) and signature.inputs[0].kind == "tensor(float16)"
    name = signature.inputs[0].name if signature.inputs else ""

    def run(planes: NDArray[np.float32]) -> list[Any]:
        try:
            return network({name: planes.astype(np.float16) if half else planes})
        except Exception as error:
            size = f"{planes.shape[3]}x{planes.shape[2]}"
            raise ModelError(f"{signature.path}: cannot be run on a picture of {size} ({_line(error)})") from error

    return run


def _line(error: Exception) -> str:
    text = str(error).strip().removeprefix("[ONNXRuntimeError] : ").splitlines()
    return text[0][:160] if text else type(error).__name__
