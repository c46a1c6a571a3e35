"""How far outlines lie beside what a network sees: found where all objects of a view tell the same, and where enough more is seen there."""

import cv2
import numpy as np
import pytest

from savmap.types import Expected, Floats
from savmap.vision.evidence import drift_of
from savmap.vision.networks.segmenter import Segmentation

SIZE = (640, 480)


def stripe(x: tuple[float, float], y: tuple[float, float]) -> Floats:
    return np.array([[x[0], y[0]], [x[1], y[0]], [x[1], y[1]], [x[0], y[1]]])


POST, BEAM = stripe((300, 307), (40, 460)), stripe((100, 560), (200, 206))
OUTLINES = [(Expected("post", np.zeros((4, 3))), POST), (Expected("beam", np.zeros((4, 3))), BEAM)]


def seen_at(*, post: tuple[float, float], beam: tuple[float, float], probability: float = 0.9) -> Segmentation:
    """What a network sees of a post and a beam, each moved by so much."""
    maps = np.zeros((3, SIZE[1], SIZE[0]), np.float32)
    for values, outline, moved in ((maps[1], POST, post), (maps[2], BEAM, beam)):
        cv2.fillPoly(values, [np.round(outline + moved).astype(np.int32)], probability)
    maps[0] = 1 - maps[1:].max(axis=0)
    return Segmentation(("post", "beam"), maps)


@pytest.mark.parametrize("drift", [(6.0, -4.0), (-9.0, 0.0), (0.0, 8.0)])
def test_outlines_that_all_lie_beside_what_is_seen_are_moved_there(drift: tuple[float, float]) -> None:
    assert drift_of(seen_at(post=drift, beam=drift), OUTLINES) == pytest.approx(drift, abs=2.0)


def test_outlines_that_lie_on_what_is_seen_stay() -> None:
    assert drift_of(seen_at(post=(0, 0), beam=(0, 0)), OUTLINES).tolist() == [0, 0]
    assert drift_of(seen_at(post=(1, 1), beam=(1, 1)), OUTLINES).tolist() == [0, 0]


def test_an_upright_alone_tells_no_drift_along_it() -> None:
    segmentation = seen_at(post=(7, 0), beam=(0, 200))
    assert drift_of(segmentation, OUTLINES[:1]) == pytest.approx([7, 0], abs=1.0)


def test_what_is_seen_too_far_away_is_something_else() -> None:
    assert drift_of(seen_at(post=(40, 0), beam=(0, 40)), OUTLINES).tolist() == [0, 0]


def test_nothing_is_moved_where_nothing_is_expected_or_seen() -> None:
    assert drift_of(seen_at(post=(6, 6), beam=(6, 6)), []).tolist() == [0, 0]
    assert drift_of(seen_at(post=(6, 6), beam=(6, 6), probability=0.0), OUTLINES).tolist() == [0, 0]
