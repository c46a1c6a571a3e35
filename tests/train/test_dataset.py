import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from savmap.errors import OutputError
from savmap.train.dataset import IGNORE, class_lookup, group_of, read_dataset, sampling_weights, split

from .conftest import write_dataset


def test_lookup_reorders_drops_and_ignores() -> None:
    table = class_lookup(["a", "b", "c"], ["c", "a"])
    assert table[[0, 1, 2, 3, 4, 255]].tolist() == [0, 2, 0, 1, IGNORE, IGNORE]


def test_read_and_load(four_pictures: Path) -> None:
    dataset = read_dataset(four_pictures, ["crossbar"])
    image, mask = dataset.samples[0].load()
    assert len(dataset.samples) == 4
    assert dataset.renderer == "made up"
    assert image.shape == (480, 640, 3)
    assert image[300, 105, 0] < 80 < image[205, 300, 0]
    assert set(np.unique(mask)) == {0, 1}
    assert np.all(mask[200:212, 150:350] == 1)


def test_neighbours_in_number_are_one_group() -> None:
    assert group_of("row-7-00041") == group_of("ceiling-7-00059") != group_of("row-7-00060")


def test_split_is_by_scene_and_never_empty(four_pictures: Path) -> None:
    samples = read_dataset(four_pictures, ["column"]).samples
    for share in (0.0, 0.5, 1.0):
        training, validation = split(samples, share)
        assert training
        assert validation
        assert not {s.group for s in training} & {s.group for s in validation}


def test_pictures_without_a_class_are_drawn_less_often(four_pictures: Path) -> None:
    cv2.imwrite(str(four_pictures / "masks" / "a-00000.png"), np.zeros((480, 640), np.uint8))
    weights = sampling_weights(read_dataset(four_pictures, ["column"]).samples, empty_weight=0.2)
    assert weights.sum() == pytest.approx(1)
    assert weights[0] == pytest.approx(weights[1] * 0.2)


def test_a_small_data_set_counts_for_more_than_its_size(tmp_path: Path) -> None:
    small, large = write_dataset(tmp_path / "small", 1), write_dataset(tmp_path / "large", 4)
    samples = [sample for folder in (small, large) for sample in read_dataset(folder, ["column"]).samples]
    assert sampling_weights(samples) == pytest.approx([1 / 3, *[1 / 6] * 4])


def test_no_header(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"no dataset\.json"):
        read_dataset(tmp_path, ["column"])


@pytest.mark.parametrize(
    "text", ["{", "[]", '{"format": "other", "version": 1, "classes": []}', '{"format": "savmap-dataset"}']
)
def test_bad_header(four_pictures: Path, text: str) -> None:
    (four_pictures / "dataset.json").write_text(text)
    with pytest.raises(OutputError, match=r"dataset\.json"):
        read_dataset(four_pictures, ["column"])


def test_missing_class_names_what_there_is(four_pictures: Path) -> None:
    with pytest.raises(OutputError, match="has no class lamp \\(it has column, crossbar\\)"):
        read_dataset(four_pictures, ["lamp"])


def test_no_pictures(tmp_path: Path) -> None:
    header = {"format": "savmap-dataset", "version": 1, "classes": ["column"]}
    (tmp_path / "dataset.json").write_text(json.dumps(header))
    with pytest.raises(OutputError, match="no picture"):
        read_dataset(tmp_path, ["column"])


def test_damaged_picture_is_named(four_pictures: Path) -> None:
    (four_pictures / "images" / "a-00000.jpg").write_bytes(b"")
    with pytest.raises(OutputError, match=r"a-00000\.jpg"):
        read_dataset(four_pictures, ["column"]).samples[0].load()
