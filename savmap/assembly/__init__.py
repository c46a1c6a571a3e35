"""Rows put into one frame of the site (see `assemble`), and the site into the user's world (see `alignment`)."""

from savmap.assembly.alignment import Aligned, aligned, alignment_lines
from savmap.assembly.assemble import SQUARE_DEG, Assembly, assembled, site_lines
from savmap.assembly.misfits import rows_with_same_face, same_face_warnings, with_confirmed, with_warnings

__all__ = [
    "SQUARE_DEG",
    "Aligned",
    "Assembly",
    "aligned",
    "alignment_lines",
    "assembled",
    "rows_with_same_face",
    "same_face_warnings",
    "site_lines",
    "with_confirmed",
    "with_warnings",
]
