"""Labels of the map, completed by a network."""

from pathlib import Path

import numpy as np
import pytest

from savmap.lab.adapt import distillation
from savmap.lab.adapt.distillation import STRIDE, completed, distilled, magnified
from savmap.lab.adapt.masks import IGNORE
from savmap.lab.sim.dataset import write_samples
from savmap.lab.train.data.sets import read_set

POST, PLANK = 1, 2


def seen(*background_post_plank: tuple[float, float, float]) -> np.ndarray:
    """Probabilities (3, 1, n) of pixels side by side."""
    return np.array(background_post_plank, np.float32).T[:, None]


@pytest.mark.parametrize(
    ("label", "probabilities", "expected"),
    [
        (IGNORE, (0.1, 0.8, 0.1), POST),
        (IGNORE, (0.9, 0.1, 0.0), 0),
        (IGNORE, (0.5, 0.45, 0.05), IGNORE),
        (POST, (0.6, 0.3, 0.1), POST),
        (POST, (0.97, 0.02, 0.01), 0),
        (0, (0.02, 0.0, 0.98), PLANK),
        (PLANK, (0.0, 0.0, 1.0), PLANK),
    ],
)
def test_the_network_completes_the_maps_labels(
    label: int, probabilities: tuple[float, float, float], expected: int
) -> None:
    assert completed(np.array([[label]], np.uint8), seen(probabilities)).tolist() == [[expected]]


def test_a_set_is_labelled_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        distillation,
        "_labelled",
        lambda network, samples, classes, progress: ((s.image.stem, *s.load()) for s in samples),
    )
    picture, mask = np.full((480, 640, 3), 90, np.uint8), np.full((480, 640), POST, np.uint8)
    write_samples(tmp_path / "views", ("post", "plank"), "test", [("a-1", picture, mask)])
    for _ in range(2):
        folder = distilled(
            tmp_path / "net.onnx",
            tmp_path / "views",
            tmp_path / "distilled",
            ("post", "plank"),
            lambda done, line: None,
        )
        (sample,) = read_set(folder, ("post", "plank")).samples
        assert (sample.load()[1] == POST).all()
        monkeypatch.setattr(distillation, "_labelled", lambda *arguments: pytest.fail("labelled again"))


def test_a_magnified_look_is_as_large_as_the_picture() -> None:
    """Sizes that the network is shown are multiples of the stride; a left and a right side are told apart."""
    sizes = []

    def bright(image: np.ndarray) -> np.ndarray:
        sizes.append(image.shape[:2])
        return np.stack([1 - image[..., 0] / 255, image[..., 0] / 255]).astype(np.float32)

    picture = np.zeros((90, 130, 3), np.uint8)
    picture[20:60, 100:] = 255
    maps = magnified(bright)(picture)
    assert maps.shape == (2, 90, 130)
    assert np.mean(np.abs(maps[1] - picture[..., 0] / 255)) < 0.01
    assert len(set(sizes)) == 3
    assert all(side % STRIDE == 0 for size in sizes for side in size)
