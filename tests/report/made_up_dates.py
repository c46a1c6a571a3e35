"""A row of bays on two dates, for the tests of comparisons: noise, a beam that was lifted, parts that are gone."""

from collections.abc import Collection
from dataclasses import replace

import cv2
import numpy as np

from savmap.types import FrameTable, Orthophoto, RowMap, SiteMap, Structure, Trajectory

RING = np.array([[0, 1], [1, 3], [3, 2], [2, 0]])
BEAM_CORNERS = ("lower left", "lower right", "upper left", "upper right")
UPRIGHT_CORNERS = ("left / bottom", "right / bottom", "left / top", "right / top")
HEIGHTS = (0.3, 1.5, 2.6, 3.9)


def box(name: str, label: str, x: tuple[float, float], y: tuple[float, float], number: int) -> Structure:
    """A rectangle in the face plane, known to 3 mm."""
    corners = np.array([[x[i], y[j], 0.0] for j in (0, 1) for i in (0, 1)])
    place = "upright" if label == "upright" else "bay"
    named = UPRIGHT_CORNERS if label == "upright" else BEAM_CORNERS
    labels = tuple(f"{name} / {corner}" for corner in named)
    return Structure(name, label, corners, np.tile(1e-5 * np.eye(3), (4, 1, 1)), labels, RING, {place: number})


def dated_site(
    seed: int, lifted_m: float = 0.0, sections: int = 5, without: Collection[str] = (), moved_m: float = 0.0
) -> SiteMap:
    """Row A: `seed` of its errors, by how much a beam was lifted, what is not there, and by how much its frame begins further right."""
    rng = np.random.default_rng(seed)
    parts = []
    for k in range(sections):
        x = 2.8 * k
        parts.append(box(f"upright {k + 1}", "upright", (x, x + 0.1), (0.0, 5.0), k + 1))
        for n, height in enumerate(HEIGHTS):
            y = height + 0.05 * k + (lifted_m if (k, n) == (2, 2) else 0.0)
            parts.append(box(f"bay {k + 1} / beam {n + 1}", "beam", (x + 0.1, x + 2.8), (y, y + 0.1), k + 1))
    away = np.array([moved_m, 0.0, 0.0])
    noisy = [replace(one, vertices=one.vertices + rng.normal(0, 0.001, 3) - away) for one in parts]
    kept = tuple(one for one in noisy if one.id not in without)
    poses = np.tile(np.eye(4), (60, 1, 1))
    poses[:, 0, 3], poses[:, 2, 3] = np.linspace(-1, 2.8 * sections + 1, 60) - moved_m, 1.5
    frames = FrameTable(np.arange(60.0), ("pass 1",) * 60)
    return SiteMap({"A": RowMap("A", frames, {}, Trajectory(np.arange(60), poses), {"shelves": kept}, ())}, {})


def grey_photo(grey: int) -> Orthophoto:
    """A grey picture of the whole row."""
    picture = cv2.imencode(".jpg", np.full((55, 150, 3), grey, np.uint8))[1].ravel()
    return Orthophoto(np.array([-0.5, 0, 0]), np.eye(3)[0], np.eye(3)[1], 0.1, 150, 55, np.asarray(picture, np.uint8))
