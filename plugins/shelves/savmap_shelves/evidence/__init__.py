"""The face as it was solved: its grid, the patch around it, and the beams' faces."""

from savmap_shelves.evidence.beam_faces import beam_faces
from savmap_shelves.evidence.face_grid import Grid, face_patch, tracked_grid

__all__ = ["Grid", "beam_faces", "face_patch", "tracked_grid"]
