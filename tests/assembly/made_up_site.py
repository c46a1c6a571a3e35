"""A made-up regular site: aisles with a face on either side, racks with two faces, lamps over the aisles; rows mapped with noise."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from savmap.types import CrossRowLandmark, Floats, FrameTable, Placement, RowMap, SiteMap, Structure, Trajectory

LENGTH_M, AISLE_M, PITCH_M = 30.0, 3.0, 4.2
DEEPEST_M = 1.6
NO_EDGES = np.zeros((0, 2), np.int64)


@dataclass(frozen=True)
class Noise:
    """Standard deviations, m: of uprights and lamps in a row, each for itself, and of a row's whole camera path."""

    upright: float = 0.004
    lamp: float = 0.03
    path: float = 0.006


def truth(aisles: int) -> dict[str, Placement]:
    """Rows 1L, 1R, 2L, ...: the left face looks along +z, the right one back at it."""
    none = np.zeros((3, 3))
    places: dict[str, Placement] = {}
    for number in range(aisles):
        places[f"{number + 1}L"] = Placement(0.0, PITCH_M * number, 0.0, none)
        places[f"{number + 1}R"] = Placement(LENGTH_M, PITCH_M * number + AISLE_M, 180.0, none)
    return places


def lamps(aisle: int, spacing: Sequence[float]) -> Floats:
    """Lamps over the middle of an aisle, with these steps between them, in the site's frame."""
    x = np.cumsum(spacing)
    return np.stack([x, np.full(len(x), 8.0), np.full(len(x), PITCH_M * aisle + AISLE_M / 2)], axis=1)


def site(
    aisles: int,
    rng: np.random.Generator,
    spacing: Sequence[float] = (2.0, 4.0, 4.0, 4.0, 4.0, 4.0, 4.0),
    noise: Noise | None = None,
) -> SiteMap:
    """Rows of the site, each in a frame of its own."""
    sizes = noise or Noise()
    frames = np.arange(0.0, LENGTH_M + 0.1, 2.5)
    rows = {}
    for name, place in truth(aisles).items():
        aisle = int(name[:-1]) - 1
        uprights = np.stack([frames, np.full(len(frames), 3.0), np.full(len(frames), place.z_m)], axis=1)
        found = [
            *things("upright", inside(place, uprights), sizes.upright, rng),
            *things("lamp", inside(place, lamps(aisle, spacing)), sizes.lamp, rng),
        ]
        rows[name] = row(name, place, aisle, found, sizes.path, rng)
    return SiteMap(rows, {"savmap": "0"})


def inside(place: Placement, points: Floats) -> Floats:
    """Points (n, 3) of the site in a row's frame, in the row's order."""
    back = np.linalg.inv(place.site_from_row)
    own = points @ back[:3, :3].T + back[:3, 3]
    ordered: Floats = own[np.argsort(own[:, 0])]
    return ordered


def things(label: str, points: Floats, sigma: float, rng: np.random.Generator) -> list[Structure]:
    """One structure a point, off by noise."""
    return [
        Structure(
            f"{label} {number}",
            label,
            point[None] + rng.normal(0, sigma, (1, 3)),
            sigma**2 * np.eye(3)[None],
            (f"{label} {number}",),
            NO_EDGES,
        )
        for number, point in enumerate(points, start=1)
    ]


def row(
    name: str, place: Placement, aisle: int, found: list[Structure], sigma: float, rng: np.random.Generator
) -> RowMap:
    """A row's map, with the path of a camera that was pushed through the aisle, looking ahead."""
    count = 60
    site_from_rig = np.tile(np.eye(4), (count, 1, 1))
    site_from_rig[:, :3, :3] = Rotation.from_euler("y", 90, degrees=True).as_matrix()
    site_from_rig[:, :3, 3] = np.stack(
        [np.linspace(-1, LENGTH_M + 1, count), np.full(count, 3.0), np.full(count, PITCH_M * aisle + 1.4)], axis=1
    )
    poses = np.linalg.inv(place.site_from_row) @ site_from_rig
    poses[:, :3, 3] += rng.normal(0, sigma, 3)
    path = Trajectory(np.arange(count), poses, np.full((count, 3), max(sigma, 1e-3)))
    return RowMap(
        name, FrameTable(np.arange(count) / 2.0, ("pass 1",) * count), {}, path, {"made up": tuple(found)}, ()
    )


def ask(row: str, plugin: str, structures: Sequence[Structure]) -> list[CrossRowLandmark]:
    """Lamps are shared whole, uprights along x with the other face of the rack."""
    return [
        CrossRowLandmark(own.id, own.label, own.vertices[0], own.covariances[0])
        if own.label == "lamp"
        else CrossRowLandmark(own.id, own.label, own.vertices[0], own.covariances[0], ("x",), DEEPEST_M)
        for own in structures
    ]


def one_drive_an_aisle(names: Sequence[str]) -> dict[str, dict[str, str]]:
    """Recordings: both faces of an aisle from one drive."""
    return {name: {"pass 1": f"aisle {name[:-1]}"} for name in names}


def priors(
    places: Mapping[str, Placement], rng: np.random.Generator, sigma_m: float = 0.2, sigma_deg: float = 0.5
) -> dict[str, Placement]:
    """What is said of the rows' places, off by its own sigmas."""
    covariance = np.diag([sigma_m**2, sigma_m**2, sigma_deg**2])
    return {
        name: Placement(
            place.x_m + rng.normal(0, sigma_m),
            place.z_m + rng.normal(0, sigma_m),
            place.heading_deg + rng.normal(0, sigma_deg),
            covariance,
        )
        for name, place in places.items()
    }


def off(found: Placement, wanted: Placement) -> Floats:
    """x m, z m, heading degrees (3,)."""
    turn = (found.heading_deg - wanted.heading_deg + 180) % 360 - 180
    return np.array([found.x_m - wanted.x_m, found.z_m - wanted.z_m, turn])
