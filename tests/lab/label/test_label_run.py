"""From a recording to a folder of labelled views."""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from savmap.errors import OutputError
from savmap.lab.label.formats import LabelledPicture, LabelledSet, write_set
from savmap.lab.label.polygons import filled
from savmap.lab.label.run import (
    Candidate,
    Recording,
    ViewPredictor,
    aimed_recordings,
    candidates_of,
    picture_name,
    pictures,
    predictors_of,
    worth_and_features,
)
from savmap.lab.label.worth import chosen
from savmap.pipeline.view_plans import PassPlan
from savmap.site.job import Job
from savmap.site.model import Pass, Row, Site
from savmap.types import ViewPlan, ViewSpec
from savmap.types.progress import SilentMonitor
from savmap.video.clip import Clip

SPEC = ViewSpec("pass 1 / face", 0.0, width=64, height=48)
FRAMES = 12
ROOM: Any = SimpleNamespace(name="posts", classes=["post"], model=Path("a.onnx"), class_names={}, providers=())


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
    return Recording("A", ROOM, PassPlan("pass 1", Clip(folder, fps=30.0), {}), [SPEC], FRAMES, 2)


def written(recording: Recording, folder: Path, count: int = 3) -> LabelledSet:
    predictor = ViewPredictor(Dark(), ["post"])  # type: ignore[arg-type]
    candidates = list(candidates_of(0, [recording], predictor, SilentMonitor()))
    assert [one.frame for one in candidates] == list(range(0, FRAMES, 2))
    assert all(0 <= one.disagreement <= 1 and one.uncertainty >= 0 for one in candidates)
    picked = [candidates[index] for index in chosen(*worth_and_features(candidates, [recording]), count)]
    return write_set(folder, ["post"], pictures(picked, [recording], [predictor], SilentMonitor()))


def digest(folder: Path) -> str:
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return hashlib.sha256(b"".join(str(f.relative_to(folder)).encode() + f.read_bytes() for f in files)).hexdigest()


def test_both_formats_say_the_same(recording: Recording, tmp_path: Path) -> None:
    labelled = written(recording, tmp_path / "out")
    assert (labelled.pictures, labelled.outlines) == (3, 3)
    coco = json.loads((tmp_path / "out" / "coco.json").read_text(encoding="utf-8"))
    assert [category["name"] for category in coco["categories"]] == ["post"]
    for image, annotation in zip(coco["images"], coco["annotations"], strict=True):
        corners = np.reshape(annotation["segmentation"], (-1, 2))
        stem = Path(image["file_name"]).stem
        labelme = json.loads((tmp_path / "out" / "images" / f"{stem}.json").read_text(encoding="utf-8"))
        assert labelme["shapes"][0]["points"] == corners.tolist()
        assert labelme["imagePath"] == image["file_name"]
        _, top, width, height = annotation["bbox"]
        assert annotation["area"] == pytest.approx(filled(corners, 48, 64).sum(), rel=0.1)
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
        write_set(tmp_path, ["post"], breaks_off())
    assert not list(tmp_path.glob("*.json"))
    assert not list(tmp_path.rglob("*.part"))


def test_names_are_safe_and_tell_the_scene() -> None:
    assert picture_name("3/A", "pass 1 / face low", 12) == "3-A-pass-1-face-low-00012"
    assert (
        picture_name("\N{LATIN CAPITAL LETTER O WITH DIAERESIS}", "pass 1 / face", 3)[0]
        == "\N{LATIN CAPITAL LETTER O WITH DIAERESIS}"
    )


def test_rows_whose_names_come_to_the_same_keep_their_own_pictures(recording: Recording) -> None:
    rows = [replace(recording, row=name) for name in ("3/A", "3-A", "3 A")]
    predictor = ViewPredictor(Dark(), ["post"])  # type: ignore[arg-type]
    picked = [Candidate(number, SPEC, 4, 0.0, np.zeros(1)) for number in range(3)]
    names = [one.name for one in pictures(picked, rows, [predictor] * 3, SilentMonitor())]
    assert names == [f"{more}3-A-pass-1-face-00004" for more in ("", "x-", "x-x-")]


def test_all_recordings_are_as_far_from_one_another(recording: Recording) -> None:
    rows = [replace(recording, row=name) for name in "ABCDE"]
    _, features = worth_and_features([Candidate(number, SPEC, 4, 0.0, np.zeros(2)) for number in range(5)], rows)
    apart = np.linalg.norm(features[:, None] - features[None], axis=2)[~np.eye(5, dtype=bool)]
    assert apart.min() == apart.max() > 0


def test_no_more_views_are_looked_at_than_six_for_each_that_is_wanted(
    recording: Recording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def aimed(name: str, one: Pass, *_: object) -> PassPlan:
        views = (SPEC,) if one.start_s == 0 else ()
        return PassPlan(name, recording.aimed.clip, {"posts": ViewPlan(views)})

    monkeypatch.setattr("savmap.lab.label.run.plugins_for", lambda *_: [ROOM])
    monkeypatch.setattr("savmap.lab.label.run.SegmenterPool", lambda _: None)
    monkeypatch.setattr("savmap.lab.label.run.plan_pass", aimed)
    monkeypatch.setattr("savmap.lab.label.run.probe_clip", lambda *_: None)
    passes = tuple(Pass(video=tmp_path, start_s=start, end_s=9.0) for start in (0.0, 5.0))
    job = Job(Site(rows={"A": Row(passes=passes)}), tmp_path, ["posts"], tmp_path)
    for frames, every in ((60, 1), (61, 2), (119, 2), (121, 3)):
        monkeypatch.setattr("savmap.lab.label.run.expected_frames", lambda *_, frames=frames: frames)
        (only,) = aimed_recordings(job, "posts", 10, SilentMonitor())
        assert only.every == every


def test_each_row_is_looked_at_with_its_own_network(recording: Recording, monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[Path] = []

    def segmenters(plugins: Sequence[Any]) -> SimpleNamespace:
        opened.append(plugins[0].model)
        return SimpleNamespace(network=lambda loaded: loaded.model)

    monkeypatch.setattr("savmap.lab.label.run.SegmenterPool", segmenters)
    opened_plugins = [SimpleNamespace(**{**vars(ROOM), "model": Path(name)}) for name in ("a", "b", "a")]
    predictors = predictors_of([replace(recording, loaded=loaded) for loaded in opened_plugins])  # type: ignore[arg-type]
    assert [str(one.segmenter) for one in predictors] == ["a", "b", "a"]
    assert opened == [Path("a"), Path("b")]
