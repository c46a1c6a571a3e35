"""Networks in 8-bit integers."""

import json
from pathlib import Path

import cv2
import numpy as np
import onnx
import pytest

from savmap.errors import OutputError
from savmap.lab.train.quantise import quantise
from savmap.types import ViewSpec
from savmap.video.reader import Clip, panoramas
from savmap.vision.networks.segmenter import Segmenter
from savmap.vision.views import Renderer

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[3]
CLIP = ROOT / "examples" / "aisle-dev" / "aisle-dev.mp4"
FACE, CEILING = ViewSpec("face", yaw_deg=-80.0, hfov_deg=120.0), ViewSpec("ceiling", 0.0, 89.0, hfov_deg=110.0)


def shipped(plugin: str, ending: str) -> Path:
    return ROOT / "plugins" / plugin / f"savmap_{plugin}" / "model" / f"{plugin}{ending}"


def picture(spec: ViewSpec) -> np.ndarray:
    return Renderer().render(next(panoramas(Clip(CLIP, start_s=3.0, fps=1.0))), spec).image


@pytest.fixture
def clip_as_data(tmp_path: Path) -> Path:
    """A data set of two views of the clip, with empty masks: ranges are taken from pictures alone."""
    for name in ("images", "masks"):
        (tmp_path / "data" / name).mkdir(parents=True)
    for number, spec in enumerate((FACE, CEILING)):
        name = f"a-{20 * number:05d}.png"
        cv2.imwrite(str(tmp_path / "data" / "images" / name), picture(spec)[:, :, ::-1])
        cv2.imwrite(str(tmp_path / "data" / "masks" / name), np.zeros((480, 640), np.uint8))
    header = {"format": "savmap-dataset", "version": 1, "classes": ["light"]}
    (tmp_path / "data" / "dataset.json").write_text(json.dumps(header))
    return tmp_path / "data"


def agreement(one: Path, other: Path, spec: ViewSpec) -> float:
    """The share of pixels that belong to the same class, of those that belong to any by either."""
    first, second = (Segmenter(path).probabilities(picture(spec)).argmax(axis=0) for path in (one, other))
    judged = (first > 0) | (second > 0)
    assert judged.sum() > 1000
    return float((first == second)[judged].mean())


@pytest.mark.parametrize(("plugin", "spec"), [("shelves", FACE), ("lights", CEILING)])
def test_shipped_networks_in_integers_say_what_the_others_say(plugin: str, spec: ViewSpec) -> None:
    assert agreement(shipped(plugin, ".onnx"), shipped(plugin, ".int8.onnx"), spec) > 0.95


def test_a_quantised_network_is_a_third_of_the_size_and_says_the_same(clip_as_data: Path, tmp_path: Path) -> None:
    source, target = shipped("lights", ".onnx"), tmp_path / "small.onnx"
    quantise(source, [clip_as_data], target)
    assert target.stat().st_size < source.stat().st_size / 3
    assert agreement(source, target, CEILING) > 0.9
    before, after = ({e.key: e.value for e in onnx.load(path).metadata_props} for path in (source, target))
    assert after == {**before, "savmap.precision": "int8"}


def test_a_data_set_of_other_classes_is_refused(clip_as_data: Path, tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="has no class upright"):
        quantise(shipped("shelves", ".onnx"), [clip_as_data], tmp_path / "small.onnx")
    assert not (tmp_path / "small.onnx").exists()
