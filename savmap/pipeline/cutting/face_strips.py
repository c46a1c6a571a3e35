"""Strips: narrow upright views straight at the face, at the panorama's own resolution.

Networks use wide views of few pixels. An orthophoto needs the opposite: of each frame only what is near and in front.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from savmap.geometry import pinhole
from savmap.pipeline.cutting.cutter import Cut, packed_jpeg
from savmap.pipeline.view_plans import PassPlan
from savmap.types import Panorama, Strip, ViewSpec
from savmap.video.reader import expected_frames, probe
from savmap.vision.views import Renderer

HFOV_DEG = 50.0
"""A strip is 0.9 of the distance to the face wide: neighbours overlap even where frames are few."""
MOST_HEIGHT_PX = 2000
MOST_STRIPS = 240
"""Of a pass: one every 0.25 m of 60 m."""
JPEG_QUALITY = 88


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
            Strip(panorama.frame, spec.name, packed_jpeg(self._renderer.render(panorama, spec).image, JPEG_QUALITY))
            for spec in sorted(self._current, key=lambda spec: spec.name)
            if spec.shows(panorama.frame)
        ]


def strip_views(plan: PassPlan, plugin: str) -> Iterator[ViewSpec]:
    """The narrow middle of each of a plugin's views of a pass.

    Its resolution is the panorama's, up to `MOST_HEIGHT_PX` rows. Its frames are at most `MOST_STRIPS` of the view's
    own.
    """
    info = probe(plan.clip.path, plan.clip.images_fps)
    frames = expected_frames(plan.clip, info)
    for (owner, name), spec in plan.views().items():
        if owner != plugin:
            continue
        steepness = spec.height / 2 / pinhole.focal_px(spec.hfov_deg, spec.width)
        focal = min(info.height / np.pi, MOST_HEIGHT_PX / 2 / steepness)
        half = np.tan(np.radians(min(HFOV_DEG, spec.hfov_deg)) / 2)
        width, height = max(round(2 * focal * half), 2), max(round(2 * focal * steepness), 2)
        frame_step = spec.every * max(1, -(-frames // (spec.every * MOST_STRIPS)))
        hfov_deg = float(np.degrees(2 * np.arctan(width / 2 / focal)))
        strip_name = f"{plan.name} / {name}, strip"
        yield replace(spec, name=strip_name, hfov_deg=hfov_deg, width=width, height=height, every=frame_step)
