"""What the pictures of all frames show together on the face: the grid that was tracked, and the grid that the evidence shows."""

from savmap_shelves.evidence.beam_faces import beam_faces
from savmap_shelves.evidence.face_grid import Grid, absent_beams, face_patch, outlines, tracked_grid
from savmap_shelves.evidence.search import EvidenceSettings, expected_grid

__all__ = [
    "EvidenceSettings",
    "Grid",
    "absent_beams",
    "beam_faces",
    "expected_grid",
    "face_patch",
    "outlines",
    "tracked_grid",
]
