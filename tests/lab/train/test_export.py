"""Exported networks."""

from pathlib import Path

import pytest

MODELS = sorted((Path(__file__).parents[3] / "plugins").glob("*/savmap_*/model/*.onnx"))


@pytest.mark.parametrize("path", MODELS, ids=lambda path: path.name)
def test_shipped_networks_name_no_file(path: Path) -> None:
    assert b'.py"' not in path.read_bytes()


@pytest.mark.slow
@pytest.mark.extra("train")
def test_exported_network_names_no_file() -> None:
    from savmap.lab.train.export import graph
    from savmap.lab.train.network import build

    assert b'.py"' not in graph(build(1, None)).SerializeToString()
