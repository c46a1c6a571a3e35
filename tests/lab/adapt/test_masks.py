"""Labels of a view by a map and the evidence of all frames."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from savmap.lab.adapt.faces import Outline, faces_of
from savmap.lab.adapt.masks import IGNORE, KnownFace, MaskSettings, mask_of
from savmap.vision.evidence import PackedView

from .filmed_wall import CLASSES, SPEC, packed_view, pixel, pose

POST, PLANK = 1, 2
ON_POST, ON_PLANK, BETWEEN, BEYOND = (0.95, 0.5), (0.0, 1.05), (0.2, 0.5), (1.2, 0.5)


def labels(known: KnownFace, seen: PackedView, **settings: float) -> np.ndarray:
    return mask_of(seen, SPEC, pose(), [known], CLASSES, replace(MaskSettings(), **settings))


def with_evidence(known: KnownFace, label: str, box: tuple[float, float, float, float], value: float) -> KnownFace:
    """The same with other evidence of a class in a box: left, right, low, high."""
    points = known.face.patch.points()
    x, y = points[..., 0], points[..., 1]
    mean = known.evidence.mean.copy()
    mean[CLASSES.index(label)][(x > box[0]) & (x < box[1]) & (y > box[2]) & (y < box[3])] = value
    return KnownFace(known.face, replace(known.evidence, mean=mean), known.usual)


def test_map_labels_a_view(known: KnownFace) -> None:
    mask = labels(known, packed_view())
    assert mask[pixel(*ON_POST)] == POST
    assert mask[pixel(*ON_PLANK)] == PLANK
    assert mask[pixel(*BETWEEN)] == 0
    assert mask[pixel(*BEYOND)] == IGNORE


def test_edges_are_where_the_map_has_them(known: KnownFace) -> None:
    mask = labels(known, packed_view())
    row, _ = pixel(0.0, 0.5)
    columns = np.flatnonzero(mask[row] == POST)
    expected = 159.5 + SPEC.camera[0, 0] / 1.5 * np.array([-1.0, -0.9, 0.9, 1.0])
    inner = columns[columns < 160].max(), columns[columns > 160].min()
    assert np.allclose(inner, expected[[1, 2]], atol=1.0)
    assert mask[row, inner[0] + 1] == 0


def test_weak_evidence_is_not_judged(known: KnownFace) -> None:
    hidden = with_evidence(known, "plank", (-0.3, 0.3, 0.9, 1.2), 0.1)
    mask = labels(hidden, packed_view(plank=0.1))
    assert mask[pixel(*ON_PLANK)] == IGNORE
    assert mask[pixel(0.6, 1.05)] == PLANK


def test_what_the_map_lacks_is_not_background(known: KnownFace) -> None:
    more = with_evidence(known, "plank", (-0.9, 0.9, 0.45, 0.55), 0.6)
    assert labels(more, packed_view())[pixel(*BETWEEN)] == IGNORE


@pytest.mark.parametrize(("grey", "expected"), [(120, POST), (220, IGNORE)])
def test_goods_in_front_are_not_judged(known: KnownFace, grey: int, expected: int) -> None:
    """A frame that sees no post where the others do: the network missed it where it looks the same, else something is in the way."""
    assert labels(known, packed_view(post=0.05, grey=grey))[pixel(*ON_POST)] == expected


def test_unsure_sides_are_left_out(outlines: Sequence[Outline], known: KnownFace) -> None:
    wide = [replace(one, unsure_m=np.full(4, 0.02)) for one in outlines]
    unsure = KnownFace(replace(known.face, outlines=tuple(wide)), known.evidence, known.usual)
    row, _ = pixel(0.0, 0.5)
    edge = round(159.5 + SPEC.camera[0, 0] / 1.5 * 0.9)
    assert np.all(labels(unsure, packed_view())[row, edge - 1 : edge + 2] == IGNORE)
    assert labels(unsure, packed_view())[pixel(*ON_POST)] == POST


def test_what_is_seen_aslant_is_not_judged(known: KnownFace) -> None:
    assert labels(known, packed_view(), aslant=0.3)[pixel(*ON_POST)] == IGNORE
    assert labels(known, packed_view(), aslant=0.3)[pixel(0.0, 0.7)] == 0


def test_nothing_is_labelled_behind_the_camera(known: KnownFace) -> None:
    turned = pose() @ np.diag([-1.0, 1.0, -1.0, 1.0])
    assert np.all(mask_of(packed_view(), SPEC, turned, [known], CLASSES, MaskSettings()) == IGNORE)


def test_usual_evidence_is_the_outlines(known: KnownFace) -> None:
    assert known.usual == pytest.approx({"post": 0.8, "plank": 0.8}, abs=0.05)
    (lone,) = faces_of([one for one in known.face.outlines if one.label == "post"])
    assert lone.usual(known.evidence, "plank") == 0.0
