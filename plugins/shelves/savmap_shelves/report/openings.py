"""The clear space between a section's beams, where goods stand: what two dates of a rack are compared by beside its elements."""

from collections.abc import Iterator, Sequence

import numpy as np

from savmap.types import Floats, Structure

RING = np.array([[0, 1], [1, 3], [3, 2], [2, 0]])
FLOOR_SIGMA_M = 0.01
LEAST_M = 0.3
"""What is lower holds no goods."""
CORNERS = ("lower left", "lower right", "upper left", "upper right")


def openings(structures: Sequence[Structure]) -> list[Structure]:
    """A structure "section 3 / opening 2" for each space between two beams, one above the other, numbered by the beam it stands on; 0 stands
    on the floor. Its corners are those of the beams that bound it."""
    sections: dict[int, list[Structure]] = {}
    for beam in structures:
        if beam.label == "beam":
            sections.setdefault(int(float(beam.attributes["section"])), []).append(beam)
    return [opening for number, beams in sorted(sections.items()) for opening in _openings(number, beams)]


def _openings(number: int, beams: Sequence[Structure]) -> Iterator[Structure]:
    ordered = sorted(beams, key=lambda beam: float(beam.vertices[:, 1].mean()))
    bottoms = [_floor(*_edge(ordered[0], "lower")), *(_edge(beam, "upper") for beam in ordered[:-1])]
    tops = [_edge(beam, "lower") for beam in ordered]
    for level, ((low, low_spread), (high, high_spread)) in enumerate(zip(bottoms, tops, strict=True)):
        if float(high[:, 1].mean() - low[:, 1].mean()) < LEAST_M:
            continue
        name = f"section {number} / opening {level}"
        labels = tuple(f"{name} / {corner}" for corner in CORNERS)
        corners, spread = np.concatenate([low, high]), np.concatenate([low_spread, high_spread])
        yield Structure(name, "opening", corners, spread, labels, RING, {"section": number, "level": level})


def _edge(beam: Structure, side: str) -> tuple[Floats, Floats]:
    """The left and the right corner (2, 3) of a beam's lower or upper edge, with covariances (2, 3, 3)."""
    chosen = [index for index, label in enumerate(beam.vertex_labels) if side in label.split()]
    chosen.sort(key=lambda index: float(beam.vertices[index, 0]))
    return beam.vertices[chosen], beam.covariances[chosen]


def _floor(corners: Floats, covariances: Floats) -> tuple[Floats, Floats]:
    """The floor beneath a beam's corners."""
    spread = covariances.copy()
    spread[:, 1, :] = spread[:, :, 1] = 0.0
    spread[:, 1, 1] = FLOOR_SIGMA_M**2
    return corners * np.array([1.0, 0.0, 1.0]), spread
