"""Evidence of all frames whose pose is known: in planes, of intervals along them, of the depth of flat parts and of the
floor."""

from savmap.vision.evidence.depth import depth_of
from savmap.vision.evidence.floor import FloorHeight, FloorTracks, floor_before, floor_height, floor_tracks
from savmap.vision.evidence.planes import PackedView, gather, sharpness, upright_patch

__all__ = [
    "FloorHeight",
    "FloorTracks",
    "PackedView",
    "depth_of",
    "floor_before",
    "floor_height",
    "floor_tracks",
    "gather",
    "sharpness",
    "upright_patch",
]
