"""A row's survey, and the structures that a perfect map of it has."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from savmap.types import Structure

Row = dict[str, Any]


def surveyed_row() -> Row:
    """Four bays, the third of them a bridge."""
    return {
        "uprights": [[0.0, 0.1], [3.7, 3.8], [7.5, 7.6], [11.3, 11.4], [14.1, 14.2]],
        "sections": [
            {"beams": [[0.3, 0.4], [1.2, 1.3], [2.3, 2.4], [3.5, 3.6], [4.55, 4.65], [5.5, 5.6]]},
            {"beams": [[0.17, 0.26], [1.2, 1.3], [2.25, 2.35], [3.2, 3.3], [4.4, 4.5], [5.6, 5.7]]},
            {"beams": [[4.2, 4.35], [5.3, 5.45], [6.3, 6.45]]},
            {"beams": [[0.3, 0.4], [1.3, 1.4], [1.9, 2.0], [2.9, 3.0], [3.5, 3.6], [5.0, 5.1], [5.6, 5.7]]},
        ],
    }


def structures_of(row: Mapping[str, Any]) -> list[Structure]:
    """The structures that a perfect map of `row` has."""
    uprights = row["uprights"]
    made = [_upright(k, x) for k, x in enumerate(uprights, start=1)]
    for section, entry in enumerate(row["sections"], start=1):
        x = uprights[section - 1][1], uprights[section][0]
        made += [_beam(section, k, x, y) for k, y in enumerate(entry["beams"], start=1)]
    return made


def _upright(number: int, x: tuple[float, float]) -> Structure:
    corners = ("left / bottom", "right / bottom", "left / top", "right / top")
    return _structure(f"upright {number}", "upright", _corners(x, (0.0, 6.0)), corners, {"upright": number})


def _beam(section: int, number: int, x: tuple[float, float], y: tuple[float, float]) -> Structure:
    corners = ("lower left", "lower right", "upper left", "upper right")
    place = {"bay": section, "beam": number}
    return _structure(f"bay {section} / beam {number}", "beam", _corners(x, y), corners, place)


def _corners(x: tuple[float, float], y: tuple[float, float]) -> np.ndarray:
    return np.array([[x[0], y[0], 0.0], [x[1], y[0], 0.0], [x[0], y[1], 0.0], [x[1], y[1], 0.0]])


def _structure(
    name: str, label: str, corners: np.ndarray, named: tuple[str, ...], place: Mapping[str, int]
) -> Structure:
    edges = np.array([[0, 1], [1, 3], [3, 2], [2, 0]])
    labels = tuple(f"{name} / {corner}" for corner in named)
    return Structure(name, label, corners, np.tile(1e-4 * np.eye(3), (4, 1, 1)), labels, edges, place)
