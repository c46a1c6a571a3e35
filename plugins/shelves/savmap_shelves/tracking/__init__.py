"""From the features of all frames to labelled tracks: the grid and the camera's path on the face plane, fitted together."""

from savmap_shelves.tracking.tracks import track_structures

__all__ = ["track_structures"]
