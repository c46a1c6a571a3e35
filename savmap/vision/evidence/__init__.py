"""Evidence of all frames whose pose is known: in planes, of the depth of flat parts and of the floor, and of what lies behind a plane."""

from savmap.vision.evidence.behind import inner_part, lies_behind
from savmap.vision.evidence.depth import depth_of
from savmap.vision.evidence.floor import FloorTracks, floor_height, floor_tracks
from savmap.vision.evidence.planes import DetectionSettings, PackedView, expected_detections, gather, outline_in

__all__ = [
    "DetectionSettings",
    "FloorTracks",
    "PackedView",
    "depth_of",
    "expected_detections",
    "floor_height",
    "floor_tracks",
    "gather",
    "inner_part",
    "lies_behind",
    "outline_in",
]
