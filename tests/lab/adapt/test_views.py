"""Views of a map, chosen and labelled from the footage."""

from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from savmap.errors import StructureError
from savmap.lab.adapt import labels, views
from savmap.lab.adapt.faces import outlines_of
from savmap.lab.train.data.sets import read_set
from savmap.site.model import Pass
from savmap.types import FrameTable, RowMap, SiteMap, Trajectory, ViewSpec
from savmap.types.progress import SilentMonitor
from savmap.vision.networks.adapter import Segmentation

from .filmed_wall import BOXES, CLASSES, SPEC, pixel, pose, quad

FRAMES = 30
AWAY = ViewSpec("pass 1 / away", 180.0, width=64, height=48)
PLUGIN: Any = SimpleNamespace(name="posts", classes=CLASSES)


class DarkPool:
    """A network that takes what is dark for a post, and sees no planks."""

    def __init__(self, plugins: object) -> None:
        pass

    def predict(self, plugin: object, view: Any) -> Segmentation:
        post = np.where(view.image[..., 0] < 100, 0.9, 0.02).astype(np.float32)
        plank = np.full_like(post, 0.01)
        return Segmentation(CLASSES, np.stack([1 - post - plank, post, plank]))


@pytest.fixture(scope="module")
def row() -> RowMap:
    frames = FrameTable(np.arange(FRAMES) / 10.0, ("pass 1",) * FRAMES)
    path = Trajectory(np.arange(2, FRAMES), np.repeat(pose()[None], FRAMES - 2, axis=0))
    views = {spec.name: spec for spec in (SPEC, AWAY)}
    posts = tuple(quad(name) for name in BOXES if name.startswith("post"))
    return RowMap("A", frames, views, path, {"posts": posts}, ())


@pytest.fixture(scope="module")
def job(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """A job whose footage stands still before the wall with two dark posts."""
    folder = tmp_path_factory.mktemp("pictures")
    panorama = np.full((256, 512, 3), 180, np.uint8)
    for name in ("post 1", "post 2"):
        left, right, low, high = BOXES[name]
        y, x = np.mgrid[low:high:600j, left:right:60j]
        columns = 256 + 512 * np.arctan2(x, 1.5) / (2 * np.pi)
        rows = 128 - 256 * np.arctan2(y - 0.75, np.hypot(x, 1.5)) / np.pi
        panorama[rows.astype(int), columns.astype(int)] = 30
    for number in range(FRAMES):
        cv2.imwrite(str(folder / f"{number:03d}.png"), panorama)
    rows = {"A": SimpleNamespace(passes=[Pass(video=folder, fps=30.0)])}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(views, "SegmenterPool", DarkPool)
        yield SimpleNamespace(
            site=SimpleNamespace(rows=rows), opened=lambda row, name: PLUGIN, source=Path("site.yaml")
        )


@pytest.fixture(scope="module")
def sets(job: Any, row: RowMap, tmp_path_factory: pytest.TempPathFactory) -> labels.LabelSets:
    folder = tmp_path_factory.mktemp("sets")
    return labels.write_labels(job, "posts", SiteMap({"A": row}, {}), 25, folder, SilentMonitor())


def test_views_that_show_nothing_are_left_out(row: RowMap) -> None:
    found = views.views_of(row, outlines_of(row.structures["posts"], CLASSES))
    assert found == [(frame, SPEC) for frame in range(2, FRAMES)]
    assert list(views.evenly(found, 3)) == [2, 16, FRAMES - 1]
    assert views.evenly([], 3) == {}


def test_map_labels_footage(sets: labels.LabelSets) -> None:
    names = [{sample.image.name for sample in read_set(one, CLASSES).samples} for one in vars(sets).values()]
    assert [len(own) for own in names] == [18 + 35, 2, 5]
    assert len(set().union(*names)) == 60
    assert sum("turned" in name for name in names[0]) == 18 * labels.TURNED - 1  # it shows too little
    mask = cv2.imread(str(next((sets.choice / "masks").iterdir())), cv2.IMREAD_UNCHANGED)
    assert mask is not None
    assert mask[pixel(0.95, 0.7)] == 1
    assert mask[pixel(0.2, 0.7)] == 0
    assert mask[pixel(1.3, 0.7)] == 255


def test_too_few_views_are_refused(job: Any, row: RowMap, tmp_path: Path) -> None:
    with pytest.raises(StructureError, match=r"site\.yaml: the map labels 18 views, fewer than 28"):
        labels.write_labels(job, "posts", SiteMap({"A": row}, {}), 8, tmp_path, SilentMonitor())
    assert not (tmp_path / "views").exists()


def test_turned_views_look_elsewhere_and_stay() -> None:
    specs = [views.turned(SPEC, frame, number) for frame in range(9) for number in range(2)]
    assert specs == [views.turned(SPEC, frame, number) for frame in range(9) for number in range(2)]
    assert len({(view.yaw_deg, view.pitch_deg, view.hfov_deg) for view in specs}) == 18
    assert len({view.name for view in specs}) == 2
    assert all(abs(view.yaw_deg) <= views.YAW_DEG and abs(view.pitch_deg) <= views.PITCH_DEG for view in specs)


def test_turned_views_are_labelled_where_they_look(sets: labels.LabelSets) -> None:
    wrong = judged = 0
    for sample in read_set(sets.views, CLASSES).samples:
        if "turned" in sample.image.name:
            picture, mask = sample.load()
            known = mask != 255
            wrong += int(np.sum(((picture[..., 0] < 100) != (mask == 1)) & known))
            judged += int(known.sum())
    assert judged > 10000
    assert wrong < 0.03 * judged
