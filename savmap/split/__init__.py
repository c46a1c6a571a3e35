"""Long recordings in which a cart weaves through aisles: their passes, found from few of their frames."""

from savmap.split.find import find, split
from savmap.split.records import DetectedPass, SplitResult, SplitSettings

__all__ = ["DetectedPass", "SplitResult", "SplitSettings", "find", "split"]
