"""Evidence of all frames whose pose is known: in planes, of intervals along them, of the depth of flat parts and of the floor."""

from savmap.vision.evidence.depth import depth_of
from savmap.vision.evidence.detections import OUTSIDE_PX, Outlined, features_of, found_detections, outlines_in
from savmap.vision.evidence.floor import FloorHeight, FloorTracks, floor_before, floor_height, floor_tracks
from savmap.vision.evidence.planes import PackedView, gather, sharpness, upright_patch

__all__ = [
    "OUTSIDE_PX",
    "FloorHeight",
    "FloorTracks",
    "Outlined",
    "PackedView",
    "depth_of",
    "features_of",
    "floor_before",
    "floor_height",
    "floor_tracks",
    "found_detections",
    "gather",
    "outlines_in",
    "sharpness",
    "upright_patch",
]
