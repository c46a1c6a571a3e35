"""Parts of a row's frames that are kept during the first pass over the video, for use when the camera's path is known:
strips of the face, whole panoramas, and views of the floor. A second pass over the video would cost the time to decode
it again.

Networks use wide views of few pixels. An orthophoto needs the opposite: of each frame only what is near and in front,
in narrow upright views at the panorama's own resolution.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.geometry import pinhole
from savmap.pipeline.view_plans import PassPlan
from savmap.types import FilmedPanorama, Floats, Panorama, Still, Strip, Trajectory, ViewSpec
from savmap.video.reader import probe_clip
from savmap.vision.evidence import PackedView
from savmap.vision.view_planning import face_at, tilted
from savmap.vision.views import Renderer

Cut = Strip | Still | PackedView
Bytes = NDArray[np.uint8]
STRIP_HFOV_DEG = 50.0
"""A strip is 0.9 of the distance to the face wide: neighbours overlap even where frames are few."""
MOST_HEIGHT_PX, STRIP_QUALITY = 2000, 88
FLOOR_PITCH_DEG, FLOOR_HFOV_DEG = -50.0, 110.0
"""The view covers the floor from the face's foot to beside the camera, and as far to both sides."""
FLOOR_QUALITY = 92
"""The quality is high, because concrete has only faint stains."""
STILL_HEIGHT_PX, STILL_QUALITY = 1024, 80
"""A degree is 6 pixels, about the resolution of a panorama in a browser's window."""
STILL_EVERY, STILL_M = 2, 0.8
"""Frames from a still to the next. Of these, `spaced_stills` keeps those so far apart."""


class StripCutter(Protocol):
    """Cuts parts from the frames of a row's passes."""

    def begin(self, plan: PassPlan, plugin: str | None) -> None:
        """Begin a pass. `plugin` is the one whose views show the face; None if no plugin's do."""
        ...

    def cut(self, panorama: Panorama) -> list[Cut]:
        """What is kept of a frame of this pass. Several threads may call this at once."""
        ...


class FaceStrips:
    """Cuts upright strips in the directions of the face's views."""

    def __init__(self, renderer: Renderer) -> None:
        self._renderer = renderer
        self._current: tuple[ViewSpec, ...] = ()
        self.views: dict[str, ViewSpec] = {}

    def begin(self, plan: PassPlan, plugin: str | None) -> None:
        self._current = tuple(strip_views(plan, plugin)) if plugin is not None else ()
        self.views |= {spec.name: spec for spec in self._current}

    def cut(self, panorama: Panorama) -> list[Cut]:
        return [
            Strip(panorama.frame, spec.name, packed_jpeg(self._renderer.render(panorama, spec).image, STRIP_QUALITY))
            for spec in sorted(self._current, key=lambda spec: spec.name)
            if spec.shows(panorama.frame)
        ]


def strip_views(plan: PassPlan, plugin: str) -> Iterator[ViewSpec]:
    """The narrow middle of each of a plugin's views of a pass.

    Its resolution is the panorama's, up to `MOST_HEIGHT_PX` rows.
    """
    info = probe_clip(plan.clip)
    for (of_plugin, name), spec in plan.views().items():
        if of_plugin != plugin:
            continue
        steepness = spec.height / 2 / pinhole.focal_px(spec.hfov_deg, spec.width)
        focal = min(info.height / np.pi, MOST_HEIGHT_PX / 2 / steepness)
        half = np.tan(np.radians(min(STRIP_HFOV_DEG, spec.hfov_deg)) / 2)
        width, height = max(round(2 * focal * half), 2), max(round(2 * focal * steepness), 2)
        hfov_deg = float(np.degrees(2 * np.arctan(width / 2 / focal)))
        strip_name = f"{plan.name} / {name}, strip"
        yield replace(spec, name=strip_name, hfov_deg=hfov_deg, width=width, height=height)


class FloorCutter:
    """Keeps grey views of the floor in front of the face."""

    def __init__(self, renderer: Renderer) -> None:
        self._renderer = renderer
        self._current: ViewSpec | None = None
        self.views: dict[str, ViewSpec] = {}

    def begin(self, plan: PassPlan, plugin: str | None) -> None:
        attitude = plan.attitude()
        self._current = None
        if plugin is not None and attitude is not None:
            self._current = floor_view(plan, plugin, attitude)
            self.views[self._current.name] = self._current

    def cut(self, panorama: Panorama) -> list[Cut]:
        if self._current is None or not self._current.shows(panorama.frame):
            return []
        grey = cv2.cvtColor(self._renderer.render(panorama, self._current).image, cv2.COLOR_RGB2GRAY)
        packed = bytes(cv2.imencode(".jpg", grey, [cv2.IMWRITE_JPEG_QUALITY, FLOOR_QUALITY])[1])
        return [PackedView(panorama.frame, self._current.name, (), packed)]


def floor_view(plan: PassPlan, plugin: str, world_from_rig: Floats) -> ViewSpec:
    """The view down to the floor in front of the face, by the rig's attitude (3, 3) at the start of a pass, in the
    frames in which the plugin has views of the face: others get no pose."""
    every = max((spec.every for spec in plan.plans[plugin].views), default=1)
    spec = tilted(face_at(world_from_rig), FLOOR_PITCH_DEG, FLOOR_HFOV_DEG, f"{plan.name} / floor")
    return replace(spec, every=every)


class Stills:
    """Keeps whole panoramas of some frames, smaller."""

    def begin(self, plan: PassPlan, plugin: str | None) -> None:
        pass

    def cut(self, panorama: Panorama) -> list[Cut]:
        if panorama.frame % STILL_EVERY:
            return []
        return [Still(panorama.frame, packed_jpeg(reduced(panorama, STILL_HEIGHT_PX), STILL_QUALITY))]


def reduced(panorama: Panorama, height: int) -> Bytes:
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


def packed_jpeg(image: Bytes, quality: int) -> Bytes:
    """The bytes (n,) of an RGB picture as JPEG."""
    return np.asarray(cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])[1]).ravel()
