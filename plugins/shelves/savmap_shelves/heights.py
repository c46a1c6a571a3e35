"""Which given height belongs to which found section, where only part of a row was seen (h_ref of the paper, section III.E)."""

from collections.abc import Sequence

from savmap.errors import SiteError


def assignments(values: Sequence[float], sections: Sequence[int], row: str) -> dict[str, dict[int, float]]:
    """The heights of the lowest beams of the found sections, from one a section of the row, left to right: one way where
    all sections were found, all runs of neighbours where the row has more, by name. Raises SiteError where it has fewer."""
    spare = len(values) - len(sections)
    if spare < 0:
        raise SiteError(
            f"row {row}: lowest_beam_bottom_height_m gives {len(values)} heights, but {len(sections)} sections were found"
        )
    return {
        f"sections {first + 1} to {first + len(sections)} of {len(values)}": dict(
            zip(sections, values[first:], strict=False)
        )
        for first in range(spare + 1)
    }
