"""What lies beyond the row's ends: it is mapped where it was seen, but is none of the row's, and speaks against nothing of the row."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from savmap.types import Doubt, Floats, Structure


def without_beyond(
    doubts: Iterable[Doubt], structures: Mapping[str, Sequence[Structure]], locators: frozenset[str]
) -> tuple[list[Doubt], list[str]]:
    """The doubts that are about the row, and, as notes, those that are about structures beyond its ends alone, or about a place there where one
    may be missing: seen from afar and aslant, for the camera hardly passes there. `structures` and `locators`: as in `beyond_ends`."""
    outside, ends = beyond_ends(structures, locators), _ends(structures, locators)
    kept, notes = [], []
    for doubt in doubts:
        if _is_outside(doubt, outside, ends):
            notes.append(f"beyond the row's ends: {doubt.line}")
        else:
            kept.append(doubt)
    return kept, notes


def beyond_ends(structures: Mapping[str, Sequence[Structure]], locators: frozenset[str]) -> frozenset[str]:
    """The ids of structures that are wholly beyond the row's ends; none where no face was found.

    `structures`: the row's, by plugin; `locators`: the names of those plugins whose structures are the face, which has the ends.
    """
    ends = _ends(structures, locators)
    if ends is None:
        return frozenset()
    every = [one for own in structures.values() for one in own]
    inside = {one.id for one in every if not _is_beyond(one.vertices[:, 0], ends)}
    return frozenset(one.id for one in every) - inside


def _ends(structures: Mapping[str, Sequence[Structure]], locators: frozenset[str]) -> tuple[float, float] | None:
    """From where to where along x, m, the face reaches; None where none was found."""
    face = [one for name in sorted(locators) for one in structures.get(name, ())]
    if not face:
        return None
    x = np.concatenate([one.vertices[:, 0] for one in face])
    return float(x.min()), float(x.max())


def _is_outside(doubt: Doubt, outside: frozenset[str], ends: tuple[float, float] | None) -> bool:
    """Whether a doubt is about structures `outside` alone, or, naming none, about the shape of what lies beyond the ends."""
    if doubt.structures or doubt.kind != "shape" or doubt.place is None or ends is None:
        return bool(doubt.structures) and outside.issuperset(doubt.structures)
    return _is_beyond(np.array(doubt.place[:1]), ends)


def _is_beyond(x: Floats, ends: tuple[float, float]) -> bool:
    return bool(x.max() < ends[0] or x.min() > ends[1])
