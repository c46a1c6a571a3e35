"""Rows in one frame of the site (see `assemble`)."""

from savmap.assembly.assemble import SQUARE_DEG, Assembly, assembled
from savmap.assembly.summary import site_lines

__all__ = ["SQUARE_DEG", "Assembly", "assembled", "site_lines"]
