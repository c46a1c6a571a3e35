"""Rows put into one frame of the site (see `assemble`), and the site into the user's world (see `alignment`)."""

from savmap.assembly.alignment import Aligned, aligned, alignment_lines
from savmap.assembly.assemble import SQUARE_DEG, Assembly, assembled
from savmap.assembly.doubts import with_doubts
from savmap.assembly.summary import site_lines

__all__ = ["SQUARE_DEG", "Aligned", "Assembly", "aligned", "alignment_lines", "assembled", "site_lines", "with_doubts"]
