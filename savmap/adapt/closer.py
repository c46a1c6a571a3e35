"""Labels of whole views: the map's, completed by the network that they taught, which looks at the views magnified and mirrored.

The map judges about half of a view's pixels: members' ends, what goods hide in part, and what lies beside the row have no label. Where it judges, its
label stays, but for what the network is sure is something else.
"""

import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from savmap.adapt.labels import RENDERER, Labelled
from savmap.adapt.magnified import magnified
from savmap.adapt.masks import IGNORE, Bytes
from savmap.sim.dataset import write_samples
from savmap.train.data.dataset import Sample
from savmap.train.data.sets import read_set
from savmap.train.measure import Maps
from savmap.train.plan import Progress

SURE = 0.6
"""What the map does not judge is labelled where the network gives a class such a probability."""
REFUTED = 0.05
"""A label of the map to which the network gives less is another thing's."""


def relabelled(network: Path, source: Path, folder: Path, classes: Sequence[str], progress: Progress) -> Path:
    """The pictures of a data set with labels of all their pixels, by a float32 network, as a data set in a folder, unless it is there. `classes`: the
    network's. Raises OutputError, ModelError."""
    if not folder.is_dir():
        partial = folder.with_name(f"{folder.name}.part")
        shutil.rmtree(partial, ignore_errors=True)
        write_samples(
            partial, classes, RENDERER, _labelled(network, read_set(source, classes).samples, classes, progress)
        )
        partial.rename(folder)
    return folder


def _labelled(
    network: Path, samples: Sequence[Sample], classes: Sequence[str], progress: Progress
) -> Iterator[Labelled]:
    from savmap.train.export import load_onnx  # torch, an extra, is imported when it is needed
    from savmap.train.trainer import predictor

    look = magnified(predictor(load_onnx(network, classes)[0]))
    for number, sample in enumerate(samples):
        progress(number / len(samples), f"looking closer at {sample.image.name}")
        image, labels = sample.load()
        yield sample.image.stem, image, completed(labels, look(image))


def completed(labels: Bytes, maps: Maps) -> Bytes:
    """Labels (H, W) of a view, completed and corrected by a network's probabilities (1 + classes, H, W)."""
    best = maps.argmax(axis=0).astype(np.uint8)
    seen = np.where(maps.max(axis=0) >= SURE, best, IGNORE)
    judged = labels != IGNORE
    agreed = np.take_along_axis(maps, np.where(judged, labels, 0)[None].astype(np.intp), axis=0)[0]
    return np.where(judged, np.where(agreed < REFUTED, best, labels), seen).astype(np.uint8)
