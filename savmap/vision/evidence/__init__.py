"""Evidence of all frames whose pose is known: in planes, of the depth of flat parts and of the floor, and of what lies behind a plane."""

from savmap.vision.evidence.behind import inner_part, lies_behind
from savmap.vision.evidence.depth import depth_of
from savmap.vision.evidence.drift import drift_of
from savmap.vision.evidence.expected import DetectionSettings, Outlined, expected_detections, features_of, outlines_in
from savmap.vision.evidence.floor import FloorHeight, FloorTracks, floor_before, floor_height, floor_tracks
from savmap.vision.evidence.planes import PackedView, gather

__all__ = [
    "DetectionSettings",
    "FloorHeight",
    "FloorTracks",
    "Outlined",
    "PackedView",
    "depth_of",
    "drift_of",
    "expected_detections",
    "features_of",
    "floor_before",
    "floor_height",
    "floor_tracks",
    "gather",
    "inner_part",
    "lies_behind",
    "outlines_in",
]
