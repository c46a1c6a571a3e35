"""An ONNX file opened by onnxruntime, on the provider chosen, or on the processor where that one does not start."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import onnxruntime
from numpy.typing import NDArray

from savmap.errors import ModelError
from savmap.stages.networks.face import Face, face_of
from savmap.stages.networks.providers import choose, file_for, options, short

ADVICE = "train one with `savmap train`, or point `model` at a file that savmap reads (docs/networks.md)"

Run = Callable[[NDArray[np.float32]], list[Any]]
"""The network: its input to all its outputs."""


@dataclass(frozen=True)
class Opened:
    """A network ready to run: the file that was read, what it shows of itself, the provider that runs it, and a line where this is not as
    it was asked for."""

    path: Path
    face: Face
    run: Run
    provider: str
    note: str = ""


def opened(path: Path, threads: int = 1, asked: Sequence[str] = (), available: Sequence[str] | None = None) -> Opened:
    """Open a file. `asked`: providers by their short names, none for the automatic choice; `available`: see `choose`.

    Raises ModelError for a file that is missing or is no ONNX model.
    """
    if not path.is_file():
        raise ModelError(f"{path}: no such model file; {ADVICE}")
    choice = choose(asked, available)
    first, note = choice.names[0], choice.note
    own = file_for(path, first)
    try:
        session = _session(own, threads, choice.names)
    except Exception as error:
        if first == "cpu":
            raise ModelError(f"{path}: not a usable ONNX model; {ADVICE}") from error
        own, session, note = path, _on_cpu(path, threads), f"{first} cannot run it ({_line(error)})"
    provider = short(session.get_providers()[0])
    if provider != first and not note:
        note = f"{first} does not start here"
        if own != path:
            own, session = path, _on_cpu(path, threads)
    face = face_of(own, session)
    return Opened(own, face, _run(session, face), provider, f"{path}: {note}; it runs on {provider}" if note else "")


def _on_cpu(path: Path, threads: int) -> Any:
    try:
        return _session(path, threads, ("cpu",))
    except Exception as error:
        raise ModelError(f"{path}: not a usable ONNX model; {ADVICE}") from error


def _session(path: Path, threads: int, names: Sequence[str]) -> Any:
    settings = onnxruntime.SessionOptions()
    settings.intra_op_num_threads = threads
    settings.inter_op_num_threads = 1
    settings.log_severity_level = 4
    return onnxruntime.InferenceSession(str(path), settings, providers=options(names, threads), enable_fallback=0)


def _run(session: Any, face: Face) -> Run:
    half = bool(face.inputs) and face.inputs[0].kind == "tensor(float16)"
    name = face.inputs[0].name if face.inputs else ""

    def run(planes: NDArray[np.float32]) -> list[Any]:
        found: list[Any] = session.run(None, {name: planes.astype(np.float16) if half else planes})
        return found

    return run


def _line(error: Exception) -> str:
    text = str(error).strip().splitlines()
    return text[0][:160] if text else type(error).__name__
