"""ONNX files opened by onnxruntime, on the first of the chosen providers that starts; the processor comes last and
always starts."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import onnxruntime
from numpy.typing import NDArray

from savmap.errors import ModelError
from savmap.files.urls import likely
from savmap.vision.networks.providers import choose, file_for, options, short
from savmap.vision.networks.signature import OnnxSignature, read_signature

ADVICE = "train one with `savmap train`, or point `model` at a file that savmap reads (docs/networks.md)"

EXACT_INTEGERS = "session.x64quantprecision"
"""onnxruntime's setting for x86 processors without VNNI, which add two products of 8-bit integers in 16 bits: what does
not fit is cut off, and masks change. With it they multiply more slowly and exactly, so that a network sees the same on
all processors. Others pass it over."""

Run = Callable[[NDArray[np.float32]], list[Any]]
"""Runs the network: from its input (1, 3, h, w) to all its outputs. Raises ModelError where it fails."""


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
        raise ModelError(f"{path}: no such model file{likely(path)}; {ADVICE}")
    choice = choose(asked, available)
    notes = [choice.note] if choice.note else []
    failure: Exception | None = None
    for number, provider in enumerate(choice.names):
        file = file_for(path, provider)
        try:
            session = _session(file, threads, choice.names[number:])
        except Exception as error:
            failure = error
            notes.append(f"{provider} cannot run it ({_line(error)})")
            continue
        if short(session.get_providers()[0]) == provider:
            signature = read_signature(file, session)
            note = f"{path}: {'; '.join(notes)}; it runs on {provider}" if notes else ""
            return OpenNetwork(file, signature, _run(session, signature), provider, note)
        notes.append(f"{provider} does not start here")
    why = f" ({_line(failure)})" if failure else ""
    raise ModelError(f"{path}: not a usable ONNX model{why}; {ADVICE}") from failure


def _session(path: Path, threads: int, names: Sequence[str]) -> Any:
    settings = onnxruntime.SessionOptions()
    settings.intra_op_num_threads = threads
    settings.inter_op_num_threads = 1
    settings.log_severity_level = 4
    settings.add_session_config_entry(EXACT_INTEGERS, "1")
    return onnxruntime.InferenceSession(str(path), settings, providers=options(names, threads), enable_fallback=0)


def _run(session: Any, signature: OnnxSignature) -> Run:
    half = bool(signature.inputs) and signature.inputs[0].kind == "tensor(float16)"
    name = signature.inputs[0].name if signature.inputs else ""

    def run(planes: NDArray[np.float32]) -> list[Any]:
        try:
            outputs: list[Any] = session.run(None, {name: planes.astype(np.float16) if half else planes})
        except Exception as error:
            size = f"{planes.shape[3]}x{planes.shape[2]}"
            raise ModelError(f"{signature.path}: cannot be run on a picture of {size} ({_line(error)})") from error
        return outputs

    return run


def _line(error: Exception) -> str:
    text = str(error).strip().removeprefix("[ONNXRuntimeError] : ").splitlines()
    return text[0][:160] if text else type(error).__name__
