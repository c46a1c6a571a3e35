"""Orthophotos: a face mosaicked from the strips of all frames, on its plane, once the camera's path is solved.

An average over many frames is sharp only in the plane itself, and goods stand before or behind it. So each cell is
taken from the frame that shows it under the largest solid angle: near and frontal. Frames are blended only along the
seams between them. Their exposures are equalised in the overlap of neighbours.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain, pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.types import Floats, Orthophoto, PlanePatch, RowStrips, Strip, Trajectory, ViewSpec, array_record

Bytes = NDArray[np.uint8]
Singles = NDArray[np.float32]

FINEST_M, STEP_M = 0.005, 0.0005
MOST_PX = 8000
COARSE_M = 0.025
"""Seams are chosen in cells of this size, well below the distance between frames."""
FEATHER_M = 0.05
EXPOSED_CELLS = 4
"""Exposures are compared in cells that are so many times as wide."""
REACH = 1.2
BORDER_PX = 1.5
REDUCED = 4
DARK, BRIGHT, LEAST_SHARED = 10, 245, 40
GAIN_PRIOR, MOST_GAIN = 0.01, 2.0
JPEG_QUALITY = 88


def orthophoto(face: PlanePatch, strips: RowStrips, path: Trajectory) -> Orthophoto | None:
    """The orthophoto of a face, from strips whose frames were taken along a path. Face and path are in metres. None
    where no strip shows it.

    A pixel is `FINEST_M` wide, or as wide as a strip's pixel on the face if that is more. It is wider where the picture
    would be too large.
    """
    shots = list(shots_of(face, strips, path))
    if not shots:
        return None
    canvas = Canvas.over(face, pixel_m(face, shots))
    owners = canvas.owners(shots)
    part = canvas.cropped(owners)
    if part is None:
        return None
    canvas, owners = part
    return canvas.photo(blended(canvas, owners, shots, gains(canvas.coarser(EXPOSED_CELLS), shots)))


@dataclass(frozen=True, eq=False)
@array_record
class Shot:
    """A strip, its view, and the camera's place (3,) m: to the right of the face's origin, up, and in front of it."""

    strip: Strip
    spec: ViewSpec
    place: Floats
    pixels_from_face: Floats
    """(3, 3), homogeneous, from (right, up, 1) m."""

    @property
    def pixel_m(self) -> float:
        """The width, m, of a pixel of the strip on the face straight ahead."""
        return abs(float(self.place[2])) / float(self.spec.camera[0, 0])

    def image(self) -> Bytes:
        """The picture (height, width, 3), BGR."""
        return np.asarray(cv2.imdecode(self.strip.picture, cv2.IMREAD_COLOR), np.uint8)

    def grey(self) -> Bytes:
        """The picture (height, width), grey."""
        return np.asarray(cv2.imdecode(self.strip.picture, cv2.IMREAD_GRAYSCALE), np.uint8)

    @cached_property
    def small(self) -> Bytes:
        """The picture at a quarter of its resolution, BGR."""
        return np.asarray(cv2.imdecode(self.strip.picture, cv2.IMREAD_REDUCED_COLOR_4), np.uint8)


def shots_of(face: PlanePatch, strips: RowStrips, path: Trajectory) -> Iterator[Shot]:
    """A shot for each strip whose frame has a pose."""
    poses = dict(zip(path.frames.tolist(), path.world_from_rig, strict=True))
    axes = np.stack([face.right, face.up, np.cross(face.right, face.up)], axis=1)
    for strip in strips.strips:
        if strip.frame not in poses:
            continue
        spec, pose = strips.views[strip.view], poses[strip.frame]
        place = (pose[:3, 3] - face.origin) @ axes
        view_from_face = (pose[:3, :3] @ spec.rig_from_view).T @ axes
        plane = np.column_stack([view_from_face[:, 0], view_from_face[:, 1], -view_from_face @ place])
        yield Shot(strip, spec, place, spec.camera @ plane)


def pixel_m(face: PlanePatch, shots: Sequence[Shot]) -> float:
    """The side of the picture's pixels, m, in whole steps."""
    resolved = float(np.median([shot.pixel_m for shot in shots]))
    least = max(FINEST_M, resolved, float(np.max(face.size)) / MOST_PX)
    return float(np.ceil(round(least / STEP_M, 6)) * STEP_M)


@dataclass(frozen=True, eq=False)
@array_record
class Canvas:
    """The cells of a face, `rows` by `columns` from the upper left, for the choice of seams. A cell has `times` by
    `times` pixels of `pixel` m. `corner` (2,) m: the lower left corner of the canvas, right of and above the face's
    origin."""

    face: PlanePatch
    pixel: float
    times: int
    rows: int
    columns: int
    corner: Floats

    @classmethod
    def over(cls, face: PlanePatch, pixel: float) -> "Canvas":
        """As much of a face as whole cells cover."""
        times = max(2, round(COARSE_M / pixel))
        columns, rows = np.maximum(np.asarray(face.size) / (times * pixel), 1).astype(int).tolist()
        return cls(face, pixel, times, rows, columns, np.zeros(2))

    def coarser(self, times: int) -> "Canvas":
        """The same part of the face, to less than a cell, in cells that are `times` as wide."""
        rows, columns = max(self.rows // times, 1), max(self.columns // times, 1)
        return replace(self, times=times * self.times, rows=rows, columns=columns)

    @property
    def cell(self) -> float:
        """The side of a cell, m."""
        return self.times * self.pixel

    @property
    def across(self) -> Floats:
        """Metres (columns,) right of the face's origin."""
        return np.asarray(self.corner[0] + (np.arange(self.columns) + 0.5) * self.cell)

    @property
    def heights(self) -> Floats:
        """Metres (rows,) above the face's origin."""
        return np.asarray(self.corner[1] + (np.arange(self.rows)[::-1] + 0.5) * self.cell)

    def near(self, shot: Shot) -> slice:
        """The columns near enough to a shot to be in it."""
        reach = REACH * abs(float(shot.place[2]))
        first, last = np.searchsorted(self.across, [shot.place[0] - reach, shot.place[0] + reach]).tolist()
        return slice(int(first), int(last))

    def shares(self, shot: Shot, columns: slice) -> Singles:
        """The solid angle (rows, columns) under which a shot shows each cell, per m^2; 0 where it does not."""
        across, heights = np.meshgrid(self.across[columns], self.heights)
        x, y, depth = np.tensordot(shot.pixels_from_face, np.stack([across, heights, np.ones_like(across)]), 1)
        x, y = x / np.maximum(depth, 1e-9), y / np.maximum(depth, 1e-9)
        inside = (depth > 0) & (np.minimum(x, y) > BORDER_PX)
        inside &= (x < shot.spec.width - 1 - BORDER_PX) & (y < shot.spec.height - 1 - BORDER_PX)
        away = abs(float(shot.place[2]))
        distance_squared = np.square(across - shot.place[0]) + np.square(heights - shot.place[1]) + away**2
        return np.where(inside, away / distance_squared**1.5, 0.0).astype(np.float32)

    def owners(self, shots: Sequence[Shot]) -> NDArray[np.int32]:
        """The number (rows, columns) of the shot that shows each cell best; -1 where none does."""
        best = np.zeros((self.rows, self.columns), np.float32)
        owners = np.full(best.shape, -1, np.int32)
        for number, shot in enumerate(shots):
            columns = self.near(shot)
            shares = self.shares(shot, columns)
            better = shares > best[:, columns]
            best[:, columns][better] = shares[better]
            owners[:, columns][better] = number
        return owners

    def cropped(self, owners: NDArray[np.int32]) -> "tuple[Canvas, NDArray[np.int32]] | None":
        """The smallest canvas around all cells that have an owner, and its owners. None where no cell has one."""
        if (owners < 0).all():
            return None
        rows, columns = _around(owners >= 0, 0)
        corner = self.corner + self.cell * np.array([columns.start, self.rows - rows.stop])
        part = replace(self, rows=rows.stop - rows.start, columns=columns.stop - columns.start, corner=corner)
        return part, owners[rows, columns]

    def face_from_part(self, top: int, left: int, size: float) -> Floats:
        """Transform (3, 3) from (column, row, 1) of a picture with pixels of `size` m, whose upper left corner is that
        of a cell, to (right, up, 1) m on the face."""
        x, y = self.corner + self.cell * np.array([left, self.rows - top])
        return np.array([[size, 0, x + size / 2], [0, -size, y - size / 2], [0, 0, 1.0]])

    def pixels_from_part(self, shot: Shot, top: int, left: int, size: float) -> Floats:
        """Homography (3, 3) from (column, row, 1) of a picture with pixels of `size` m, whose upper left corner is that
        of a cell, to pixels of a shot."""
        return np.asarray(shot.pixels_from_face @ self.face_from_part(top, left, size))

    def photo(self, picture: Bytes) -> Orthophoto:
        """The orthophoto of a picture (height, width, 3), BGR, of all cells."""
        origin = self.face.origin + self.corner[0] * self.face.right + self.corner[1] * self.face.up
        content = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1]
        height, width = picture.shape[:2]
        return Orthophoto(
            origin, self.face.right, self.face.up, self.pixel, width, height, np.asarray(content, np.uint8).ravel()
        )


def gains(canvas: Canvas, shots: Sequence[Shot]) -> Floats:
    """The gains (n, 3) of the shots' colours, by least squares, so that neighbours agree where they overlap."""
    order = sorted(range(len(shots)), key=lambda number: float(shots[number].place[0]))
    normal, right = GAIN_PRIOR * np.eye(len(shots)), np.zeros((len(shots), 3))
    for first, second in chain(pairwise(order), zip(order, order[2:], strict=False)):
        ratio = _ratio(canvas, shots[first], shots[second])
        if ratio is not None:
            normal[[first, second], [first, second]] += 1.0
            normal[[first, second], [second, first]] -= 1.0
            right[first] += ratio
            right[second] -= ratio
    return np.asarray(np.clip(np.exp(np.linalg.solve(normal, right)), 1 / MOST_GAIN, MOST_GAIN))


def _ratio(canvas: Canvas, first: Shot, second: Shot) -> Floats | None:
    """The median log ratio (3,) of the second shot's colours to the first's, in their overlap. None where that is too
    small."""
    first_columns, second_columns = canvas.near(first), canvas.near(second)
    columns = slice(max(first_columns.start, second_columns.start), min(first_columns.stop, second_columns.stop))
    if columns.start >= columns.stop:
        return None
    samples = [_sampled(canvas, shot, columns) for shot in (first, second)]
    well_exposed = [sample.max(axis=2) < BRIGHT for sample in samples] + [
        sample.min(axis=2) > DARK for sample in samples
    ]
    shared = np.logical_and.reduce(well_exposed)
    if np.count_nonzero(shared) < LEAST_SHARED:
        return None
    logs = [np.log(sample[shared].astype(np.float64)) for sample in samples]
    return np.asarray(np.median(logs[1] - logs[0], axis=0))


def _sampled(canvas: Canvas, shot: Shot, columns: slice) -> Bytes:
    """A shot's colours (rows, columns, 3) in cells; 0 where it does not show them."""
    smaller = np.array([[1, 0, 0.5 - REDUCED / 2], [0, 1, 0.5 - REDUCED / 2], [0, 0, REDUCED]]) / REDUCED
    matrix = smaller @ canvas.pixels_from_part(shot, 0, columns.start, canvas.cell)
    return _warped(shot.small, matrix, (columns.stop - columns.start, canvas.rows), cv2.INTER_LINEAR)


def blended(canvas: Canvas, owners: NDArray[np.int32], shots: Sequence[Shot], levels: Floats) -> Bytes:
    """The picture (height, width, 3), BGR: each shot in the cells that it owns, fading out beyond them."""
    size = canvas.rows * canvas.times, canvas.columns * canvas.times
    total, weight = np.zeros((*size, 3), np.float32), np.full(size, 1e-6, np.float32)
    fade = max(1, round(FEATHER_M / canvas.cell))
    for number in np.unique(owners[owners >= 0]).tolist():
        rows, columns = _around(owners == number, 2 * fade)
        share = _share(owners[rows, columns] == number, fade, canvas.times)
        part = slice(rows.start * canvas.times, rows.stop * canvas.times)
        across = slice(columns.start * canvas.times, columns.stop * canvas.times)
        matrix = canvas.pixels_from_part(shots[number], rows.start, columns.start, canvas.pixel)
        shown, inside = _shown(shots[number], matrix, share.shape)
        share = share * inside
        weight[part, across] += share
        total[part, across] += share[..., None] * (shown * levels[number].astype(np.float32))
    return np.asarray(np.clip(np.round(total / weight[..., None]), 0, 255), np.uint8)


def _around(owned: NDArray[np.bool_], margin: int) -> tuple[slice, slice]:
    """The rows and columns of the cells that are owned, and a margin of cells."""
    indices = [np.flatnonzero(owned.any(axis=axis)) for axis in (1, 0)]
    rows, columns = (
        slice(max(int(index[0]) - margin, 0), min(int(index[-1]) + 1 + margin, length))
        for index, length in zip(indices, owned.shape, strict=True)
    )
    return rows, columns


def _share(owned: NDArray[np.bool_], fade: int, times: int) -> Singles:
    """A shot's weight in each pixel: 1 in the cells that it owns, falling to 0 over `fade` cells around their
    border."""
    blurred = cv2.blur(owned.astype(np.float32), (2 * fade + 1, 2 * fade + 1), borderType=cv2.BORDER_REPLICATE)
    size = (owned.shape[1] * times, owned.shape[0] * times)
    return np.asarray(cv2.resize(blurred, size, interpolation=cv2.INTER_LINEAR), np.float32)


def _shown(shot: Shot, matrix: Floats, shape: tuple[int, ...]) -> tuple[Bytes, Singles]:
    """A shot warped to `shape`: pixels (h, w, 3), BGR, and whether the shot shows them (h, w), 1 or 0."""
    size = (shape[1], shape[0])
    full = np.ones((shot.spec.height, shot.spec.width), np.uint8)
    inside = _warped(full, matrix, size, cv2.INTER_NEAREST)
    return _warped(shot.image(), matrix, size, cv2.INTER_CUBIC), inside.astype(np.float32)


def _warped(image: Bytes, matrix: Floats, size: tuple[int, int], interpolation: int) -> Bytes:
    return np.asarray(cv2.warpPerspective(image, matrix, size, flags=interpolation | cv2.WARP_INVERSE_MAP), np.uint8)
