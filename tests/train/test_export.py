"""Exported networks."""

from pathlib import Path

import pytest

MODELS = sorted((Path(__file__).parents[2] / "plugins").glob("*/savmap_*/model/*.onnx"))


@pytest.mark.parametrize("path", MODELS, ids=lambda path: path.name)
def test_shipped_networks_name_no_file(path: Path) -> None:
    assert b'.py"' not in path.read_bytes()


@pytest.mark.slow
def test_exported_network_names_no_file() -> None:
    pytest.importorskip("torch")
    from savmap.train.export import graph  # needs torch, which is an extra
    from savmap.train.network import build

    assert b'.py"' not in graph(build(1, None)).SerializeToString()
