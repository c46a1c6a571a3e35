"""A test whether the picture of a part of a plane shows that plane, or an object far behind it, through an opening.

A level edge along the camera's path stays at the same place of the plane in all frames, also where it lies behind the plane. The
evidence in the plane does not smear it. Supports, ends and marks, which cross the edge, do move from frame to frame.

The test warps the frames' pictures of the part to a range of depths (each is shrunk towards its camera). The pictures correlate at the
depth that most of the part has. Where that depth is far behind the plane, and the pictures do not correlate in the plane, the part is
an opening. A part that is opaque hides all that lies behind it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.types import Bools, Floats, PlanePatch, Trajectory, ViewSpec, array_record
from savmap.vision.evidence.depth import ASLANT, LEAST_SHOTS, MOST_SHOTS, Shot, near_cameras
from savmap.vision.evidence.planes import BORDER_PX, PackedView

Singles = NDArray[np.float32]

CELL = 0.005
"""The side of a cell, as a share of the camera's distance: 1 cm at 2 m."""
FINER = 3
"""Pictures are sampled so much finer than cells along the part, and averaged."""
LEAST_ROWS, LEAST_COLUMNS = 2, 40
DETAIL = 20.0
"""Changes along the part over more cells than that are shading. They say nothing of the depth and are removed."""
IN_PLANE = np.arange(0.0, 0.05, 0.003)
BEHIND = np.arange(0.15, 0.6, 0.005)
"""Parallax that is tried, as a share of the offset from the camera: 0.15 is 35 cm behind a plane that is 2 m away, 0.6 is 3 m."""
TRIM = np.array([1.0, 0.12])
"""Margins at an object's ends and at its edges, in heights of the object: other objects may show there."""
LEAST_SLENDER = 5.0
LEAST_CORRELATION, LEAST_RISE, LEAST_CONTRAST = 0.3, 0.2, 2.5
"""An opening: least correlation of the pictures behind the plane, its least excess over that in the plane, and least contrast, grey levels."""


def lies_behind(
    part: PlanePatch, packed_views: Sequence[PackedView], views: Mapping[str, ViewSpec], path: Trajectory
) -> bool:
    """Whether the picture of a part of a plane surely shows what lies far behind it. False where the pictures do not decide it.

    `part` is longer along `right`, the direction of travel, than it is high, and `right` x `up` points to the camera. Its unit is that of
    `path`.
    """
    strip = Strip.of(part, _shots(part, packed_views, views, path))
    if strip is None or strip.contrast < LEAST_CONTRAST:
        return False
    behind = max(strip.correlation(share) for share in BEHIND.tolist())
    if behind <= LEAST_CORRELATION:
        return False
    return behind - max(strip.correlation(share) for share in IN_PLANE.tolist()) > LEAST_RISE


def inner_part(outline: Floats, planes: Sequence[PlanePatch]) -> PlanePatch | None:
    """The inside of an object's outline (n, 3), as a part of the plane that is nearest to it. Margins keep it away from the object's neighbours.

    None for an object that does not run along the plane's `right`: the evidence in the plane smears such an object anyway if it lies behind.
    """
    if not planes:
        return None
    plane = min(planes, key=lambda patch: float(np.abs((outline - patch.origin) @ patch.axes[:, 2]).max()))
    in_plane = (outline - plane.origin) @ plane.axes[:, :2]
    low, high = in_plane.min(axis=0), in_plane.max(axis=0)
    width, tall = (high - low).tolist()
    if width < LEAST_SLENDER * tall:
        return None
    low, high = low + tall * TRIM, high - tall * TRIM
    return replace(plane, origin=plane.origin + low[0] * plane.right + low[1] * plane.up, size=high - low)


def _shots(
    part: PlanePatch, packed_views: Sequence[PackedView], views: Mapping[str, ViewSpec], path: Trajectory
) -> list[tuple[Shot, PackedView]]:
    poses = dict(zip(path.frames.tolist(), path.world_from_rig, strict=True))
    known = [packed_view for packed_view in packed_views if packed_view.frame in poses]
    cameras = np.array([poses[packed_view.frame][:3, 3] for packed_view in known]).reshape(-1, 3)
    near = [known[k] for k in near_cameras(part, cameras)]
    return [
        (Shot.of(packed_view, views[packed_view.view], poses[packed_view.frame], part), packed_view)
        for packed_view in near
    ]


@dataclass(frozen=True, eq=False)
@array_record
class Strip:
    """The pictures (shots, rows, columns) of a part on its plane: detail along the part, 0 where it is not `visible` (shots, columns).
    `cameras` (shots,): the column that each camera is in front of."""

    pictures: Singles
    visible: Bools
    cameras: Floats

    @classmethod
    def of(cls, part: PlanePatch, shots: Sequence[tuple[Shot, PackedView]]) -> "Strip | None":
        """The part in shots, each with its packed view. None where too few shots show the part, or where it is too small."""
        distance, height = (float(np.median([shot.place[axis] for shot, _ in shots] or [0.0])) for axis in (2, 1))
        cell = CELL * distance
        rows, columns = (int(side / max(cell, 1e-9)) for side in part.size[::-1].tolist())
        if rows < LEAST_ROWS or columns < LEAST_COLUMNS:
            return None
        cells = _Cells(part, cell, rows, columns)
        laid = [(cells.visible_columns(shot, distance, height), shot, packed_view) for shot, packed_view in shots]
        laid = [entry for entry in laid if entry[0].sum() >= LEAST_COLUMNS]
        if len(laid) < LEAST_SHOTS:
            return None
        laid = [
            laid[k] for k in np.unique(np.linspace(0, len(laid) - 1, min(len(laid), MOST_SHOTS)).astype(int)).tolist()
        ]
        visible = np.array([columns_shown for columns_shown, _, _ in laid])
        pictures = np.array([cells.picture(shot, packed_view, distance, height) for _, shot, packed_view in laid])
        cameras = np.array([shot.place[0] / cell - 0.5 for _, shot, _ in laid])
        return cls(_detail(pictures, visible), visible, cameras)

    @property
    def contrast(self) -> float:
        """The root mean square of the detail, grey levels."""
        cells = max(int(self.visible.sum()) * self.pictures.shape[1], 1)
        return float(np.sqrt(np.square(self.pictures).sum() / cells))

    def correlation(self, share: float) -> float:
        """The mean correlation of all pairs of pictures, if each is shrunk towards its camera's column by `share` of the offset from it."""
        _, rows, count = self.pictures.shape
        reach = np.array([0.0, count - 1.0])[:, None]
        ends = (reach - share * self.cameras) / (1 - share)
        positions = np.arange(np.floor(ends.min()), np.ceil(ends.max()) + 1)
        columns = (positions * (1 - share) + share * self.cameras[:, None]).astype(np.float32)
        row = np.broadcast_to(np.arange(rows, dtype=np.float32)[:, None], (rows, len(positions)))
        total, energy = np.zeros((2, rows, len(positions)))
        frames = np.zeros(len(positions))
        for picture, visible, column in zip(self.pictures, self.visible, columns, strict=True):
            within = (column >= 0) & (column <= count - 1)
            within &= visible[np.clip(np.round(column).astype(int), 0, count - 1)]
            moved = cv2.remap(picture, np.tile(column, (rows, 1)), np.ascontiguousarray(row), cv2.INTER_LINEAR) * within
            total += moved
            energy += np.square(moved)
            frames += within
        enough = frames >= LEAST_SHOTS
        pairs = (np.square(total) - energy)[:, enough] / np.maximum(frames[enough] - 1, 1)
        return float(pairs.sum() / max(float(energy[:, enough].sum()), 1e-9))


@dataclass(frozen=True, eq=False)
class _Cells:
    """A part in `rows` by `columns` cells of a side."""

    part: PlanePatch
    cell: float
    rows: int
    columns: int

    def visible_columns(self, shot: Shot, distance: float, height: float) -> Bools:
        """The columns (n,) that a shot shows from top to bottom, at an angle of view that is not too oblique."""
        x = (np.arange(self.columns) + 0.5) * self.cell
        ends = np.array([(along, up, 1.0) for up in (0.0, float(self.part.size[1])) for along in x])
        u, v, depth = shot.pixels_from_part @ ends.T
        u, v = u / np.maximum(depth, 1e-9), v / np.maximum(depth, 1e-9)
        inside = (depth > 0) & (np.minimum(u, v) > BORDER_PX)
        inside &= (u < shot.spec.width - 1 - BORDER_PX) & (v < shot.spec.height - 1 - BORDER_PX)
        aslant = np.abs(x - shot.place[0]) > ASLANT * shot.place[2]
        return np.asarray(inside.reshape(2, -1).all(axis=0) & ~aslant)

    def picture(self, shot: Shot, packed_view: PackedView, distance: float, height: float) -> Singles:
        """The shot on the plane (rows, columns), grey. The camera's own distance and height do not move the part's edges."""
        fine, up = self.cell / FINER, float(self.part.size[1]) / self.rows
        grid = np.array([[fine, 0.0, fine / 2], [0.0, -up, up * (self.rows - 0.5)], [0.0, 0.0, 1.0]])
        homography = shot.pixels_from_part @ grid
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        size = (self.columns * FINER, self.rows)
        laid = cv2.warpPerspective(packed_view.grey().astype(np.float32), homography, size, flags=flags)
        return np.asarray(laid.reshape(self.rows, self.columns, FINER).mean(axis=2), np.float32)


def _detail(pictures: Singles, visible: Bools) -> Singles:
    """The detail of pictures (shots, rows, columns): slow changes along the columns are removed. 0 where not visible (shots, columns)."""
    shown = np.broadcast_to(visible[:, None], pictures.shape).astype(np.float32)
    usual = _smoothed(pictures * shown) / np.maximum(_smoothed(shown), 1e-3)
    return np.asarray((pictures - usual) * shown, np.float32)


def _smoothed(pictures: Singles) -> Singles:
    flat = pictures.reshape(-1, 1, pictures.shape[-1])
    return np.array([cv2.GaussianBlur(row, (0, 0), sigmaX=DETAIL, sigmaY=1e-3) for row in flat]).reshape(pictures.shape)
