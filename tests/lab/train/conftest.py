import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from savmap.lab.label.formats import LabelledPicture, write_set
from savmap.lab.label.polygons import outlines
from savmap.lab.train.plan import TrainingPlan

ROOT = Path(__file__).parents[3]
MODELS = {name: ROOT / "plugins" / name / f"savmap_{name}" / "model" / f"{name}.onnx" for name in ("shelves", "lights")}


def bars(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A picture (480, 640, 3) with two columns and a crossbar, and its mask: 1 column, 2 crossbar."""
    image = cv2.resize(rng.integers(60, 120, (24, 32, 3)).astype(np.uint8), (640, 480))
    mask = np.zeros((480, 640), np.uint8)
    mask[200:212], mask[:, 100:110], mask[:, 400:412] = 2, 1, 1
    image[mask == 1] = (20, 30, 200)
    image[mask == 2] = (230, 120, 10)
    return image, mask


def write_dataset(folder: Path, count: int) -> Path:
    rng = np.random.default_rng(3)
    for name in ("images", "masks"):
        (folder / name).mkdir(parents=True)
    for number in range(count):
        image, mask = bars(rng)
        cv2.imwrite(str(folder / "images" / f"a-{20 * number:05d}.jpg"), image[:, :, ::-1])
        cv2.imwrite(str(folder / "masks" / f"a-{20 * number:05d}.png"), mask)
    header = {"format": "savmap-dataset", "version": 1, "classes": ["column", "crossbar"], "renderer": "made up"}
    (folder / "dataset.json").write_text(json.dumps(header))
    return folder


@pytest.fixture
def four_pictures(tmp_path: Path) -> Path:
    return write_dataset(tmp_path / "data", 4)


def masks(count: int) -> list[tuple[np.ndarray, np.ndarray]]:
    rng = np.random.default_rng(3)
    return [bars(rng) for _ in range(count)]


@pytest.fixture
def both(tmp_path: Path) -> Path:
    """A folder that `savmap label` might have written: COCO and LabelMe of the same two pictures."""
    pictures = [
        LabelledPicture(f"a-{20 * n:05d}", image, {"column": outlines(mask == 1), "crossbar": outlines(mask == 2)})
        for n, (image, mask) in enumerate(masks(2))
    ]
    write_set(tmp_path / "set", ["column", "crossbar"], pictures)
    return tmp_path / "set"


def edited(path: Path, edit: Callable[[Any], None]) -> Path:
    content = json.loads(path.read_text(encoding="utf-8"))
    edit(content)
    path.write_text(json.dumps(content), encoding="utf-8")
    return path


@pytest.fixture
def plan(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> TrainingPlan:
    """Two steps from the shipped network on four pictures, in small crops."""
    from savmap.lab.train import trainer
    from savmap.lab.train.data.augment import Crop

    quick = replace(trainer.FINE_TUNING, batch=2, crop=Crop(64, 64), validations=1, validation_limit=1)
    monkeypatch.setattr(trainer, "FINE_TUNING", quick)
    data = write_dataset(tmp_path / "data", 4)
    mapping = {"column": "upright", "crossbar": "beam"}
    return TrainingPlan(("upright", "beam"), [data], tmp_path / "m.onnx", 1e-6, 1, MODELS["shelves"], mapping)


@pytest.fixture
def quick_export(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fine-tuning writes the shipped network in place of its own: to export one takes a quarter of a minute."""

    def copied(network: object, classes: object, recipe: object, output: Path) -> None:
        shutil.copy(MODELS["shelves"], output)

    monkeypatch.setattr("savmap.lab.train.finetune.export", copied)
