"""Grey views of the floor in front of the face. The camera's height is measured in them
(`savmap.vision.evidence.floor`)."""

from dataclasses import replace

import cv2

from savmap.pipeline.cutting.cutter import Cut
from savmap.pipeline.view_plans import PassPlan
from savmap.types import Floats, Panorama, ViewSpec
from savmap.video.reader import expected_frames, probe
from savmap.vision.evidence import PackedView
from savmap.vision.view_planning import face_at, tilted
from savmap.vision.views import Renderer

FLOOR_PITCH_DEG, FLOOR_HFOV_DEG = -50.0, 110.0
"""The view covers the floor from the face's foot to beside the camera, and as far to both sides."""
FLOOR_QUALITY = 92
"""High, because concrete has only faint stains."""
MOST_FLOORS = 240


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
    """The view down to the floor in front of the face, by the rig's attitude (3, 3) at the start of a pass.

    Its frames are at most `MOST_FLOORS` of those in which the plugin has views of the face: other frames get no pose.
    """
    frame_step = max((spec.every for spec in plan.plans[plugin].views), default=1)
    frames = expected_frames(plan.clip, probe(plan.clip.path, plan.clip.images_fps))
    spec = tilted(face_at(world_from_rig), FLOOR_PITCH_DEG, FLOOR_HFOV_DEG, f"{plan.name} / floor")
    return replace(spec, every=frame_step * max(1, -(-frames // (frame_step * MOST_FLOORS))))
