"""What of a row is compared: its structures as boxes along the row's axes with texts, and the part of the row that the
camera passed."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from savmap.maps.search import WRITTEN
from savmap.types import Bools, Floats, Ints, Measured, RowMap, Structure, array_record

LEAST_REACH_M, REACH_SHARE = 0.5, 0.5
"""How far beyond its places a camera is taken to see an element whole: as a share of its distance from the face."""
SAME_SIZE_M = 0.002
LEAN = "lean_permille"
"""The attribute of what should stand upright: how far it leans along the row, mm in 1 m, with a standard deviation."""
FOOT_M, SLENDER = 0.3, 3.0
"""What begins no higher, and is so many times as high as wide, is a post that a truck may hit."""
SURE = 0.999
"""No text counts as read with more certainty than this."""


@dataclass(frozen=True, eq=False)
@array_record
class Elements:
    """The n structures of a row: middles (n, 3) and sizes (n, 3) m along the axes with standard deviations, `groups`
    (n,) numbers of the `kinds` (plugin, label), texts (n) with the chance (n,) that each is misread, and the
    structures."""

    structures: tuple[Structure, ...]
    kinds: tuple[tuple[str, str], ...]
    groups: Ints
    middles: Floats
    middle_sigmas: Floats
    sizes: Floats
    size_sigmas: Floats
    texts: tuple[str, ...]
    misread: Floats

    def __len__(self) -> int:
        return len(self.structures)

    def is_post(self, k: int) -> bool:
        """Whether an element stands on the floor and is slender."""
        width, height, depth = self.sizes[k].tolist()
        return bool(self.middles[k, 1] - height / 2 <= FOOT_M and height >= SLENDER * max(width, depth))

    @property
    def plugins(self) -> NDArray[np.object_]:
        """The plugins (n,) that the elements are of."""
        return np.array([self.kinds[group][0] for group in self.groups.tolist()], dtype=object)


def elements_of(structures: Mapping[str, Sequence[Structure]], kinds: Sequence[tuple[str, str]]) -> Elements:
    """Structures by plugin as elements of these kinds, in the order along x."""
    named = [(plugin, structure) for plugin, group in structures.items() for structure in group]
    named = [(plugin, structure) for plugin, structure in named if len(structure.vertices)]
    named.sort(key=lambda item: float(item[1].vertices[:, 0].mean()))
    boxes = [_box(structure) for _, structure in named]
    middles, middle_sigmas, sizes, size_sigmas = (np.array([box[k] for box in boxes]).reshape(-1, 3) for k in range(4))
    return Elements(
        tuple(structure for _, structure in named),
        tuple(kinds),
        np.array([kinds.index((plugin, structure.label)) for plugin, structure in named], dtype=np.int64),
        middles,
        middle_sigmas,
        sizes,
        size_sigmas,
        tuple(_text(structure) for _, structure in named),
        np.array([_misread(structure) for _, structure in named], dtype=np.float64),
    )


def kinds_of(*rows: Mapping[str, Sequence[Structure]]) -> list[tuple[str, str]]:
    """The kinds (plugin, label) of structures by plugin."""
    return sorted({(plugin, structure.label) for row in rows for plugin, group in row.items() for structure in group})


def _box(structure: Structure) -> tuple[Floats, Floats, Floats, Floats]:
    """Middle, its standard deviations, size, its standard deviations (3,) along the axes: from the means of the
    vertices on either side. Errors of the two sides are taken for equal where the middle is concerned, and for
    independent where the size is."""
    spread = np.diagonal(structure.covariances, axis1=1, axis2=2)
    ends = sides(structure.vertices)
    low, high = (np.take_along_axis(structure.vertices, side, 0).mean(axis=0) for side in ends)
    of_low, of_high = (np.take_along_axis(spread, side, 0).mean(axis=0) for side in ends)
    sigma = (np.sqrt(of_low) + np.sqrt(of_high)) / 2
    size_sigma = np.sqrt(of_low + of_high)
    size = high - low
    for value, given_sigma in measured(structure).values():
        same = np.abs(size - value) < SAME_SIZE_M
        size_sigma = np.where(same & (size > SAME_SIZE_M), given_sigma, size_sigma)
    return (low + high) / 2, sigma, size, size_sigma


def sides(vertices: Floats) -> tuple[Ints, Ints]:
    """The numbers (n // 2, 3) of the vertices (n, 3) on the low and on the high side along each axis; of one vertex,
    itself on both."""
    order = np.argsort(vertices, axis=0, kind="stable")
    half = max(len(vertices) // 2, 1)
    return order[:half], order[-half:]


def measured(structure: Structure) -> dict[str, tuple[float, float]]:
    """The attributes in metres that have a standard deviation, such as `width_m` beside `width_sigma_m`: value and
    sigma by name."""
    figures = {}
    for name, value in structure.attributes.items():
        if not name.endswith("_m") or isinstance(value, str) or name.endswith("_sigma_m"):
            continue
        sigma = value.sigma if isinstance(value, Measured) else structure.attributes.get(f"{name[:-2]}_sigma_m")
        if isinstance(sigma, int | float) and sigma > 0:
            figures[name] = (float(value), float(sigma))
    return figures


def _text(structure: Structure) -> str:
    return next((str(structure.attributes[name]) for name in WRITTEN if structure.attributes.get(name)), "")


def _misread(structure: Structure) -> float:
    """The chance that a text is misread, by the attribute `confidence`, where there is one."""
    confidence = structure.attributes.get("confidence", 1.0)
    sure = float(confidence) if isinstance(confidence, int | float) else 1.0
    return 1 - min(max(sure, 0.0), SURE)


@dataclass(frozen=True, eq=False)
@array_record
class Coverage:
    """What of a row the camera passed: by plugin that was asked, places (n,) m along x, from each of which it sees
    `reach_m` far to either side."""

    places: Mapping[str, Floats]
    reach_m: float

    def has(self, plugin: str, x: float, size: float) -> bool:
        """Whether a plugin would have found something of a size along x, with its middle there."""
        return bool(self.shows(plugin, np.array([x]), np.array([size]))[0])

    def shows(self, plugin: str, x: Floats, sizes: Floats, reach: Floats | float = 1.0) -> Bools:
        """The same of n middles and sizes (n,), for `reach` times as far."""
        places = np.sort(self.places.get(plugin, np.zeros(0)))
        if not len(places):
            return np.zeros(len(x), dtype=np.bool_)
        ends = x[:, None] + sizes[:, None] * np.array([-0.5, 0.0, 0.5])
        after = np.clip(np.searchsorted(places, ends), 0, len(places) - 1)
        off = np.minimum(np.abs(ends - places[after]), np.abs(ends - places[np.maximum(after - 1, 0)]))
        return np.asarray(off.max(axis=1) <= self.reach_m * reach)

    def moved(self, scale: float, shift_m: float = 0.0) -> "Coverage":
        """The same in a frame of another scale and origin along x."""
        return Coverage({name: scale * x + shift_m for name, x in self.places.items()}, scale * self.reach_m)


def coverage_of(row: RowMap, elements: Elements) -> Coverage:
    """From the camera's places, and, for each plugin, from what it mapped. A row that is filmed in part goes on where
    the path ends, so that only what was passed whole counts as seen."""
    poses = row.trajectory.world_from_rig
    reach = LEAST_REACH_M
    if len(poses):
        reach = max(REACH_SHARE * float(np.median(np.abs(poses[:, 2, 3]))), LEAST_REACH_M)
    ends = [elements.middles[:, 0] + side * elements.sizes[:, 0] / 2 for side in (-1, 0, 1)]
    return Coverage(
        {
            name: np.concatenate([poses[:, 0, 3], *(x[elements.plugins == name] for x in ends)])
            for name in row.structures
        },
        reach,
    )
