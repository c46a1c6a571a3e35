"""A row mapped one bay short is refused where its length or its sections are known."""

import made_up_rack as made
import pytest

from savmap.errors import SiteError, SolveError
from savmap.graph import KnownLength, References
from savmap_shelves.constraints import GridSettings, constrain


def test_length_of_a_row_with_one_bay_more() -> None:
    world = made.world(5, sections=3, frames=30, bridge=None)
    bay = float(world.rack.uprights[2, 0] - world.rack.uprights[1, 0])
    length = float(world.rack.uprights[-1, 1]) + bay
    given = References(
        made.references(world).camera_heights, (KnownLength("upright 1 / left", "upright 4 / right", length, 0.003),)
    )
    with pytest.raises(SolveError, match="contradict"):
        made.solved(world, given=given)


def test_heights_of_one_section_less() -> None:
    world = made.world(5, sections=3, frames=12, bridge=None)
    settings = GridSettings(world.rack.lowest[:2])
    with pytest.raises(SiteError, match="gives 2 values, but 3 sections"):
        constrain(world.tracks, world.facts, made.begin(world), settings=settings)
