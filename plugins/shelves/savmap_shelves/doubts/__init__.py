"""What of a mapped rack is implausible: elements out of proportion to their likes, beams that grow aslant, levels that one bay alone has or
lacks, and a size that no rack has."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from savmap.types import Doubt, Structure
from savmap_shelves.doubts.levels import adjoining_beams, high_lowest_beams, odd_levels
from savmap_shelves.doubts.sides import beams_with_sides
from savmap_shelves.doubts.sizes import odd_bays, odd_scale, odd_sizes, unmeasured_edges


def doubts_of(structures: Sequence[Structure], lowest_known: bool = False) -> list[Doubt]:
    """Doubts of kind `shape`, each with the ids of the elements that it is about. `lowest_known`: whether the heights of the lowest beams are given,
    which the solve compares with the map."""
    by_id = {structure.id: structure for structure in structures}

    checks = (odd_scale, odd_bays, odd_sizes, beams_with_sides, odd_levels, adjoining_beams)
    found = [*unmeasured_edges(structures, told_by_profile=False)]
    found += [implausible for check in checks for implausible in check(structures)]
    if not lowest_known:
        told = {doubt.structures for doubt in found}
        found += [doubt for doubt in high_lowest_beams(structures) if doubt.structures not in told]
    found += [replace(doubt, minor=True) for doubt in unmeasured_edges(structures, told_by_profile=True)]
    return [replace(doubt, place=_place([by_id[name] for name in doubt.structures])) for doubt in found]


def _place(structures: Sequence[Structure]) -> tuple[float, float, float]:
    x, y, z = np.mean([structure.vertices.mean(axis=0) for structure in structures], axis=0).tolist()
    return x, y, z
