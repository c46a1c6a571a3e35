"""The interface of what cuts parts from a row's frames, and several cutters as one."""

from collections.abc import Sequence
from typing import Protocol

import cv2
import numpy as np

from savmap.pipeline.view_plans import PassPlan
from savmap.types import Panorama, Still, Strip
from savmap.vision.evidence import PackedView

Cut = Strip | Still | PackedView


class StripCutter(Protocol):
    """Cuts parts from the frames of a row's passes."""

    def begin(self, plan: PassPlan, plugin: str | None) -> None:
        """Begin a pass. `plugin` is the one whose views show the face; None if no plugin's do."""
        ...

    def cut(self, panorama: Panorama) -> list[Cut]:
        """What is kept of a frame of this pass. Several threads may call this at once."""
        ...


class SeveralCutters:
    """Cuts what each of several cutters cuts."""

    def __init__(self, cutters: Sequence[StripCutter]) -> None:
        self._cutters = cutters

    def begin(self, plan: PassPlan, plugin: str | None) -> None:
        for cutter in self._cutters:
            cutter.begin(plan, plugin)

    def cut(self, panorama: Panorama) -> list[Cut]:
        return [cut for cutter in self._cutters for cut in cutter.cut(panorama)]


class NoStrips:
    """Cuts nothing."""

    def begin(self, plan: PassPlan, plugin: str | None) -> None:
        """Nothing."""

    def cut(self, panorama: Panorama) -> list[Cut]:
        """Nothing."""
        return []


def packed_jpeg(
    image: "np.ndarray[tuple[int, ...], np.dtype[np.uint8]]", quality: int
) -> "np.ndarray[tuple[int, ...], np.dtype[np.uint8]]":
    """The bytes (n,) of an RGB picture as JPEG."""
    return np.asarray(cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])[1]).ravel()
