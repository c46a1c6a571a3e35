"""What all frames of known pose show together: evidence in planes, how deep flat parts and the floor lie, and what is only seen through an opening."""

from savmap.vision.evidence.behind import inner_part, lies_behind
from savmap.vision.evidence.depth import depth_of
from savmap.vision.evidence.floor import FloorTracks, floor_tracks
from savmap.vision.evidence.planes import DetectionSettings, PackedView, expected_detections, gather, outline_in

__all__ = [
    "DetectionSettings",
    "FloorTracks",
    "PackedView",
    "depth_of",
    "expected_detections",
    "floor_tracks",
    "gather",
    "inner_part",
    "lies_behind",
    "outline_in",
]
