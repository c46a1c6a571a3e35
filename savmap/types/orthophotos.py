"""Records of orthophotos: the upright strips that are cut from panoramas for them, and the picture of a face in
metres."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from savmap.types.common import Floats, array_record, require
from savmap.types.pictures import ViewSpec


@dataclass(frozen=True, eq=False)
@array_record
class Strip:
    """What a panorama showed straight ahead of the face: its frame, the name of the view that was cut, and the picture
    (n,) uint8, the bytes of a JPEG."""

    frame: int
    view: str
    picture: NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
@array_record
class Still:
    """A panorama that is kept to be looked at: its frame, and the picture (n,) uint8, the bytes of a JPEG, smaller than
    the frame."""

    frame: int
    picture: NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
@array_record
class RowStrips:
    """The strips of a row, in the order of its frames, and the views that they are by name; and whole panoramas of some
    of the frames."""

    views: Mapping[str, ViewSpec] = field(default_factory=dict)
    strips: tuple[Strip, ...] = ()
    stills: tuple[Still, ...] = ()


@dataclass(frozen=True, eq=False)
@array_record
class Orthophoto:
    """A face as all frames show it, without perspective.

    `origin` (3,) m is the lower left corner of the picture in the row's frame; `right` and `up` (3,) are unit vectors
    along its sides; `pixel_m` is the side of a pixel. `width` and `height` are in pixels, and `picture` (n,) uint8
    holds the bytes of a JPEG.
    """

    origin: Floats
    right: Floats
    up: Floats
    pixel_m: float
    width: int
    height: int
    picture: NDArray[np.uint8]

    def __post_init__(self) -> None:
        require(self.pixel_m > 0 and self.width > 0 and self.height > 0, self, "sizes must be positive")

    @property
    def face_from_pixel(self) -> Floats:
        """Transform (3, 3) from (column, row, 1), whole at pixels' centres, to (metres along `right`, along `up`,
        1)."""
        half = self.pixel_m / 2
        return np.array([[self.pixel_m, 0, half], [0, -self.pixel_m, self.pixel_m * self.height - half], [0, 0, 1]])

    def on_picture(self, points: Floats) -> Floats:
        """Places (n, 2) of points (n, 3) m of the row: pixels to the right of and below the picture's upper left
        corner."""
        along = (points - self.origin) @ np.stack([self.right, self.up], axis=1) / self.pixel_m
        return np.stack([along[:, 0], self.height - along[:, 1]], axis=1)


@dataclass(frozen=True, eq=False)
@array_record
class FaceDepths:
    """How well what a face's strips show suits each depth behind it, cell by cell.

    `origin` (3,) m is the lower left corner in the row's frame; `right` and `up` (3,) are unit vectors along the sides,
    `cell` the side of a cell, m; row 0 is at the top. `depths` (k,) m: of the planes, behind the face; `scores` (k,
    rows, columns): how well frames agree there, about -1 to 1, 0 where nothing tells. `cameras` (rows, columns, 3) m:
    from where each cell is seen, to the right of the origin, up, and in front; NaN where it is not.
    """

    origin: Floats
    right: Floats
    up: Floats
    cell: float
    depths: Floats
    scores: NDArray[np.float32]
    cameras: Floats
