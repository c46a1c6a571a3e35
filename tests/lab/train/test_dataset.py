import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from savmap.errors import OutputError
from savmap.lab.train.data.dataset import (
    IGNORE,
    REPLAYED,
    Sample,
    class_lookup,
    group_of,
    read_dataset,
    sampling_weights,
    split,
)
from savmap.lab.train.data.sets import Shapes

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


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("3f2a9c1b-row-7-00041", "77ab01cd-row-7-00042"),
        ("row-7-41_jpg.rf.9b0a1c2d3e4f5061", "row-7-41_jpg.rf.0011aa22bb33cc44"),
        ("20260131-row-7-00041", "20260131-row-7-00042"),
    ],
)
def test_what_labelling_tools_add_to_a_name_does_not_part_a_scene(first: str, second: str) -> None:
    assert group_of(first) == group_of(second)
    assert group_of(first).endswith("7-2")


def sample(group: str, number: int) -> Sample:
    return Sample(Path(f"{number}.jpg"), Shapes(1, 1, ()), group, "set")


def test_a_single_scene_is_cut_in_two_and_not_shared(four_pictures: Path) -> None:
    training, validation = split([sample("a", number) for number in range(50)])
    assert [one.image.stem for one in validation] == ["47", "48", "49"]
    assert len(training) == 47
    assert [len(part) for part in split([sample("a", 0)])] == [1, 1]


def test_a_folder_is_called_the_same_however_it_is_given(four_pictures: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(four_pictures)
    here, there = (read_dataset(folder, ["column"]) for folder in (Path(), four_pictures))
    assert [one.group for one in here.samples] == [one.group for one in there.samples]


def test_a_mask_in_colours_is_refused(four_pictures: Path) -> None:
    path = four_pictures / "masks" / "a-00000.png"
    coloured = Image.open(path).convert("P")
    coloured.putpalette([0, 0, 0, 128, 0, 0, 0, 128, 0])
    coloured.save(path)
    with pytest.raises(OutputError, match=r"a-00000\.png: a mask has one channel of 8 bits"):
        read_dataset(four_pictures, ["column"]).samples[0].load()


def test_labels_that_show_nothing_are_not_trained_on(four_pictures: Path) -> None:
    for path in (four_pictures / "masks").iterdir():
        cv2.imwrite(str(path), np.full((480, 640), IGNORE, np.uint8))
    with pytest.raises(OutputError, match="none of the 4 pictures to train on shows any class"):
        sampling_weights(read_dataset(four_pictures, ["column"]).samples)


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


def test_pictures_against_forgetting_are_drawn_seldom(tmp_path: Path) -> None:
    own, kept = write_dataset(tmp_path / "own", 1), write_dataset(tmp_path / "kept", 4)
    samples = [sample for folder in (own, kept) for sample in read_dataset(folder, ["column"]).samples]
    weights = sampling_weights(samples, replayed={samples[-1].origin})
    assert weights == pytest.approx([1 - REPLAYED, *[REPLAYED / 4] * 4])
    everything = {sample.origin for sample in samples}
    assert sampling_weights(samples, replayed=everything) == pytest.approx([1 / 3, *[1 / 6] * 4])


def test_no_header(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"no dataset\.json"):
        read_dataset(tmp_path, ["column"])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{", "is not JSON"),
        ('{"format": "other", "version": 1, "classes": ["column"]}', "not a savmap-dataset of version 1"),
        ('{"format": "savmap-dataset", "version": 1}', "`classes` is a list of 1 to 254 names"),
        (json.dumps({"format": "savmap-dataset", "version": 1, "classes": ["column"] * 300}), "`classes` is a list"),
    ],
)
def test_bad_header(four_pictures: Path, text: str, words: str) -> None:
    (four_pictures / "dataset.json").write_text(text)
    with pytest.raises(OutputError, match=rf"dataset\.json: {words}"):
        read_dataset(four_pictures, ["column"])


def test_missing_class_names_what_there_is(four_pictures: Path) -> None:
    with pytest.raises(OutputError, match="has no class lamp \\(it has column, crossbar\\)"):
        read_dataset(four_pictures, ["lamp"])


def test_sides_of_a_class_may_be_missing(four_pictures: Path) -> None:
    dataset = read_dataset(four_pictures, ["column", "crossbar", "column_side"])
    assert {int(value) for sample in dataset.samples for value in np.unique(sample.labels.mask())} <= {0, 1, 2, 255}
    with pytest.raises(OutputError, match="has no class lamp_side"):
        read_dataset(four_pictures, ["column", "lamp_side"])


def test_no_pictures(tmp_path: Path) -> None:
    header = {"format": "savmap-dataset", "version": 1, "classes": ["column"]}
    (tmp_path / "dataset.json").write_text(json.dumps(header))
    with pytest.raises(OutputError, match="no picture"):
        read_dataset(tmp_path, ["column"])


def test_damaged_picture_is_named(four_pictures: Path) -> None:
    (four_pictures / "images" / "a-00000.jpg").write_bytes(b"")
    with pytest.raises(OutputError, match=r"a-00000\.jpg"):
        read_dataset(four_pictures, ["column"]).samples[0].load()
