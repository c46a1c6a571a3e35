"""Points are followed to where the picture moves, through whole windows only; what does not come back is dropped."""

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.types import View, ViewSpec
from savmap.vision.flow import STRIDE, WINDOW, FlowTracker, NullFlowTracker

SPEC = ViewSpec("face", 0.0, hfov_deg=90.0, width=320, height=240)
STEP = np.array([4.0, -2.0])


def wall() -> NDArray[np.uint8]:
    rough = np.random.default_rng(3).integers(0, 255, (320, 400, 3)).astype(np.uint8)
    return cv2.GaussianBlur(rough, (0, 0), 2.0).astype(np.uint8)


def view(frame: int, steps: int) -> View:
    """The wall, moved by `steps` steps."""
    left, top = (np.array([40, 40]) - steps * STEP).astype(int)
    return View(SPEC, frame, frame / 15, np.ascontiguousarray(wall()[top : top + 240, left : left + 320]))


def test_points_go_as_the_picture_goes() -> None:
    tracker = FlowTracker()
    for frame in range(WINDOW + STRIDE):
        tracker.update(view(frame, frame))
    first, second = tracker.flows
    assert first.frames.tolist() == list(range(WINDOW))
    assert second.frames[0] == STRIDE
    assert len(first.pixels) > 50
    assert np.abs(np.diff(first.pixels, axis=1) - STEP).max() < 0.3
    assert np.median(np.abs(np.diff(first.pixels, axis=1) - STEP)) < 0.05


def test_a_frame_that_was_left_out_begins_anew() -> None:
    for tracker, frames in ((FlowTracker(), (0, 1, 2, 4, 5, 6)), (NullFlowTracker(), range(WINDOW))):
        for frame in frames:
            tracker.update(view(frame, frame))
        assert tracker.flows == ()


def test_what_shows_something_else_in_between_is_dropped() -> None:
    tracker = FlowTracker()
    for frame in range(WINDOW):
        shown = view(frame, frame)
        if frame == 2:
            image = shown.image.copy()
            image[:, :160] = np.random.default_rng(4).integers(0, 255, (240, 160, 3))
            shown = replace(shown, image=image)
        tracker.update(shown)
    (flow,) = tracker.flows
    assert len(flow.pixels) > 20
    assert (flow.pixels[:, 2, 0] > 140).all()
