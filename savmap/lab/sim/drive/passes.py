"""The true passes of a drive: when the camera is alongside which rows, and which way it goes.

A pass begins when the camera comes alongside the first structure of a row (its place along the row reaches the row's
end) and ends when it leaves the last. A gap between rows that it crosses without turning does not end it; turning does,
and so does going back.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from savmap.lab.sim.drive.cart import Drive
from savmap.lab.sim.scene.build import Built, face_size, mapped_rows
from savmap.types import Floats

REACH_M = 4.0
_ALIKE = np.cos(np.pi / 4)
_SHORTEST_S = 1.0


@dataclass(frozen=True)
class TruePass:
    """Start and end in seconds, travel in the world in degrees from +x towards +z, the rows on either hand."""

    start_s: float
    end_s: float
    travel_deg: float
    left: tuple[str, ...]
    right: tuple[str, ...]


def true_passes(built: Built, path: Drive) -> list[TruePass]:
    """The passes of a drive along mapped rows, in order; none in a scene without a mapped row."""
    travel = _travel(path)
    by_row = {name: _beside(built, name, path, travel) for name in (mapped_rows(built) if built.boxes else [])}
    on = np.any([np.abs(hand) > 0 for hand in by_row.values()], axis=0) if by_row else np.zeros(len(travel), bool)
    passes = []
    for first, last in _stretches(on, travel):
        hands = {name: np.sign(hand[first : last + 1].sum()) for name, hand in by_row.items()}
        left, right = (tuple(name for name, hand in hands.items() if hand == side) for side in (-1, 1))
        ahead = travel[first : last + 1].mean(axis=0)
        angle = float(np.degrees(np.arctan2(ahead[1], ahead[0])))
        passes.append(TruePass(float(path.stamps_s[first]), float(path.stamps_s[last]), angle, left, right))
    return [true_pass for true_pass in passes if true_pass.end_s - true_pass.start_s >= _SHORTEST_S]


def passes_file(passes: list[TruePass]) -> dict[str, Any]:
    """The content of passes.json."""
    rows = [
        {
            "start_s": round(true_pass.start_s, 3),
            "end_s": round(true_pass.end_s, 3),
            "travel_deg": round(true_pass.travel_deg, 1),
            "left": list(true_pass.left),
            "right": list(true_pass.right),
        }
        for true_pass in passes
    ]
    return {"format": "savmap-passes", "version": 1, "passes": rows}


def _travel(path: Drive) -> Floats:
    """The way the camera goes (n, 2), unit, over the floor; while it stands, the way it went before."""
    ground = path.origins[:, [0, 2]]
    if len(ground) < 2:
        return np.tile([1.0, 0.0], (len(ground), 1))
    moves = np.gradient(ground, axis=0)
    sizes = np.linalg.norm(moves, axis=1)
    moving = sizes > 0.2 * np.median(sizes[sizes > 1e-4]) if (sizes > 1e-4).any() else np.zeros(len(sizes), bool)
    indices = np.flatnonzero(moving)
    if not len(indices):
        return np.tile([1.0, 0.0], (len(ground), 1))
    last = indices[(np.searchsorted(indices, np.arange(len(ground)), side="right") - 1).clip(0)]
    travel: Floats = moves[last] / sizes[last, None]
    return travel


def _beside(built: Built, name: str, path: Drive, travel: Floats) -> Floats:
    """Frames (n,) in which the row is on the left hand (-1), on the right (+1), or neither (0)."""
    frame = built.frames[name]
    places = frame.to_row(path.origins)
    length, _ = face_size(built, name)
    along = travel @ frame.world_from_row[[0, 2], 0]
    near = (places[:, 0] >= 0) & (places[:, 0] <= length) & (places[:, 2] > 0) & (places[:, 2] < REACH_M)
    hand: Floats = np.where(near & (np.abs(along) > _ALIKE), -np.sign(along), 0.0)
    return hand


def _stretches(on: np.ndarray[Any, np.dtype[np.bool_]], travel: Floats) -> list[tuple[int, int]]:
    """First and last frames of stretches alongside rows, joined over gaps without a turn."""
    stretches: list[tuple[int, int]] = []
    for index in np.flatnonzero(on).tolist():
        if stretches and (travel[stretches[-1][1] : index + 1] @ travel[stretches[-1][1]] > _ALIKE).all():
            stretches[-1] = stretches[-1][0], index
        else:
            stretches.append((index, index))
    return stretches
