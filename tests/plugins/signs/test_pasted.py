"""Plates pasted into pictures of other sets, for training."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from savmap.lab.train.data.dataset import group_of, read_dataset
from savmap_signs.lab import pasted


def test_pasted_plates_are_a_set_whose_scenes_stay_together(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    for part in ("images", "masks"):
        (tmp_path / "bare" / part).mkdir(parents=True)
    for number in (3, 4, 5, 6):
        cv2.imwrite(str(tmp_path / "bare/images" / f"face-7-{number:05d}.jpg"), rng.integers(60, 90, (480, 640, 3)))
        mask = np.zeros((480, 640), np.uint8)
        mask[:, 100:140] = 1
        cv2.imwrite(str(tmp_path / "bare/masks" / f"face-7-{number:05d}.png"), mask)
    pasted.main([str(tmp_path / "bare"), "--count", "4", "--seed", "9", "-o", str(tmp_path / "signs")])
    assert json.loads((tmp_path / "signs/dataset.json").read_text())["classes"] == ["sign"]
    samples = read_dataset(tmp_path / "signs", ("sign",)).samples
    assert len(samples) == 4
    assert {group_of(sample.image.stem) for sample in samples} == {"9-7-0"}
    shown = [sample.load() for sample in samples]
    assert {value for _, mask in shown for value in np.unique(mask)} == {0, 1}
    for picture, mask in shown:
        changed = np.abs(picture.astype(int) - 75).max(axis=2) > 40
        assert not changed[cv2.dilate(mask, np.ones((9, 9))) == 0].any()
    assert any(changed_by_plate(picture, mask) for picture, mask in shown)


def test_nothing_to_paste_into_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        pasted.main([str(tmp_path / "none"), "--count", "4", "-o", str(tmp_path / "signs")])
    assert "none: no pictures in its folder images" in capsys.readouterr().err
    assert not (tmp_path / "signs").exists()


def changed_by_plate(picture: np.ndarray, mask: np.ndarray) -> bool:
    """Whether something else than the grey noise is where the mask says that a plate is."""
    inside = picture[mask == 1].astype(int)
    return bool(len(inside) and inside.std() > 25)
