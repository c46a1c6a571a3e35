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


@pytest.mark.parametrize("seed", range(4))
def test_where_hardly_anything_agrees_the_camera_went_on_at_about_its_distance(seed: int) -> None:
    """A sixth of what is seen agrees, by chance, on a distance a tenth larger."""
    places = corners(seed)
    moved = np.concatenate([0.91 * places[::6] + [-0.12, 0.0], corners(100 + seed)])
    second = FrameObservations(moved, np.concatenate([KINDS[::6], KINDS]))
    (step,) = steps_between([FrameObservations(places, KINDS), second], np.array([0.2]))
    assert step[0] == pytest.approx(1.0, abs=0.041)


@pytest.mark.parametrize("seed", range(3))
def test_nobody_leaps_towards_the_face_in_a_single_step(seed: int) -> None:
    """Half of what is seen agrees on a distance a tenth larger in the fourth of six steps; in the others all agree on none."""
    places = [corners(seed) - [0.2 * k, 0.0] for k in range(4)]
    leapt = np.concatenate([0.9 * places[3][::2] + [-0.12, 0.0], corners(100 + seed)[::2]])
    places += [leapt - [0.2 * k, 0.0] for k in range(3)]
    kinds = [KINDS] * 4 + [np.concatenate([KINDS[::2], KINDS[::2]])] * 3
    steps = steps_between([FrameObservations(*view) for view in zip(places, kinds, strict=True)], np.full(6, 0.2))
    assert steps[:, 0] == pytest.approx(np.ones(6), abs=0.03)
    alone = steps_between(
        [FrameObservations(places[3], KINDS), FrameObservations(places[4], kinds[4])], np.array([0.2])
    )
    assert alone[0, 0] == pytest.approx(0.9, abs=0.03)
