"""What all frames of known pose show together: evidence in planes, and how deep flat parts lie."""

from savmap.vision.evidence.depth import depth_of
from savmap.vision.evidence.planes import Look, LookSettings, expected_detections, gather, outline_in

__all__ = ["Look", "LookSettings", "depth_of", "expected_detections", "gather", "outline_in"]
