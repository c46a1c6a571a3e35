"""A hall of two rows that face each other across an aisle, which were filmed on one drive and one across it; aligned, with an anchor."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from savmap.types import Alignment, FrameTable, Placement, RowMap, SiteMap, Solid, Structure, Trajectory

HOSTILE = 'evil "1"\n=cmd: [x]\N{SNOWMAN}\u202e'
ANCHOR = (48.13715, 11.5754)
ALIGNED = Alignment(100.0, 50.0, 30.0, np.diag([1e-4, 1e-4, 1e-4]), 0.5, ANCHOR)
LENGTH_M, AISLE_M = 12.0, 3.0


def solid(name: str, label: str, corner: tuple[float, float], size: tuple[float, float], depth_m: float) -> Structure:
    """A box in a row's frame: x and y of its lower left corner, width and height, and how far it reaches behind the face."""
    (x, y), (width, height) = corner, size
    ring = np.array([[x, y, 0], [x + width, y, 0], [x + width, y + height, 0], [x, y + height, 0]])
    labels = tuple(f"{name} / {k}" for k in range(4))
    edges = np.array([[0, 1], [1, 2], [2, 3], [3, 0]])
    body = Solid(ring, np.array([0, 0, -depth_m]), assumed=True, ifc_class="IfcColumn")
    return Structure(name, label, ring, np.tile(1e-6 * np.eye(3), (4, 1, 1)), labels, edges, {}, body)


def line(name: str) -> Structure:
    """A structure without a solid, high above the aisle."""
    ends = np.array([[0.0, 8, 1.5], [1.2, 8, 1.5]])
    return Structure(name, "strip", ends, np.tile(1e-6 * np.eye(3), (2, 1, 1)), ("a", "b"), np.array([[0, 1]]))


def section(number: int, x: float) -> Structure:
    """A bar of a bay, 2 m wide, and what is written before it."""
    bar = solid(f"bay {number}", "bar", (x, 1.5), (2.0, 0.1), 0.05)
    return replace(bar, attributes={"bay": number})


def plate(bay: int, text: str) -> Structure:
    corner = np.array([[0.0, 1.5, 0.0]])
    attributes = {"bay": f"bay {bay}", "text": text}
    return Structure("plate", "plate", corner, np.eye(3)[None], ("a",), np.zeros((0, 2), np.int64), attributes)


def row(name: str, path: np.ndarray, hostile: str = "bar 2") -> RowMap:
    """Two posts, a bar low, one high above vehicles, and a path (n, 2) of x and z in the row's frame."""
    posts = [solid(f"post {k}", "post", (x, 0.0), (0.1, 5.0), 1.0) for k, x in ((1, 0.0), (2, LENGTH_M - 0.1))]
    bars = [solid("bar 1", "bar", (0.1, 1.0), (LENGTH_M - 0.2, 0.1), 0.05)]
    high = [solid(hostile, "bar", (0.1, 4.0), (LENGTH_M - 0.2, 0.1), 0.05)]
    poses = np.tile(np.eye(4), (len(path), 1, 1))
    poses[:, 0, 3], poses[:, 1, 3], poses[:, 2, 3] = path[:, 0], 3.0, path[:, 1]
    table = FrameTable(np.arange(len(path)) / 15, ("pass 1",) * len(path))
    structures = {"things": (*posts, *bars, *high), "strips": (line("strip 1"),)}
    return RowMap(name, table, {}, Trajectory(np.arange(len(path)), poses), structures, ())


def straight(start: tuple[float, float], end: tuple[float, float]) -> np.ndarray:
    return np.linspace(start, end, 80)


PLACES: Mapping[str, Placement] = {
    "A": Placement(0.0, 0.0, 0.0, np.zeros((3, 3))),
    HOSTILE: Placement(LENGTH_M, AISLE_M, 180.0, np.zeros((3, 3))),
}


def hall(alignment: Alignment | None = ALIGNED) -> SiteMap:
    """Both rows: A is driven along the middle of the aisle, the other one the same way back, and then across the aisle's end."""
    along = straight((-1.0, 1.5), (13.0, 1.5))
    back = np.vstack([straight((-1.0, 1.4), (13.0, 1.4)), straight((13.0, 1.4), (13.0, -4.0))])
    rows = {"A": row("A", along), HOSTILE: row(HOSTILE, back, HOSTILE)}
    return SiteMap(rows, {"savmap": "0.1.0"}, placements=PLACES, alignment=alignment)


def world(x: float, z: float) -> np.ndarray:
    """A place of the site's floor in the user's world."""
    turn = np.radians(30.0)
    return np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]) @ [x, -z] + [100.0, 50.0]
