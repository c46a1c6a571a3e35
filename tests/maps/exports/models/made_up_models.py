"""Two rows of a made-up site, far from the world's origin, and what they have in common with files that hold them."""

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from savmap.maps.exports.frames import elements
from savmap.types import (
    Alignment,
    Floats,
    FrameTable,
    MapWarning,
    Measured,
    Placement,
    RowMap,
    SiteMap,
    Solid,
    Structure,
    Trajectory,
    Verdict,
)

EVIL = (
    "a\"b\\n\n\r\t\x1b[31m # @x@ </World> {} $ ; ' * , %%d %%% ^J \\U+000A \\P é漢😀\u202e ../../etc/passwd",
    "L" * 5000,
    "../",
    "",
    "1 begins with a digit",
    "'); DROP",
    "\ud800half",
)
"""Texts that mean something to one format or another."""
NEAREST_M = 1e-4


def box(x: float, y: float, width: float, height: float) -> Floats:
    """A rectangle (4, 3) in a row's face."""
    return np.array([[x, y, 0.0], [x + width, y, 0.0], [x + width, y + height, 0.0], [x, y + height, 0.0]])


def structure(name: str, label: str, vertices: Floats, solid: Solid | None = None, closed: bool = True) -> Structure:
    """A structure whose edges go around its vertices, or, if it is not closed, that has one edge if it has two vertices."""
    count = len(vertices)
    around = [[k, (k + 1) % count] for k in range(count)] if closed else [[0, 1]] * (count == 2)
    spread = np.tile(np.diag([0.01, 0.02, 0.03]) ** 2, (count, 1, 1))
    attributes = {"width_m": Measured(0.1, 0.005), "number": 7, "text": f"text of {name}", "far": 10**12}
    labels = tuple(f"{name} / {k}" for k in range(count))
    return Structure(name, label, vertices, spread, labels, np.array(around, int).reshape(-1, 2), attributes, solid)


def things() -> tuple[Structure, ...]:
    """Solids of several kinds, of which one is not flat and one not convex, a line, and a point."""
    back = np.array([0.0, 0.0, -1.1])
    bent = box(1.0, 3.0, 0.5, 0.3) + np.array([[0, 0, 0.02], [0, 0, 0], [0, 0, 0.02], [0, 0, 0]])
    corner = np.array([[5.0, 0, 0], [6, 0, 0], [6, 1, 0], [5.5, 1, 0], [5.5, 2, 0], [5, 2, 0]])
    left, right, bar = box(0.0, 0.0, 0.1, 5.0), box(2.8, 0.0, 0.1, 5.0), box(0.1, 2.0, 2.7, 0.12)
    return (
        structure("post 1", "post", left, Solid(left, back, True, "IfcColumn")),
        structure("post 2", "post", right[::-1], Solid(right[::-1], back, False, "IfcColumn")),
        structure("bar / 1", "bar", bar, Solid(bar, 0.05 * back, True, "IfcBeam")),
        structure("plate", "plate", bent, Solid(bent, np.array([0, 0, 0.004]), True, "IfcSign")),
        structure("corner", "block", corner, Solid(corner, np.array([0.1, 0.0, -0.4]), False, "IfcNoSuchThing")),
        structure("tube", "tube", np.array([[0.0, 8, 1.2], [1.4, 8, 1.2]]), closed=False),
        structure("spot", "tube", np.array([[2.0, 8.0, 1.2]]), closed=False),
    )


def warning_of(name: str) -> MapWarning:
    return MapWarning("uncertain-element", (name,), "P 0.43")


def row(name: str, parts: Sequence[Structure]) -> RowMap:
    """A row of these structures, of which the first is warned of."""
    path = Trajectory(np.arange(2), np.tile(np.eye(4), (2, 1, 1)), np.full((2, 3), 0.01))
    verdict = Verdict((warning_of(parts[0].id),)) if parts else None
    table = FrameTable(np.arange(2.0), ("pass 1",) * 2)
    return RowMap(name, table, {}, path, {"things": tuple(parts)}, (), verdict=verdict)


def made_up_site() -> SiteMap:
    """Rows A and B, back to back, in a world whose origin is far away."""
    places = {"A": Placement(2.0, -3.0, 30.0, 1e-4 * np.eye(3)), "B": Placement(4.0, -6.0, 210.0, 1e-4 * np.eye(3))}
    alignment = Alignment(4321.5, -8765.25, -75.0, 1e-4 * np.eye(3), 12.5, anchor=(48.137, -11.575))
    rows = {name: row(name, things()) for name in places}
    return SiteMap(rows, {"savmap": "0"}, placements=places, alignment=alignment)


def hostile_site() -> SiteMap:
    """One row whose every text is hostile."""
    parts = [
        replace(
            thing, id=text, label=text, vertex_labels=(text,) * len(thing.vertices), attributes={text: text, "n": 1}
        )
        for text, thing in zip(EVIL, things(), strict=True)
    ]
    twin = replace(parts[0], label=EVIL[1])
    return SiteMap({EVIL[0]: row(EVIL[0], [*parts, twin])}, {})


def expected(site: SiteMap) -> dict[tuple[str, str], Floats]:
    """By row and id: where in the world the corners of a structure's solid are, or its vertices."""
    found = {}
    for element in elements(site):
        solid = element.structure.solid
        corners = np.concatenate([solid.outline, solid.outline + solid.depth]) if solid else element.structure.vertices
        found[element.row, element.structure.id] = corners
    return found


def distance_m(one: Floats, other: Floats) -> float:
    """How far any point of either is from the nearest of the other, m."""
    apart = np.linalg.norm(one[:, None] - other[None], axis=2)
    return float(max(apart.min(axis=0).max(), apart.min(axis=1).max()))


def readable(text: str) -> str:
    """A text as files may give it back: halves of characters cannot be written."""
    return re.sub("[\ud800-\udfff]", "\ufffd", text)


DEPTH_NOTE = "assumed depth, neither measured nor given: post 1.1 m, bar 0.055 m, plate 0.004 m"
"""What files should say of `things`."""
