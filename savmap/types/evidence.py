"""Records of evidence: a rectangle of a plane in the row's frame, what a network saw there on average, what was found
there, and how deep flat parts lie."""

from dataclasses import dataclass, replace
from functools import cached_property
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from savmap.types.common import Axis, Floats, Ints, array_record, require


@dataclass(frozen=True, eq=False)
@array_record
class PlanePatch:
    """A rectangle of a plane in the row's frame, in square cells.

    `origin` (3,) is its lower left corner; `right` and `up` (3,) are unit vectors along its sides; `size` (2,) is its
    width and height, and `cell` the side of a cell, all in the unit of the camera's path: metres where references give
    its scale. Row 0 of the cells is at the top.
    """

    name: str
    origin: Floats
    right: Floats
    up: Floats
    size: Floats
    cell: float

    def __post_init__(self) -> None:
        require(self.cell > 0 and bool(np.all(np.asarray(self.size) > 0)), self, "size and cell must be positive")
        numbers, sides = [*self.origin, *self.size, self.cell], np.array([self.right, self.up])
        require(all(map(isfinite, numbers)), self, f"a number of `{self.name}` is not finite")
        level = np.allclose(sides @ sides.T, np.eye(2), atol=1e-6)
        require(level, self, f"right and up of `{self.name}` are not orthonormal")

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of cells."""
        columns, rows = np.ceil(self.size / self.cell).astype(int).tolist()
        return max(rows, 1), max(columns, 1)

    @cached_property
    def axes(self) -> Floats:
        """Right, up and the side that it faces, as columns (3, 3)."""
        return np.stack([self.right, self.up, np.cross(self.right, self.up)], axis=1)

    @cached_property
    def across(self) -> Floats:
        """Distance of each column's middle from the left side (columns,)."""
        return np.asarray((np.arange(self.shape[1]) + 0.5) * self.cell)

    @cached_property
    def heights(self) -> Floats:
        """Distance of each row's middle from the lower side (rows,)."""
        return np.asarray((np.arange(self.shape[0])[::-1] + 0.5) * self.cell)

    def around(self, points: Floats, room: float) -> "PlanePatch":
        """The part of it around points (n, 3), with some room on all sides as far as it reaches."""
        along = (points - self.origin) @ np.stack([self.right, self.up], axis=1)
        low = np.clip(along.min(axis=0) - room, 0.0, self.size - self.cell)
        high = np.clip(along.max(axis=0) + room, low + self.cell, self.size)
        return replace(self, origin=self.origin + low[0] * self.right + low[1] * self.up, size=high - low)

    def points(self) -> Floats:
        """The cells' middles (rows, columns, 3) in the row's frame."""
        points: Floats = self.origin + self.heights[:, None, None] * self.up + self.across[None, :, None] * self.right
        return points


@dataclass(frozen=True, eq=False)
@array_record
class PlaneEvidence:
    """What the pictures show of a patch on average: `mean` (classes, rows, columns) are the classes' probabilities,
    `weight` (rows, columns) how much was seen of a cell (0: nothing), and `picture` (rows, columns, 3) uint8 RGB the
    patch itself."""

    patch: PlanePatch
    classes: tuple[str, ...]
    mean: NDArray[np.float32]
    weight: NDArray[np.float32]
    picture: NDArray[np.uint8]

    def of(self, label: str) -> NDArray[np.float32]:
        """The mean probability (rows, columns) of a class."""
        return np.asarray(self.mean[self.classes.index(label)])


@dataclass(frozen=True, eq=False)
@array_record
class FoundObject:
    """An object that the evidence of all frames shows: its `id`, the name of its structure in the map; its class; its
    `outline` (n, 3) in the row's frame, in the unit of the path; and the `probability` that it exists. What is less
    likely than not is not mapped."""

    id: str
    label: str
    outline: Floats
    probability: float

    def __post_init__(self) -> None:
        require(self.outline.ndim == 2 and self.outline.shape[1] == 3, self, "outline must be (n, 3)")
        require(bool(np.isfinite(self.outline).all()), self, f"a corner of `{self.id}` is not finite")
        require(0 <= self.probability <= 1, self, "probability must be within 0 and 1")

    @property
    def is_mapped(self) -> bool:
        """Whether it is more likely there than not."""
        return self.probability >= 0.5


@dataclass(frozen=True, eq=False)
@array_record
class FlatParts:
    """Flat parts of a structure that lie in one plane across an axis of the row's frame. What shows on them may tell
    how deep it lies.

    `landmark` is one of the plugin's own, whose coordinate along `axis` is the plane's. `parts` are rectangles where
    the parts were seen, in the plane as it is known so far, with sides that are parallel from part to part; `right` x
    `up` points to the camera, along the axis or against it. Their numbers are in the unit of the path. What shows on
    the parts stands out from them by `proud_m` +- `proud_sigma_m`.
    """

    landmark: str
    axis: Axis
    parts: tuple[PlanePatch, ...]
    proud_m: float = 0.0
    proud_sigma_m: float = 0.0005

    def __post_init__(self) -> None:
        finite = isfinite(self.proud_m) and isfinite(self.proud_sigma_m)
        require(finite and self.proud_sigma_m > 0, self, "proud_m must be finite, proud_sigma_m positive")
        for part in self.parts:
            same = np.allclose([part.right, part.up], [self.parts[0].right, self.parts[0].up], atol=1e-6)
            across = bool(abs(part.axes[self.column, 2]) > 1 - 1e-6)
            require(same and across, self, f"`{part.name}` is not parallel to the others, across {self.axis}")

    @property
    def column(self) -> int:
        """0, 1 or 2 for x, y or z."""
        return ("x", "y", "z").index(self.axis)


@dataclass(frozen=True, eq=False)
@array_record
class FlatDepth:
    """How deep flat parts of a plugin lie: the coordinate of what shows on them is `share` +- `sigma` of the camera's
    mean coordinate along the same axis in `frames` (n,), for no reference has given the path its scale yet. `sections`:
    how many sections of the parts say so. `proud_m` +- `proud_sigma_m`: how far along the axis what shows on the parts
    stands out from them."""

    plugin: str
    landmark: str
    axis: Axis
    share: float
    sigma: float
    frames: Ints
    sections: int
    proud_m: float
    proud_sigma_m: float

    def metres(self, mean_m: float) -> tuple[float, float]:
        """The parts' coordinate and its sigma, m, where the camera's mean coordinate is so many metres."""
        return self.share * mean_m - self.proud_m, float(np.hypot(self.sigma * mean_m, self.proud_sigma_m))
