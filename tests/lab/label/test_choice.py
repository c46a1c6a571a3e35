"""Which views are worth labelling."""

import cv2
import numpy as np

from savmap.lab.label.worth import SeenView, chosen, descriptor, disagreement, ranks, seen_view, uncertainty

HEIGHT, WIDTH = 240, 320


def bar(left: int, soft: float = 0.0) -> np.ndarray:
    """Probabilities (2, h, w) of a bar 40 px wide; `soft` makes them less sure."""
    maps = np.full((2, HEIGHT, WIDTH), 0.01, np.float32)
    maps[1, :, left : left + 40] = 0.99 - soft
    maps[0] = 1 - maps[1]
    return maps


def textured() -> np.ndarray:
    coarse = np.random.default_rng(2).integers(0, 255, (24, 40, 3)).astype(np.uint8)
    return cv2.resize(coarse, (400, HEIGHT), interpolation=cv2.INTER_CUBIC)


def test_uncertainty_is_of_borders_alone() -> None:
    assert uncertainty(bar(100)) < 0.15
    assert uncertainty(bar(100, soft=0.35)) > 2 * uncertainty(bar(100))
    assert uncertainty(np.stack([np.ones((9, 9)), np.zeros((9, 9))]).astype(np.float32)) == 0


def test_a_bar_that_moves_with_the_picture_is_no_disagreement() -> None:
    scene = textured()
    here, there = scene[:, 20:340], scene[:, 26:346]
    before, with_it, without = (
        seen_view(here, bar(100)),
        seen_view(there, bar(94)),
        seen_view(there, np.roll(bar(0), 9, axis=2)),
    )
    assert disagreement(before, with_it) < 0.1
    assert disagreement(before, without) > 0.5
    assert disagreement(before, SeenView(np.zeros_like(before.classes), with_it.grey)) > 0.9


def test_descriptor_tells_views_apart() -> None:
    scene = textured()
    one, same, other = scene[:, :320], scene[:, 1:321], scene[:, :320][:, ::-1].copy()
    first = descriptor(one, bar(100))
    assert np.linalg.norm(first - descriptor(same, bar(99))) < 0.3 * np.linalg.norm(first - descriptor(other, bar(200)))


def test_the_most_promising_first_then_what_is_unlike_it() -> None:
    features = np.array([[0.0], [0.1], [0.2], [5.0], [5.1]])
    worth = np.array([0.5, 1.0, 0.9, 0.1, 0.2])
    assert chosen(worth, features, 1) == [1]
    assert chosen(worth, features, 2) == [1, 4]
    assert chosen(worth, features, 9) == [0, 1, 2, 3, 4]


def test_what_looks_the_same_is_taken_once() -> None:
    assert chosen(np.ones(4), np.zeros((4, 2)), 3) == [0]
    assert chosen(np.empty(0), np.empty((0, 2)), 3) == []


def test_ranks() -> None:
    assert ranks(np.array([3.0, 1.0, 3.0, 2.0])).tolist() == [1, 0, 1, 0.5]
    assert ranks(np.array([7.0])).tolist() == [0]
