"""Execution providers: which are chosen, which file they run, what happens where one does not start. No accelerator is needed."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import onnxruntime
import pytest
from onnx import TensorProto, helper

from savmap.errors import ModelError
from savmap.plugin.manager import load_class
from savmap.vision.networks.segmenter import Segmenter
from savmap.vision.networks.session import PROVIDERS, choose, file_for, open_network

from .test_segmenter import GOOD, HEIGHT, WIDTH, write_model

CPU, CUDA, TENSORRT = "CPUExecutionProvider", "CUDAExecutionProvider", "TensorrtExecutionProvider"
OPENVINO, COREML = "OpenVINO", "CoreMLExecutionProvider"
REAL = onnxruntime.InferenceSession


@pytest.mark.parametrize(
    ("asked", "available", "chosen"),
    [
        ((), [CPU], ("cpu",)),
        ((), ["AzureExecutionProvider", CPU], ("cpu",)),
        ((), [TENSORRT, CUDA, CPU], ("cuda", "cpu")),
        ((), [OPENVINO, CPU], ("openvino", "cpu")),
        ((), [COREML, CPU], ("cpu",)),
        (("cpu",), [CUDA, CPU], ("cpu",)),
        (("cpu", "cuda"), [CUDA, CPU], ("cpu",)),
        (("tensorrt", "cuda"), [TENSORRT, CUDA, CPU], ("tensorrt", "cuda", "cpu")),
        (("coreml",), [COREML, CPU], ("coreml", "cpu")),
    ],
)
def test_providers_by_name_or_by_what_there_is(
    asked: Sequence[str], available: Sequence[str], chosen: Sequence[str]
) -> None:
    choice = choose(asked, available)
    assert choice.names == chosen
    assert not choice.note


@pytest.mark.parametrize("first", PROVIDERS)
def test_some_take_the_float_network_beside_one_of_integers(tmp_path: Path, first: str) -> None:
    integers, floats, lonely = (tmp_path / name for name in ("a.int8.onnx", "a.onnx", "b.int8.onnx"))
    floats.touch()
    assert file_for(integers, first) == (floats if first in ("cuda", "tensorrt", "coreml") else integers)
    assert file_for(lonely, first) == lonely
    assert file_for(floats, first) == floats


class Fake:
    """In place of onnxruntime's session: notes which files it was given, and on the processor alone it is the real one."""

    files: list[str]
    start: Sequence[str]
    silent: bool

    def __init__(self, path: str, settings: Any, providers: list[str], enable_fallback: int) -> None:
        Fake.files.append(f"{Path(path).name} on {providers[0]}")
        if providers[0] not in Fake.start and not Fake.silent:
            raise RuntimeError("CUDA driver version is insufficient\nfor the runtime")
        self.own = [name for name in providers if name in Fake.start]
        self.real = REAL(path, settings, providers=[CPU])

    def get_providers(self) -> list[str]:
        return self.own

    def __getattr__(self, name: str) -> Any:
        return getattr(self.real, name)


@pytest.fixture
def model(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A network "of integers" with a float one beside it, and a fake session."""
    monkeypatch.setattr(onnxruntime, "InferenceSession", Fake)
    Fake.files, Fake.start, Fake.silent = [], list(PROVIDERS.values()), False
    write_model(tmp_path / "m.onnx", GOOD)
    return write_model(tmp_path / "m.int8.onnx", GOOD)


def test_the_float_network_runs_on_cuda(model: Path) -> None:
    network = open_network(model, 1, (), [CUDA, CPU])
    assert (network.provider, network.path.name, network.note) == ("cuda", "m.onnx", "")


@pytest.mark.parametrize(
    ("silent", "why"),
    [(False, "cannot run it (CUDA driver version is insufficient)"), (True, "does not start here")],
)
def test_a_provider_that_does_not_start_is_replaced_by_the_processor(model: Path, silent: bool, why: str) -> None:
    Fake.start, Fake.silent = [CPU], silent
    network = open_network(model, 1, ("cuda",), [CUDA, CPU])
    assert (network.provider, network.path.name) == ("cpu", "m.int8.onnx")
    assert Fake.files == [f"m.onnx on {CUDA}", f"m.int8.onnx on {CPU}"]
    assert network.note.endswith(f"cuda {why}; it runs on cpu")


@pytest.mark.parametrize("silent", [True, False])
def test_the_next_one_asked_for_takes_over_and_is_what_runs(model: Path, silent: bool) -> None:
    Fake.start, Fake.silent = [CUDA, CPU], silent
    network = open_network(model, 1, ("tensorrt", "cuda"), [TENSORRT, CUDA, CPU])
    assert (network.provider, network.path.name) == ("cuda", "m.onnx")
    assert Fake.files[-1] == f"m.onnx on {CUDA}"
    assert network.note.endswith("; it runs on cuda")


def test_missing_and_failing_providers_are_both_reported(model: Path) -> None:
    assert choose(("tensorrt",), [OPENVINO, CPU]).note == "tensorrt not in this installation, which has cpu, openvino"
    Fake.start, Fake.silent = [CPU], True
    network = open_network(model, 1, ("openvino", "cuda"), [CUDA, CPU])
    assert (network.provider, network.path.name) == ("cpu", "m.int8.onnx")
    assert "openvino not in this installation, which has cpu, cuda; cuda does not start here; it runs" in network.note


def test_a_broken_file_is_the_same_error_whatever_the_provider(tmp_path: Path) -> None:
    (tmp_path / "m.onnx").write_bytes(b"a text file, say")
    for asked in ((), ("cuda",)):
        with pytest.raises(ModelError, match="not a usable ONNX model"):
            open_network(tmp_path / "m.onnx", 1, asked, [CUDA, CPU])


def test_a_segmenter_says_on_what_it_runs(model: Path) -> None:
    assert str(Segmenter(model, providers=("cpu",))) == "m.int8.onnx: semantic, 64x48, on cpu"


def test_integers_are_multiplied_exactly(tmp_path: Path) -> None:
    # 27 products of 255 and 127: two of them are more than 16 bits hold, where processors without VNNI add them
    planes = np.full((1, 3, HEIGHT, WIDTH), 255.0, np.float32)
    answer = open_network(whitest(tmp_path / "m.onnx"), asked=("cpu",)).run(planes)[0]
    np.testing.assert_allclose(answer[0, 0, 1:-1, 1:-1], 255.0, atol=1.0)


def whitest(path: Path) -> Path:
    """A network in 8-bit integers whose answer is the mean of 3x3 pixels in three channels; its weights are the largest that there are."""
    values = {
        "one": np.float32(1),
        "none": np.uint8(0),
        "weights": np.full((1, 3, 3, 3), 127, np.int8),
        "part": np.float32(1 / 127 / 27),
        "zero": np.int8(0),
    }
    nodes = [
        helper.make_node("QuantizeLinear", ["image", "one", "none"], ["integers"]),
        helper.make_node("DequantizeLinear", ["integers", "one", "none"], ["reals"]),
        helper.make_node("DequantizeLinear", ["weights", "part", "zero"], ["factors"]),
        helper.make_node("Conv", ["reals", "factors"], ["means"], pads=[1, 1, 1, 1]),
        helper.make_node("QuantizeLinear", ["means", "one", "none"], ["answer"]),
        helper.make_node("DequantizeLinear", ["answer", "one", "none"], ["out"]),
    ]
    given, out = (
        helper.make_tensor_value_info(name, TensorProto.FLOAT, [1, count, HEIGHT, WIDTH])
        for name, count in (("image", 3), ("out", 1))
    )
    constants = [onnx.numpy_helper.from_array(np.asarray(value), name) for name, value in values.items()]
    model = helper.make_model(
        helper.make_graph(nodes, "white", [given], [out], constants),
        opset_imports=[helper.make_opsetid("", 17)],
        ir_version=8,
    )
    path.write_bytes(model.SerializeToString())
    return path


@pytest.mark.extra("fast")
def test_openvino_gives_what_onnxruntime_gives() -> None:
    shelves = load_class("shelves").model
    rng = np.random.default_rng(0)
    picture = np.kron(rng.integers(0, 256, (12, 16, 3), dtype=np.uint8), np.ones((40, 40, 1), np.uint8))
    by_openvino, by_processor = (Segmenter(shelves, providers=(name,)) for name in ("openvino", "cpu"))
    assert by_openvino.provider == "openvino"
    first, second = (segmenter.probabilities(picture) for segmenter in (by_openvino, by_processor))
    assert np.abs(first - second).mean() < 0.002
    assert (first.argmax(axis=0) == second.argmax(axis=0)).mean() > 0.995
