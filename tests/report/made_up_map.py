"""Rows for the viewer's tests: posts and bars with edges, a text, warnings, solids, a joint covariance, a camera's path."""

import base64
import gzip
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from savmap.types import (
    Floats,
    FrameTable,
    JointCovariance,
    MapWarning,
    Measured,
    Orthophoto,
    Placement,
    RowMap,
    SiteMap,
    Solid,
    Still,
    Structure,
    Trajectory,
    Verdict,
)

EVIL = "</script><img src=x onerror=alert(1)>"
RING = np.array([[0, 1], [1, 2], [2, 3], [3, 0]])


def thing(name: str, label: str, low: tuple[float, float], high: tuple[float, float], **attributes: str) -> Structure:
    """A rectangle in the face plane, known to 3, 4 and 1 mm."""
    corners = np.array([[low[0], low[1], 0], [high[0], low[1], 0], [high[0], high[1], 0], [low[0], high[1], 0.0]])
    covariance = np.tile(np.diag([9e-6, 16e-6, 1e-6]), (4, 1, 1))
    labels = tuple(f"{name} / {corner}" for corner in ("a", "b", "c", "d"))
    solid = Solid(corners, np.array([0, 0, -1.0]), assumed=True)
    return Structure(name, label, corners, covariance, labels, RING, {"support": 0.8, **attributes}, solid)


def places(row: str = "A") -> dict[str, dict[str, list[Structure]]]:
    """The bay between the posts, and the spaces of it, of which the topmost is open above."""
    width = {"clear_width_m": Measured(2.7, 0.0042), "bay": 1}
    heights = {0: {"clear_height_m": Measured(2.0, 0.0014)}, 1: {"clear_height_m": Measured(1.9, 0.002)}, 2: {}}
    section = thing("bay 1", "bay", (0.1, 0), (2.8, 4.1))
    parts = [replace(section, id=f"bay 1 / space {k}", attributes=width | own) for k, own in heights.items()]
    return {row: {"things": [replace(section, attributes=width), *parts]}}


def row(name: str = "A", with_joint: bool = True, text: str = "A21-03") -> RowMap:
    """Two posts with a bar between them, a plate on it, and a lone point beyond."""
    shapes = (
        thing("post 1", "post", (0, 0), (0.1, 5)),
        thing("post 2", "post", (2.8, 0), (2.9, 5)),
        thing("bay 1 / bar 1", "bar", (0.1, 2.0), (2.8, 2.1)),
        thing("bay 1 / plate", "plate", (1.0, 2.02), (1.2, 2.08), text=text),
        thing("bay 1 / bar 2", EVIL, (0.1, 4.0), (2.8, 4.1)),
    )
    point = Structure(
        "spot 1", "spot", np.array([[1.0, 4.5, 0.2]]), np.full((1, 3, 3), 1e-6), ("spot 1",), np.zeros((0, 2), int)
    )
    poses = np.tile(np.eye(4), (20, 1, 1))
    poses[:, :3, :3] = np.diag([-1.0, -1.0, 1.0])  # the panorama's centre looks out of the face, up is up
    poses[:, 0, 3], poses[:, 1, 3], poses[:, 2, 3] = np.linspace(0, 3, 20), 1.5, 1.6
    said = f"4 of 20 frames {EVIL}", None, 11
    warnings = (MapWarning("uncertain-element", ("bay 1 / bar 2",), *said),)
    return RowMap(
        name,
        FrameTable(np.arange(20) / 2, ("pass 1",) * 20),
        {},
        Trajectory(np.arange(20), poses),
        {"things": shapes, "spots": (point,)},
        (),
        verdict=Verdict(warnings, ("nothing checks the length",)),
        joint=joint(shapes) if with_joint else None,
    )


def joint(shapes: tuple[Structure, ...]) -> JointCovariance:
    """All x and y are solved for, with errors of which much is shared; z is independent."""
    numbers: dict[str, np.ndarray[tuple[int, ...], np.dtype[np.int64]]] = {}
    count = 0
    for shape in shapes:
        numbers[shape.id] = np.array([[count + 2 * k, count + 2 * k + 1, -1] for k in range(4)])
        count += 8
    shared: Floats = 0.002 * np.random.default_rng(1).normal(size=(count, 3)) + 0.004
    return JointCovariance({"things": numbers}, shared @ shared.T + 1e-6 * np.eye(count))


def site(*names: str, placed: bool = True) -> SiteMap:
    """Rows with a face each towards the other."""
    rows = {name: row(name, text=f"{name}-text") for name in names}
    places = {
        name: Placement(3.0 * (k % 2), 4.0 * k, 180.0 * (k % 2), np.diag([4e-4, 1e-4, 0.04]))
        for k, name in enumerate(names)
    }
    return SiteMap(rows, {}, {}, places if placed else {})


def jpeg(width: int, height: int, grey: int = 120) -> "np.ndarray[tuple[int, ...], np.dtype[np.uint8]]":
    """The bytes of a grey picture."""
    return np.asarray(cv2.imencode(".jpg", np.full((height, width, 3), grey, np.uint8))[1], np.uint8).ravel()


def photo() -> Orthophoto:
    return Orthophoto(np.array([-0.1, -0.1, 0]), np.eye(3)[0], np.eye(3)[1], 0.01, 310, 520, jpeg(310, 520))


def stills() -> tuple[Still, ...]:
    return tuple(Still(frame, jpeg(64, 32, 40 + 9 * frame)) for frame in (0, 6, 12, 18))


def data_of(page: Path) -> dict[str, Any]:
    """What a viewer's page holds."""
    packed = page.read_text(encoding="utf-8").split('id="map">')[1].split("<")[0]
    data: dict[str, Any] = json.loads(gzip.decompress(base64.b64decode(packed)))
    return data
