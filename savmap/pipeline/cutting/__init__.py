"""Parts of a row's frames that are kept during the first pass over the video, for use when the camera's path is known.

They are strips of the face (`face_strips`), whole panoramas (`stills`) and views of the floor (`floor_views`). `cutter`
is their common interface. A second pass over the video would cost the time to decode it again.
"""

from savmap.pipeline.cutting.cutter import Cut, NoStrips, SeveralCutters, StripCutter
from savmap.pipeline.cutting.face_strips import FaceStrips
from savmap.pipeline.cutting.floor_views import FloorCutter
from savmap.pipeline.cutting.stills import Stills, spaced_stills

__all__ = ["Cut", "FaceStrips", "FloorCutter", "NoStrips", "SeveralCutters", "Stills", "StripCutter", "spaced_stills"]
