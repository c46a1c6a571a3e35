"""Pictures kept while a row's frames go by: strips, what each frame shows straight ahead of the face at the panorama's own resolution;
stills, whole panoramas of some of them, smaller; and the floor before the face.

Networks look at wide views of few pixels. An orthophoto wants the opposite: of each frame only what is near and in front. The
camera's path is known when the frames are long gone, and decoding them twice would take twice as long.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from threading import Lock
from typing import Protocol

import cv2
import numpy as np

from savmap.geometry import pinhole
from savmap.pipeline.view_plans import PassPlan
from savmap.types import FilmedPanorama, Floats, Panorama, RowStrips, Still, Strip, Trajectory, ViewSpec
from savmap.video.reader import expected_frames, probe
from savmap.vision.evidence import Look
from savmap.vision.view_planning import face_at, tilted
from savmap.vision.views import Renderer

HFOV_DEG = 50.0
"""Shows 0.9 of the distance to the face: neighbours overlap even where frames are few."""
MOST_HEIGHT_PX = 2000
MOST_STRIPS = 240
"""Of a pass: one every 0.25 m of 60 m."""
JPEG_QUALITY = 88
STILL_HEIGHT_PX, STILL_QUALITY = 1024, 80
"""A degree is 6 pixels: what a browser's window shows of a panorama is about as fine."""
STILL_S, MOST_STILLS = 0.7, 80
"""Of a pass: one every 0.7 m at a walking pace, before those that stand closer than `STILL_M` are left out."""
STILL_M = 0.8
FLOOR_PITCH_DEG, FLOOR_HFOV_DEG = -50.0, 110.0
"""Shows the floor from the face's foot to beside the camera, and as far to both sides."""
FLOOR_QUALITY = 92
"""Concrete shows little but faint stains."""
MOST_FLOORS = 240


class StripCutter(Protocol):
    """Cuts strips from the frames of a row's passes."""

    def begin(self, plan: PassPlan, plugin: str | None) -> None:
        """A pass begins, whose views of the face are those that a plugin planned; None: nobody's."""
        ...

    def cut(self, panorama: Panorama) -> None:
        """Cut a frame of this pass, if it is its turn. Several threads may do this at once."""
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


class FaceStrips:
    """Cuts upright strips in the directions of the face's views."""

    def __init__(self, renderer: Renderer) -> None:
        self._renderer, self._lock = renderer, Lock()
        self._current: tuple[ViewSpec, ...] = ()
        self._views: dict[str, ViewSpec] = {}
        self._cut: list[Strip] = []

    def begin(self, plan: PassPlan, plugin: str | None) -> None:
        self._current = tuple(strip_views(plan, plugin)) if plugin is not None else ()
        self._views |= {spec.name: spec for spec in self._current}

    def cut(self, panorama: Panorama) -> None:
        for spec in self._current:
            if spec.shows(panorama.frame):
                strip = Strip(panorama.frame, spec.name, _packed(self._renderer.render(panorama, spec).image))
                with self._lock:
                    self._cut.append(strip)

    def strips(self) -> RowStrips:
        return RowStrips(self._views, tuple(sorted(self._cut, key=lambda strip: (strip.frame, strip.view))))


class Stills:
    """Keeps whole panoramas of some frames, smaller."""

    def __init__(self) -> None:
        self._lock, self._every = Lock(), 1
        self._kept: list[Still] = []

    def begin(self, plan: PassPlan, plugin: str | None) -> None:
        info = probe(plan.clip.path, plan.clip.images_fps)
        rate = min(plan.clip.fps, info.rate_fps) if info.rate_fps > 0 else plan.clip.fps
        self._every = max(round(STILL_S * rate), -(-expected_frames(plan.clip, info) // MOST_STILLS), 1)

    def cut(self, panorama: Panorama) -> None:
        if panorama.frame % self._every == 0:
            still = Still(panorama.frame, _packed(reduced(panorama, STILL_HEIGHT_PX), STILL_QUALITY))
            with self._lock:
                self._kept.append(still)

    def strips(self) -> RowStrips:
        return RowStrips(stills=tuple(sorted(self._kept, key=lambda still: still.frame)))


class FloorCutter:
    """Keeps grey views of the floor before the face."""

    def __init__(self, renderer: Renderer) -> None:
        self._renderer, self._lock = renderer, Lock()
        self._current: ViewSpec | None = None
        self._kept: list[Look] = []
        self.views: dict[str, ViewSpec] = {}

    @property
    def looks(self) -> tuple[Look, ...]:
        """What was kept, in order of time."""
        return tuple(sorted(self._kept, key=lambda look: look.frame))

    def begin(self, plan: PassPlan, plugin: str | None) -> None:
        attitude = plan.attitude()
        self._current = None
        if plugin is not None and attitude is not None:
            self._current = floor_view(plan, plugin, attitude)
            self.views[self._current.name] = self._current

    def cut(self, panorama: Panorama) -> None:
        if self._current is not None and self._current.shows(panorama.frame):
            grey = cv2.cvtColor(self._renderer.render(panorama, self._current).image, cv2.COLOR_RGB2GRAY)
            packed = bytes(cv2.imencode(".jpg", grey, [cv2.IMWRITE_JPEG_QUALITY, FLOOR_QUALITY])[1])
            with self._lock:
                self._kept.append(Look(panorama.frame, self._current.name, (), packed))

    def strips(self) -> RowStrips:
        """None: what is kept is looked at long before the map is drawn."""
        return RowStrips()


def floor_view(plan: PassPlan, plugin: str, world_from_rig: Floats) -> ViewSpec:
    """The view down to the floor before the face, by the rig's attitude (3, 3) at the start of a pass: of as many as are needed of the frames in
    which the plugin looks at the face, for where the others were taken is not known."""
    every = max((spec.every for spec in plan.plans[plugin].views), default=1)
    frames = expected_frames(plan.clip, probe(plan.clip.path, plan.clip.images_fps))
    spec = tilted(face_at(world_from_rig), FLOOR_PITCH_DEG, FLOOR_HFOV_DEG, f"{plan.name} / floor")
    return replace(spec, every=every * max(1, -(-frames // (every * MOST_FLOORS))))


def reduced(panorama: Panorama, height: int) -> "np.ndarray[tuple[int, ...], np.dtype[np.uint8]]":
    """A panorama's RGB at so many pixels of height, or at its own, where those are fewer."""
    size = 2 * min(height, panorama.height), min(height, panorama.height)
    if not isinstance(panorama, FilmedPanorama):
        return np.asarray(cv2.resize(panorama.image, size, interpolation=cv2.INTER_AREA), np.uint8)
    planes = panorama.planes
    parts = [cv2.resize(plane, size, interpolation=cv2.INTER_AREA) for plane in (planes.luma, planes.blue, planes.red)]
    return planes.coloured(np.asarray(cv2.merge(parts), np.uint8))


def apart(stills: Sequence[Still], path: Trajectory) -> tuple[Still, ...]:
    """The stills of frames whose place is known, but for those that were taken closer than `STILL_M` to the last one."""
    places = dict(zip(path.frames.tolist(), path.world_from_rig[:, :3, 3], strict=True))
    kept: list[Still] = []
    for still in stills:
        place = places.get(still.frame)
        if place is not None and (not kept or np.linalg.norm(place - places[kept[-1].frame]) >= STILL_M):
            kept.append(still)
    return tuple(kept)


def strip_views(plan: PassPlan, plugin: str) -> Iterator[ViewSpec]:
    """The narrow middle of each of a plugin's views of a pass, as fine as the panorama where that is not too many pixels, of so many
    frames as are needed."""
    info = probe(plan.clip.path, plan.clip.images_fps)
    frames = expected_frames(plan.clip, info)
    for (owner, name), spec in plan.views().items():
        if owner != plugin:
            continue
        steepness = spec.height / 2 / pinhole.focal_px(spec.hfov_deg, spec.width)
        focal = min(info.height / np.pi, MOST_HEIGHT_PX / 2 / steepness)
        half = np.tan(np.radians(min(HFOV_DEG, spec.hfov_deg)) / 2)
        width, height = max(round(2 * focal * half), 2), max(round(2 * focal * steepness), 2)
        every = spec.every * max(1, -(-frames // (spec.every * MOST_STRIPS)))
        hfov_deg = float(np.degrees(2 * np.arctan(width / 2 / focal)))
        named = f"{plan.name} / {name}, strip"
        yield replace(spec, name=named, hfov_deg=hfov_deg, width=width, height=height, every=every)


def _packed(
    image: "np.ndarray[tuple[int, ...], np.dtype[np.uint8]]", quality: int = JPEG_QUALITY
) -> "np.ndarray[tuple[int, ...], np.dtype[np.uint8]]":
    return np.asarray(cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])[1]).ravel()
