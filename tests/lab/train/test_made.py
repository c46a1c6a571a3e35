"""Training on pictures that are made meanwhile."""

import json
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from savmap.lab.sim.dataset import Sample
from savmap.lab.train.made.streams import Made

pytestmark = [pytest.mark.extra("train"), pytest.mark.slow]


def striped(seed: int) -> Sample:
    """A white post on dark noise."""
    rng = np.random.default_rng(seed)
    image, mask = rng.integers(0, 60, (480, 640, 3)).astype(np.uint8), np.zeros((480, 640), np.uint8)
    left = int(rng.integers(100, 500))
    image[:, left : left + 40], mask[:, left : left + 40] = 230, 1
    return image, mask


class Stripes:
    """What workers would have made: every fourth only measures."""

    def __init__(self) -> None:
        self.made = 0

    def take(self, wait_s: float = 0.0) -> Made | None:
        self.made += 1
        return Made("painted", self.made % 4 == 0, striped(self.made)) if wait_s else None


def training(steps: int, **options: Any) -> Any:
    import torch

    from savmap.lab.train.data.augment import Crop
    from savmap.lab.train.made.run import Budget, Task, Training

    budget = Budget(time.monotonic() + 600, steps, 2, 40, 10, Crop(128, 96))
    task = Task("posts", ("post", "post_side"), {"painted": 1.0}, data_share=0.0, **options)
    return Training(task, budget, torch.device("cpu"), None, lambda line: None)


@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::FutureWarning")
def test_network_is_trained_and_written_in_both_precisions(tmp_path: Path) -> None:
    import onnx

    from savmap.lab.train.made.run import calibrated, save_weights, some_pictures, write
    from savmap.vision.networks.segmenter import Segmenter

    under_way = training(6)
    under_way.fit(Stripes(), lambda: None)
    assert under_way.steps == 6
    network, about, table = calibrated(under_way)
    assert about["validation"]["painted"]["pictures"] >= 2
    counts = json.loads(table)["pixels"]["painted"]["post"]
    assert len(counts["class"]) == len(counts["none"]) == len(json.loads(table)["logit edges"]) + 1
    weights = {name: value.numpy() for name, value in network.state_dict().items()}
    write(weights, ("post", "post_side"), about, table, some_pictures(under_way, 2), tmp_path / "m.onnx")
    maps = [Segmenter(tmp_path / name).probabilities(striped(1)[0]) for name in ("m.onnx", "m.int8.onnx")]
    assert maps[0].shape == (3, 480, 640)
    assert all(np.allclose(one.sum(axis=0), 1, atol=1e-4) for one in maps)
    assert np.abs(maps[0] - maps[1]).mean() < 0.05
    properties = {entry.key: entry.value for entry in onnx.load(tmp_path / "m.int8.onnx").metadata_props}
    assert properties["savmap.calibration"] == table
    save_weights(under_way, tmp_path / "m.pt")
    again = training(1, begin=tmp_path / "m.pt")
    assert again.learner.updates == 6
    for name, value in again.learner.average.state_dict().items():
        assert np.allclose(value.numpy(), under_way.learner.average.state_dict()[name].numpy(), atol=2e-3), name


def test_variation_moves_no_edge() -> None:
    import torch

    from savmap.lab.train.data.augment import Crop
    from savmap.lab.train.made.vary import Variety, homographies, varied, warped

    crop = Crop(160, 128)
    image, mask = (torch.from_numpy(np.stack(part)) for part in zip(*(striped(k) for k in range(4)), strict=True))
    images = image.permute(0, 3, 1, 2)
    crops, labels = warped(images, mask, homographies(4, crop, 640, 480, np.random.default_rng(0)), crop, 2)
    seen = crops.mean(dim=1) > 145 / 255
    judged = labels != 255
    assert ((seen == (labels == 1)) | ~judged).float().mean() > 0.99
    changed = varied(crops, labels, 2, Variety())
    assert changed.shape == (4, 3, 128, 160)
    assert bool((changed == changed.round()).all())
    assert 0 <= float(changed.min()) <= float(changed.max()) <= 255


def test_pool_keeps_what_it_is_told_and_forgets_the_oldest() -> None:
    import torch

    from savmap.lab.train.made.pool import Pool

    pool = Pool(4, ["data", "painted"], torch.device("cpu"))
    pool.add("data", [striped(0)], keep=True)
    for seed in range(1, 6):
        pool.add("painted", [striped(seed)])
    assert pool.counts() == {"data": 1, "painted": 3}
    assert pool.added == 6
    left = {int(np.flatnonzero(mask[0])[0]) for mask in pool.masks.numpy()}
    assert left == {int(np.flatnonzero(striped(seed)[1][0])[0]) for seed in (0, 3, 4, 5)}
    images, _, kinds = pool.draw(8, {"data": 1.0, "painted": 0.0}, np.random.default_rng(0))
    assert kinds == ["data"] * 8
    assert images.shape == (8, 3, 480, 640)


def test_a_side_may_be_seen_where_labels_do_not_tell_it() -> None:
    import torch

    from savmap.lab.train.made.learn import loss_of
    from savmap.lab.train.made.pool import acceptance
    from savmap.lab.train.made.run import DATA, accepted_rows

    rows = accepted_rows(("post", "post_side"), [DATA, "face", "painted"])
    labels = torch.zeros((1, 8, 8), dtype=torch.int64)
    labels[:, :, 4:] = 1
    sides = torch.full((1, 3, 8, 8), 0.01)
    sides[:, 0, :, :4], sides[:, 2, :, 4:] = 0.98, 0.98
    losses = {kind: float(loss_of(sides, labels, acceptance([kind], rows, 2, torch.device("cpu")))) for kind in rows}
    assert losses[DATA] < 1.5 < losses["painted"]
    assert losses["painted"] == pytest.approx(losses["face"], abs=0.05)
