"""What lies beyond the row's ends: it is mapped where it was seen, but is none of the row's, and speaks against nothing of the row."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from savmap.types import Doubt, Floats, Structure


def without_beyond(
    doubts: Iterable[Doubt], structures: Mapping[str, Sequence[Structure]], locators: frozenset[str]
) -> tuple[list[Doubt], list[str]]:
    """The doubts that are about the row, and, as notes, those that are about structures beyond its ends alone: seen from afar and aslant,
    for the camera hardly passes there. `structures` and `locators`: as in `beyond_ends`."""
    outside = beyond_ends(structures, locators)
    kept, notes = [], []
    for doubt in doubts:
        if doubt.structures and outside.issuperset(doubt.structures):
            notes.append(f"beyond the row's ends: {doubt.what}")
        else:
            kept.append(doubt)
    return kept, notes


def beyond_ends(structures: Mapping[str, Sequence[Structure]], locators: frozenset[str]) -> frozenset[str]:
    """The ids of structures that are wholly beyond the row's ends; none where no face was found.

    `structures`: the row's, by plugin; `locators`: the names of those plugins whose structures are the face, which has the ends.
    """
    face = [one for name in sorted(locators) for one in structures.get(name, ())]
    if not face:
        return frozenset()
    ends = np.concatenate([one.vertices[:, 0] for one in face])
    low, high = float(ends.min()), float(ends.max())
    every = [one for own in structures.values() for one in own]
    inside = {one.id for one in every if not _is_beyond(one.vertices[:, 0], low, high)}
    return frozenset(one.id for one in every) - inside


def _is_beyond(x: Floats, low: float, high: float) -> bool:
    return bool(x.max() < low or x.min() > high)
