"""Appearance: points of any kind followed through a few neighbouring frames of a view.

Corners (Shi and Tomasi 1994) by pyramidal Lucas and Kanade (Bouguet 2000), forwards and backwards; OpenCV's. Nobody asks what
the points belong to: on look-alike goods a corner may be taken for its neighbour's, so what they say is only used where the
mapped structures agree (`savmap.graph.factors.appearance`).
"""

from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.types import Flow, View, ViewSpec

WINDOW, STRIDE = 4, 2
MOST_POINTS, APART_PX, QUALITY = 200, 12, 0.01
PATCH_PX, HALVINGS = 21, 4
BACK_PX = 0.3

Points = NDArray[np.float32]
Grey = NDArray[np.uint8]


@dataclass
class _Run:
    """Points on their way through a window: pixels (n, k, 2) in the k frames so far."""

    first: int
    pixels: Points


@dataclass
class _Eye:
    """What is remembered of a view: its last frame and picture, the windows under way and those that are done."""

    spec: ViewSpec
    frame: int
    grey: Grey
    runs: list[_Run] = field(default_factory=list)
    done: list[Flow] = field(default_factory=list)


class FlowWatch:
    """Follows points in views that come frame by frame: every `STRIDE` frames new ones, each through `WINDOW` frames."""

    def __init__(self) -> None:
        self._eyes: dict[str, _Eye] = {}

    def look(self, view: View) -> None:
        """Look at the next frame of a view; where frames before it were left out, points begin anew."""
        grey = cv2.cvtColor(view.image, cv2.COLOR_RGB2GRAY).astype(np.uint8, copy=False)
        eye = self._eyes.setdefault(view.spec.name, _Eye(view.spec, view.frame, grey))
        _go_on(eye, grey, view.frame)
        eye.frame, eye.grey = view.frame, grey
        if not eye.runs or view.frame - eye.runs[-1].first >= STRIDE:
            corners = cv2.goodFeaturesToTrack(grey, MOST_POINTS, QUALITY, APART_PX)
            if corners is not None:
                eye.runs.append(_Run(view.frame, corners.reshape(-1, 1, 2).astype(np.float32, copy=False)))

    @property
    def flows(self) -> tuple[Flow, ...]:
        """The windows that are done, view by view."""
        return tuple(one for eye in self._eyes.values() for one in eye.done)


class NoFlow(FlowWatch):
    """Follows nothing."""

    def look(self, view: View) -> None:
        """Leave the frame alone."""


def _go_on(eye: _Eye, grey: Grey, frame: int) -> None:
    """Follow all points to the next frame; windows that are full are done."""
    if frame != eye.frame + 1:
        eye.runs = []
    runs = [run for run in eye.runs if len(run.pixels)]
    if not runs:
        return
    moved, good = _moved(eye.grey, grey, np.concatenate([run.pixels[:, -1] for run in runs]))
    ends = np.cumsum([len(run.pixels) for run in runs])[:-1]
    for run, ahead, kept in zip(runs, np.split(moved, ends), np.split(good, ends), strict=True):
        run.pixels = np.concatenate([run.pixels, ahead[:, None]], axis=1)[kept]
    eye.done += [_finished(run, eye.spec) for run in runs if run.pixels.shape[1] == WINDOW and len(run.pixels)]
    eye.runs = [run for run in runs if run.pixels.shape[1] < WINDOW]


def _finished(run: _Run, spec: ViewSpec) -> Flow:
    frames = np.arange(run.first, run.first + WINDOW, dtype=np.int64)
    return Flow(frames, spec, run.pixels.astype(np.float64))


def _moved(before: Grey, after: Grey, points: Points) -> tuple[Points, NDArray[np.bool_]]:
    """Where points (n, 2) px go, and which (n,) come back to where they were."""
    ahead, found = _flow(before, after, points)
    back, again = _flow(after, before, ahead)
    return ahead, found & again & (np.linalg.norm(back - points, axis=1) < BACK_PX)


def _flow(a: Grey, b: Grey, points: Points) -> tuple[Points, NDArray[np.bool_]]:
    moved, found, _ = cv2.calcOpticalFlowPyrLK(a, b, points, None, winSize=(PATCH_PX, PATCH_PX), maxLevel=HALVINGS)  # type: ignore[call-overload] # fmt: skip
    return moved, found.ravel() == 1
