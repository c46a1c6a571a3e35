"""A row mapped one bay short is doubted or refused where its length or its bays are known."""

from dataclasses import replace

import made_up_rack as made
import numpy as np
import pytest
import two_faces

from savmap.errors import SiteError, SolveError
from savmap.graph import KnownLength, References
from savmap.graph.solver.optimise import converged, solution_of
from savmap_shelves.constraints import GridSettings, constrain


def test_length_of_a_row_with_one_bay_more() -> None:
    world = made.world(5, sections=3, frames=30, bridge=None)
    bay = float(world.rack.uprights[2, 0] - world.rack.uprights[1, 0])
    length = float(world.rack.uprights[-1, 1]) + bay
    given = References(
        made.references(world).camera_heights, (KnownLength("upright 1 / left", "upright 4 / right", length, 0.003),)
    )
    [warning] = made.solved(world, given=given).warnings
    assert f"length upright 1 / left to upright 4 / right is given as {length:.3f} m" in made.said(warning)
    assert "a part of the row may be missing" in made.said(warning)
    with pytest.raises(SolveError, match="contradict"):
        made.solved(world, given=replace(given, on_contradiction="refuse"))


def test_heights_of_one_section_less() -> None:
    world = made.world(5, sections=3, frames=12, bridge=None)
    settings = GridSettings(world.rack.lowest[:2])
    with pytest.raises(SiteError, match="gives 2 values, but 3 bays"):
        constrain(world.tracks, world.facts, made.begin(world), settings=settings)


def test_references_whose_landmarks_were_all_rejected() -> None:
    state = converged(two_faces.problems(*two_faces.faces(4, frames=12))[0])
    heights = [one.a for one in state.problem.relations if one.name.startswith("height")][:2]
    assert len(heights) == 2
    kept = state.fit.kept & ~np.isin(state.problem.measurements.keys, heights)
    with pytest.raises(SolveError, match="nothing that was seen of height of the lowest edge of bay 1, height"):
        solution_of(replace(state, fit=replace(state.fit, kept=kept)))
