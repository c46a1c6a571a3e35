"""Painted pictures of racks: the same from the same numbers, labelled as they are built, read by training."""

from pathlib import Path

import numpy as np
import pytest

from savmap.geometry.pinhole import focal_px
from savmap.lab.sim.dataset import main
from savmap.lab.sim.paint.faces import Lighting
from savmap.lab.sim.paint.raster import Camera, camera_at
from savmap.lab.sim.paint.shade import painted
from savmap.lab.sim.paint.stage import Stage
from savmap.lab.sim.paint.wardrobe import Wardrobe, wardrobe_of
from savmap.lab.train.data.dataset import group_of, read_dataset
from savmap_shelves.lab.painted import pictures
from savmap_shelves.lab.painted.pictures import CLASSES, picture
from savmap_shelves.lab.painted.racks import SIDES, Bay, Row, build_row, random_style
from savmap_shelves.lab.painted.wardrobe import TEXTURES

UPRIGHT, BEAM = 1, 2


@pytest.fixture(scope="module")
def clothes() -> Wardrobe:
    return wardrobe_of(np.random.default_rng(1), TEXTURES)


def empty_row(clothes: Wardrobe, camera: Camera, style_seed: int, judged: bool = True) -> tuple[np.ndarray, Row]:
    """The mask of two bays without goods, and the row."""
    style = random_style(np.random.default_rng(style_seed), clothes, small=False)
    row = Row(style, (Bay(0.0, 2.0, (0.5, 1.6)), Bay(2.0, 1.5, (0.9,))), 2.6)
    stage = Stage(np.random.default_rng(0), SIDES)
    build_row(stage, row, clothes, lambda bay, bottom, top, depth: None, judged)
    light = Lighting(np.zeros((0, 3)), np.zeros(0), 1.0, 0.0, 0.0)
    return painted(stage.faces(), clothes.atlas, light, camera, (640, 480), 4).mask, row


@pytest.mark.slow
@pytest.mark.parametrize("style_seed", range(4))
def test_masks_agree_with_the_rack(clothes: Wardrobe, style_seed: int) -> None:
    camera = camera_at(np.array([1.75, 1.3, 5.0]), 0.0, 0.0, 0.0, 60.0)
    mask, row = empty_row(clothes, camera, style_seed)
    focal = focal_px(60.0, 640) / 5.0

    def label(x: float, y: float) -> int:
        return int(mask[round(239.5 + (1.3 - y) * focal), round(319.5 + (x - 1.75) * focal)])

    assert [label(x, 2.45) for x in (0.0, 2.0, 3.5)] == [UPRIGHT] * 3
    middle = row.style.beam_height / 2
    assert [label(x, y + middle) for x, y in ((0.6, 0.5), (1.4, 1.6), (2.7, 0.9))] == [BEAM] * 3
    assert [label(x, y) for x, y in ((1.0, 1.15), (2.7, 2.2), (-0.5, 1.0))] == [0, 0, 0]
    beside = slice(round(319.5 - 0.3 * focal), round(319.5 + 0.7 * focal))  # the post in the middle shows no flank
    post = (mask[round(239.5 + (1.3 - 2.45) * focal), beside] == UPRIGHT).sum() / focal
    assert post == pytest.approx(row.style.post_width, abs=1.5 / focal)


def test_flanks_are_a_class_of_their_own(clothes: Wardrobe) -> None:
    frontal, row = empty_row(clothes, camera_at(np.array([0.0, 2.45, 2.0]), 0.0, 0.0, 0.0, 60.0), 3)
    aside, _ = empty_row(clothes, camera_at(np.array([2.0, 2.45, 2.0]), -45.0, 0.0, 0.0, 60.0), 3)
    focal = focal_px(60.0, 640)
    assert (frontal[240] == UPRIGHT).sum() == pytest.approx(focal * row.style.post_width / 2.0, abs=2.5)
    seen = aside[240, 280:360]
    along = focal * np.sqrt(0.5) / (2 * np.sqrt(2))
    assert (seen == UPRIGHT).sum() == pytest.approx(along * row.style.post_width, rel=0.25)
    assert (seen == UPRIGHT + SIDES).sum() == pytest.approx(along * row.style.post_depth, rel=0.25)


def test_undersides_are_a_class_of_their_own(clothes: Wardrobe) -> None:
    mask, _ = empty_row(clothes, camera_at(np.array([1.0, 0.4, 1.5]), 0.0, 35.0, 0.0, 70.0), 3)
    assert (mask == BEAM + SIDES).sum() > 100


def test_rows_seen_from_behind_are_not_judged(clothes: Wardrobe) -> None:
    camera = camera_at(np.array([1.75, 1.3, 5.0]), 0.0, 0.0, 0.0, 60.0)
    mask, _ = empty_row(clothes, camera, 0, judged=False)
    assert set(np.unique(mask)) == {0, 255}


@pytest.mark.slow
def test_a_number_gives_one_picture() -> None:
    first, mask = picture(11, 3)
    pictures._wardrobe.cache_clear()
    again, same = picture(11, 3)
    assert np.array_equal(first, again)
    assert np.array_equal(mask, same)
    other, _ = picture(11, 4)
    assert first.shape == (480, 640, 3)
    assert np.abs(first.astype(int) - other).mean() > 10


@pytest.mark.slow
def test_the_command_writes_what_training_reads(tmp_path: Path) -> None:
    painted_racks = ["--kind", "painted", "--plugin", "shelves"]
    main([*painted_racks, "--count", "3", "--seed", "11", "-o", str(tmp_path)])
    before = (tmp_path / "images/practice-11-000001.jpg").stat().st_mtime_ns
    (tmp_path / "images/practice-11-000002.jpg").unlink()
    main([*painted_racks, "--count", "4", "--seed", "11", "-o", str(tmp_path)])
    assert (tmp_path / "images/practice-11-000001.jpg").stat().st_mtime_ns == before
    samples = read_dataset(tmp_path, CLASSES).samples
    assert len(samples) == 4
    assert {group_of(sample.image.stem) for sample in samples} == {group_of("practice-11-000000")}
    values = {int(value) for sample in samples for value in np.unique(sample.load()[1])}
    assert {UPRIGHT, BEAM} < values <= {0, UPRIGHT, BEAM, UPRIGHT + SIDES, BEAM + SIDES, 255}
