"""What is kept of a row's frames while they go by, for when the camera's path is known: decoding them twice would take twice as long.

Strips of the face (`face_strips`), whole panoramas (`stills`) and the floor before the face (`floor_views`); `cutter` is what all of them are.
"""

from savmap.pipeline.cutting.cutter import NoStrips, SeveralCutters, StripCutter
from savmap.pipeline.cutting.face_strips import FaceStrips
from savmap.pipeline.cutting.floor_views import FloorCutter
from savmap.pipeline.cutting.stills import Stills, apart

__all__ = ["FaceStrips", "FloorCutter", "NoStrips", "SeveralCutters", "Stills", "StripCutter", "apart"]
