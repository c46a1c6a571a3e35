"""From a recording to a folder of labelled views."""

import hashlib
import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from savmap.errors import OutputError
from savmap.io.clip import Clip
from savmap.label.choose import chosen
from savmap.label.formats import LabelledPicture, write_set
from savmap.label.run import Recording, Watcher, looked, picture_name, pictures, worth_and_looks
from savmap.monitor import Quiet
from savmap.observe import PassAims
from savmap.types import ViewSpec

SPEC = ViewSpec("pass 1 / face", 0.0, width=64, height=48)
FRAMES = 12


class Dark:
    """A network that takes what is dark for a post, and is unsure in the sixth frame."""

    classes = ("other", "post")

    def __init__(self) -> None:
        self.shown = 0

    def probabilities(self, image: np.ndarray) -> np.ndarray:
        post = np.where(image[..., 0] < 100, 0.98, 0.01).astype(np.float32)
        rest = np.full_like(post, 0.005)
        return np.stack([1 - post - rest, rest, post])


@pytest.fixture
def recording(tmp_path: Path) -> Recording:
    """A dark post that moves past."""
    folder = tmp_path / "pictures"
    folder.mkdir()
    for number in range(FRAMES):
        panorama = np.full((64, 128, 3), 40 * (number % 4) + 110, np.uint8)
        panorama[:, 50 + number : 58 + number] = 30
        cv2.imwrite(str(folder / f"{number:03d}.png"), panorama)
    return Recording("A", PassAims("pass 1", Clip(folder, fps=30.0), {}), [SPEC], FRAMES, 2)


def written(recording: Recording, folder: Path, count: int = 3) -> list[str]:
    watcher = Watcher(Dark(), ["post"])  # type: ignore[arg-type]
    candidates = list(looked(0, [recording], watcher, Quiet()))
    assert [one.frame for one in candidates] == list(range(0, FRAMES, 2))
    assert all(0 <= one.disagreement <= 1 and one.doubt >= 0 for one in candidates)
    picked = [candidates[index] for index in chosen(*worth_and_looks(candidates, [recording]), count)]
    return list(write_set(folder, ["post"], pictures(picked, [recording], watcher, Quiet())))


def digest(folder: Path) -> str:
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return hashlib.sha256(b"".join(str(f.relative_to(folder)).encode() + f.read_bytes() for f in files)).hexdigest()


def test_all_three_formats_say_the_same(recording: Recording, tmp_path: Path) -> None:
    lines = written(recording, tmp_path / "out")
    assert "wrote 3 pictures with 3 outlines" in lines[0]
    coco = json.loads((tmp_path / "out" / "coco.json").read_text(encoding="utf-8"))
    assert [category["name"] for category in coco["categories"]] == ["post"]
    for image, annotation in zip(coco["images"], coco["annotations"], strict=True):
        corners = np.reshape(annotation["segmentation"], (-1, 2))
        stem = Path(image["file_name"]).stem
        label, *shares = (tmp_path / "out" / "labels" / f"{stem}.txt").read_text(encoding="utf-8").split()
        labelme = json.loads((tmp_path / "out" / "images" / f"{stem}.json").read_text(encoding="utf-8"))
        assert label == "0"
        assert np.allclose(np.reshape(shares, (-1, 2)).astype(float) * [64, 48], corners, atol=1e-3)
        assert labelme["shapes"][0]["points"] == corners.tolist()
        assert labelme["imagePath"] == image["file_name"]
        _, top, width, height = annotation["bbox"]
        assert annotation["area"] <= width * height
        assert (top, height) == (0, 48)
        assert cv2.imread(str(tmp_path / "out" / "images" / image["file_name"])).shape == (48, 64, 3)


def test_the_same_recording_gives_the_same_bytes(recording: Recording, tmp_path: Path) -> None:
    written(recording, tmp_path / "one")
    written(recording, tmp_path / "two")
    assert digest(tmp_path / "one") == digest(tmp_path / "two")


def test_labels_that_are_there_are_not_overwritten(recording: Recording, tmp_path: Path) -> None:
    written(recording, tmp_path / "out")
    with pytest.raises(
        OutputError, match=r"out: holds coco\.json already, which may have been corrected; choose another -o"
    ):
        written(recording, tmp_path / "out")


def test_what_breaks_off_leaves_nothing_that_looks_finished(tmp_path: Path) -> None:
    def breaks_off():  # type: ignore[no-untyped-def]
        yield LabelledPicture("a", np.zeros((8, 8, 3), np.uint8), {})
        raise OutputError("full")

    with pytest.raises(OutputError, match="full"):
        list(write_set(tmp_path, ["post"], breaks_off()))
    assert not list(tmp_path.glob("*.json"))
    assert not list(tmp_path.glob("*.yaml"))
    assert not list(tmp_path.rglob("*.part"))


def test_names_are_safe_and_tell_the_scene() -> None:
    assert picture_name("3/A", "pass 1 / face low", 12) == "3-A-pass-1-face-low-00012"
