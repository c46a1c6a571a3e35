"""The evidence of all frames on the face: the grid that was tracked, and the grid by the evidence."""

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
