"""The interface of what cuts parts from a row's frames, and several cutters as one."""

from collections.abc import Sequence
from typing import Protocol

import cv2
import numpy as np

from savmap.pipeline.view_plans import PassPlan
from savmap.types import Panorama, RowStrips


class StripCutter(Protocol):
    """Cuts strips from the frames of a row's passes."""

    def begin(self, plan: PassPlan, plugin: str | None) -> None:
        """Begin a pass. `plugin` is the one whose views show the face; None if no plugin's do."""
        ...

    def cut(self, panorama: Panorama) -> None:
        """Cut a frame of this pass, if it is one of those to keep. Several threads may call this at once."""
        ...

    def strips(self) -> RowStrips:
        """All that was cut."""
        ...


class SeveralCutters:
    """Cuts what each of several cutters cuts."""

    def __init__(self, cutters: Sequence[StripCutter]) -> None:
        self._cutters = cutters

    def begin(self, plan: PassPlan, plugin: str | None) -> None:
        for cutter in self._cutters:
            cutter.begin(plan, plugin)

    def cut(self, panorama: Panorama) -> None:
        for cutter in self._cutters:
            cutter.cut(panorama)

    def strips(self) -> RowStrips:
        parts = [cutter.strips() for cutter in self._cutters]
        views = {name: spec for part in parts for name, spec in part.views.items()}
        strips = tuple(strip for part in parts for strip in part.strips)
        return RowStrips(views, strips, tuple(still for part in parts for still in part.stills))


class NoStrips:
    """Cuts nothing."""

    def begin(self, plan: PassPlan, plugin: str | None) -> None:
        """Nothing."""

    def cut(self, panorama: Panorama) -> None:
        """Nothing."""

    def strips(self) -> RowStrips:
        """None."""
        return RowStrips()


def packed_jpeg(
    image: "np.ndarray[tuple[int, ...], np.dtype[np.uint8]]", quality: int
) -> "np.ndarray[tuple[int, ...], np.dtype[np.uint8]]":
    """The bytes (n,) of an RGB picture as JPEG."""
    return np.asarray(cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])[1]).ravel()
