"""Which classes a network is trained for: the plugin's, or those of the file to begin with."""

from pathlib import Path

from savmap.lab.train.plan import trained_classes

ROOT = Path(__file__).parents[3]
LAMPS = ROOT / "plugins" / "lights" / "savmap_lights" / "model" / "lights.onnx"


def test_from_nothing_all_classes_of_the_plugins_network() -> None:
    assert trained_classes(("post",), ("post", "post_side"), None) == ("post", "post_side")
    assert trained_classes(("post",), ("post",), Path("a.checkpoint.pt")) == ("post",)


def test_a_file_that_has_the_needed_classes_keeps_its_own() -> None:
    assert trained_classes(("light",), ("light", "light_side"), LAMPS) == ("light",)


def test_a_file_for_other_classes_gets_the_plugins(tmp_path: Path) -> None:
    assert trained_classes(("post",), ("post",), LAMPS) == ("post",)
    assert trained_classes(("post",), ("post",), tmp_path / "missing.onnx") == ("post",)
