"""The way from frame to frame: what two views of the face agree on, and nothing where they do not."""

import numpy as np
import pytest

from savmap_shelves.tracking.odometry import FrameObservations, steps_between

KINDS = np.repeat([2, 3, 4, 5], 20)


def corners(seed: int) -> np.ndarray:
    """Corners of beams all over the face (80, 2), as tangents."""
    return np.random.default_rng(seed).uniform([-3.0, -2.0], [3.0, 2.0], (80, 2))


def test_a_step_is_what_most_things_agree_on() -> None:
    places = corners(1)
    first, second = FrameObservations(places, KINDS), FrameObservations(1.03 * places + [-0.2, 0.01], KINDS)
    ((ratio, slide, rise),) = steps_between([first, second], np.array([0.2]))
    assert ratio == pytest.approx(1.03, abs=0.003)
    assert [slide, rise] == pytest.approx([-0.2, 0.01], abs=0.01)
