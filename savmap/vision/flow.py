"""Optical flow: corners tracked through a few neighbouring frames of a view, whatever they belong to.

Corners (Shi and Tomasi 1994) are tracked by pyramidal Lucas and Kanade (Bouguet 2000), forwards and backwards; both are
OpenCV's. On goods that look alike a corner may be taken for its neighbour's, so the solver uses flow only where the
mapped structures agree.
"""

from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.types import Flow, View, ViewSpec

WINDOW, STRIDE = 4, 2
"""Frames that a window spans, and frames from the start of one to the start of the next."""
MOST_POINTS, APART_PX, QUALITY = 200, 12, 0.01
PATCH_PX, HALVINGS = 21, 4
MOST_RETURN_PX = 0.3

Points = NDArray[np.float32]
Grey = NDArray[np.uint8]


@dataclass(eq=False)
class _Window:
    """Points in a window that begins at frame `first`: pixels (n, k, 2) in its k frames so far."""

    first: int
    pixels: Points


@dataclass(eq=False)
class _ViewState:
    """A view's last frame and grey picture, its open windows, and the flows of the complete ones."""

    spec: ViewSpec
    frame: int
    grey: Grey
    windows: list[_Window] = field(default_factory=list)
    done: list[Flow] = field(default_factory=list)


class FlowTracker:
    """Tracks points in views that come frame by frame: new points every `STRIDE` frames, each through `WINDOW`
    frames."""

    def __init__(self) -> None:
        self._states: dict[str, _ViewState] = {}

    def update(self, view: View) -> None:
        """Track to the next frame of a view. If frames before it were left out, tracking starts again."""
        grey = cv2.cvtColor(view.image, cv2.COLOR_RGB2GRAY).astype(np.uint8, copy=False)
        state = self._states.setdefault(view.spec.name, _ViewState(view.spec, view.frame, grey))
        _advance(state, grey, view.frame)
        state.frame, state.grey = view.frame, grey
        if not state.windows or view.frame - state.windows[-1].first >= STRIDE:
            corners = cv2.goodFeaturesToTrack(grey, MOST_POINTS, QUALITY, APART_PX)
            if corners is not None:
                state.windows.append(_Window(view.frame, corners.reshape(-1, 1, 2).astype(np.float32, copy=False)))

    @property
    def flows(self) -> tuple[Flow, ...]:
        """The complete windows, view by view."""
        return tuple(flow for state in self._states.values() for flow in state.done)


class NullFlowTracker(FlowTracker):
    """Tracks nothing."""

    def update(self, view: View) -> None:
        """Do nothing."""


def _advance(state: _ViewState, grey: Grey, frame: int) -> None:
    """Track all points to the next frame, and close the windows that are complete."""
    if frame != state.frame + 1:
        state.windows = []
    windows = [window for window in state.windows if len(window.pixels)]
    if not windows:
        return
    moved, good = _tracked(state.grey, grey, np.concatenate([window.pixels[:, -1] for window in windows]))
    ends = np.cumsum([len(window.pixels) for window in windows])[:-1]
    for window, pixels, kept in zip(windows, np.split(moved, ends), np.split(good, ends), strict=True):
        window.pixels = np.concatenate([window.pixels, pixels[:, None]], axis=1)[kept]
    state.done += [
        _flow_of(window, state.spec) for window in windows if window.pixels.shape[1] == WINDOW and len(window.pixels)
    ]
    state.windows = [window for window in windows if window.pixels.shape[1] < WINDOW]


def _flow_of(window: _Window, spec: ViewSpec) -> Flow:
    frames = np.arange(window.first, window.first + WINDOW, dtype=np.int64)
    return Flow(frames, spec, window.pixels.astype(np.float64))


def _tracked(before: Grey, after: Grey, points: Points) -> tuple[Points, NDArray[np.bool_]]:
    """Where points (n, 2) px move, and which (n,) return to their start when tracked back."""
    forth, forth_tracked = lucas_kanade(before, after, points)
    back, back_tracked = lucas_kanade(after, before, forth)
    return forth, forth_tracked & back_tracked & (np.linalg.norm(back - points, axis=1) < MOST_RETURN_PX)


def lucas_kanade(a: Grey, b: Grey, points: Points) -> tuple[Points, NDArray[np.bool_]]:
    """Where points of one picture are in another, and which (n,) were tracked there."""
    moved, status, _ = cv2.calcOpticalFlowPyrLK(  # type: ignore[call-overload]
        a, b, points, None, winSize=(PATCH_PX, PATCH_PX), maxLevel=HALVINGS
    )
    return moved, status.ravel() == 1
