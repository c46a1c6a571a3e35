"""onnxruntime's execution providers: which of them a network runs on, and which of two model files fits it.

Without a choice by name: CUDA, then OpenVINO, each where the installed package of onnxruntime was built with it, then
the processor. TensorRT, which builds its engine for minutes, and CoreML, which every macOS package has, are used only
if they are chosen by name.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

PROVIDERS = {
    "cpu": "CPUExecutionProvider",
    "cuda": "CUDAExecutionProvider",
    "tensorrt": "TensorrtExecutionProvider",
    "openvino": "OpenVINOExecutionProvider",
    "coreml": "CoreMLExecutionProvider",
}
AUTOMATIC = ("cuda", "openvino")
FLOATING = ("cuda", "tensorrt", "coreml")
"""Providers that run 8-bit integers slower than float32, or not at all."""
INT8, FLOAT = ".int8.onnx", ".onnx"


@dataclass(frozen=True)
class Choice:
    """Providers by their short names, best first, and a note where one that was asked for is missing."""

    names: tuple[str, ...]
    note: str = ""


def choose(asked: Sequence[str], available: Sequence[str] | None = None) -> Choice:
    """Providers to run on: those asked for that are `available` (onnxruntime's names; default: what it says), else the
    automatic ones; the processor comes last, and does what the others cannot."""
    installed = _available() if available is None else available
    present = [name for name, full in PROVIDERS.items() if full in installed]
    missing = [name for name in asked if name not in present]
    chosen = [name for name in asked or AUTOMATIC if name in present]
    if "cpu" in chosen:
        chosen = chosen[: chosen.index("cpu")]
    note = f"{' and '.join(missing)} not in this onnxruntime, which has {', '.join(present)}" if missing else ""
    return Choice((*chosen, "cpu"), note)


def file_for(model: Path, first: str) -> Path:
    """The file to run where `first` is the first provider: for some, the float32 network that lies beside one in 8-bit
    integers."""
    beside = model.with_name(model.name.removesuffix(INT8) + FLOAT)
    return beside if first in FLOATING and model.name.endswith(INT8) and beside.is_file() else model


def options(names: Sequence[str], threads: int) -> list[tuple[str, dict[str, str]]]:
    """Providers with their settings, as onnxruntime takes them."""
    settings = {"openvino": {"device_type": "CPU", "num_of_threads": str(threads)}}
    return [(PROVIDERS[name], settings.get(name, {})) for name in names]


def short(full: str) -> str:
    """The short name of one of onnxruntime's."""
    return next((name for name, provider in PROVIDERS.items() if provider == full), full)


def runtime_version() -> str:
    """onnxruntime's version, whichever of its packages is installed."""
    import onnxruntime

    return str(onnxruntime.__version__)


def _available() -> Sequence[str]:
    import onnxruntime

    available: Any = onnxruntime.get_available_providers()
    return list(available)
