"""Stills: whole panoramas of some frames, smaller."""

from collections.abc import Sequence

import cv2
import numpy as np

from savmap.pipeline.cutting.cutter import Cut, packed_jpeg
from savmap.pipeline.view_plans import PassPlan
from savmap.types import FilmedPanorama, Panorama, Still, Trajectory
from savmap.video.reader import expected_frames, probe

STILL_HEIGHT_PX, STILL_QUALITY = 1024, 80
"""A degree is 6 pixels, about the resolution of a panorama in a browser's window."""
STILL_S, MOST_STILLS = 0.7, 80
"""Interval and most stills of a pass: one every 0.7 m at a walking pace. Of these, `spaced_stills` keeps those
`STILL_M` apart."""
STILL_M = 0.8


class Stills:
    """Keeps whole panoramas of some frames, smaller."""

    def __init__(self) -> None:
        self._frame_step = 1

    def begin(self, plan: PassPlan, plugin: str | None) -> None:
        info = probe(plan.clip.path, plan.clip.images_fps)
        rate = min(plan.clip.fps, info.rate_fps) if info.rate_fps > 0 else plan.clip.fps
        self._frame_step = max(round(STILL_S * rate), -(-expected_frames(plan.clip, info) // MOST_STILLS), 1)

    def cut(self, panorama: Panorama) -> list[Cut]:
        if panorama.frame % self._frame_step:
            return []
        return [Still(panorama.frame, packed_jpeg(reduced(panorama, STILL_HEIGHT_PX), STILL_QUALITY))]


def reduced(panorama: Panorama, height: int) -> "np.ndarray[tuple[int, ...], np.dtype[np.uint8]]":
    """A panorama's RGB (height, 2 * height, 3); at its own height where that is less."""
    size = 2 * min(height, panorama.height), min(height, panorama.height)
    if not isinstance(panorama, FilmedPanorama):
        return np.asarray(cv2.resize(panorama.image, size, interpolation=cv2.INTER_AREA), np.uint8)
    planes = panorama.planes
    parts = [cv2.resize(plane, size, interpolation=cv2.INTER_AREA) for plane in (planes.luma, planes.blue, planes.red)]
    return planes.coloured(np.asarray(cv2.merge(parts), np.uint8))


def spaced_stills(stills: Sequence[Still], path: Trajectory) -> tuple[Still, ...]:
    """The stills of frames whose pose is known, without those closer than `STILL_M` to the last one kept. `path` is in
    metres."""
    positions = dict(zip(path.frames.tolist(), path.world_from_rig[:, :3, 3], strict=True))
    kept: list[Still] = []
    for still in stills:
        position = positions.get(still.frame)
        if position is not None and (not kept or np.linalg.norm(position - positions[kept[-1].frame]) >= STILL_M):
            kept.append(still)
    return tuple(kept)
