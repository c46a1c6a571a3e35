import json
from pathlib import Path

import cv2
import numpy as np
import pytest


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
