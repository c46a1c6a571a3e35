"""Rows whose face is a real photograph: the face of a rectified photograph laid on a plane, with exact truth.

`photo_rows/faces.json` holds, for each face, where its photograph is found, and what was read off it:

- `corners`: where the corners of the rectified picture lie in the photograph (top left, top right, bottom right, bottom
  left), px from the outer corner of its first pixel; `radial`: its lens's distortion; `size_px` of the rectified picture.
- `pixels_a_metre` of the rectified picture; its lower border is the floor.
- `posts`: left and right edge of each post, px. `bays`: `span`, the columns between two posts that belong to the bay (a
  post's visible flank is left out), and its `beams` from the bottom up: bottom and top edge of the front, px from the top;
  a third number is where the beam's visible underside ends: it is squeezed out of the picture.
- `row`: post, bay, post, ... post: by which a row is put together.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.types import Floats

Picture = NDArray[np.uint8]
FACES = Path(__file__).parent / "photo_rows" / "faces.json"
_ROUNDS = 20
_FINE = 20


@dataclass(frozen=True)
class BayPicture:
    """One bay of a rectified picture, px: `span` of columns; `beams` (bottom, top, below, above) from the bottom up, where what
    is between `above` and `top` and between `bottom` and `below` is left out; rows `without`, which are left out as well; on which
    side its mirror image follows."""

    span: tuple[float, float]
    beams: tuple[tuple[float, float, float, float], ...]
    without: tuple[tuple[float, float], ...] = ()
    mirrored: str = ""


@dataclass(frozen=True)
class Face:
    """One face of `faces.json`."""

    name: str
    entry: Mapping[str, Any]
    corners: tuple[tuple[float, float], ...]
    radial: float
    size_px: tuple[int, int]
    pixels_a_metre: float
    posts: tuple[tuple[float, float], ...]
    bays: tuple[BayPicture, ...]
    row: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class PhotoRow:
    """The picture (h, w, 3) RGB of a whole row, its `size` (length, height) in m, and the truth: x of the posts' edges and,
    for each bay, y of the beams' edges, m."""

    picture: Picture
    size: tuple[float, float]
    posts: tuple[tuple[float, float], ...]
    beams: tuple[tuple[tuple[float, float], ...], ...]


def read_faces(path: Path = FACES) -> dict[str, Face]:
    """The faces by name."""
    return {entry["name"]: _face(entry) for entry in json.loads(path.read_text(encoding="utf-8"))["faces"]}


def _face(entry: Mapping[str, Any]) -> Face:
    bays = [_bay_picture(bay) for bay in entry["bays"]]
    return Face(
        name=entry["name"],
        entry=entry,
        corners=tuple(map(tuple, entry["corners"])),
        radial=entry["radial"],
        size_px=tuple(entry["size_px"]),
        pixels_a_metre=entry["pixels_a_metre"],
        posts=tuple(map(tuple, entry["posts"])),
        bays=tuple(bays),
        row=tuple(entry["row"]),
    )


def _bay_picture(entry: Mapping[str, Any]) -> BayPicture:
    beams, without = tuple(map(_beam, entry["beams"])), tuple(map(tuple, entry.get("without", ())))
    return BayPicture(tuple(entry["span"]), beams, without, entry.get("mirrored", ""))


def _beam(numbers: Sequence[float]) -> tuple[float, float, float, float]:
    bottom, top, below, above = [*numbers, *(numbers[0], numbers[1])[len(numbers) - 2 :]]
    return bottom, top, below, above


def photo_row(face: Face, photo: Picture) -> PhotoRow:
    """A row of a face from its photograph (h, w, 3) RGB."""
    parts: dict[tuple[bool, int], Picture] = {}
    cells = [(place % 2 == 1, number) for place, number in enumerate(face.row)]
    for is_bay, number in cells:
        if (is_bay, number) not in parts:
            parts[is_bay, number] = _bay(face, number, photo) if is_bay else _post(face, number, photo)
    strips = [parts[cell] for cell in cells]
    ends = np.cumsum([0, *(strip.shape[1] for strip in strips)]) / face.pixels_a_metre
    posts = tuple((float(ends[at]), float(ends[at + 1])) for at in range(0, len(cells), 2))
    beams = tuple(beams_m(face, number) for is_bay, number in cells if is_bay)
    picture = np.hstack(strips)
    return PhotoRow(picture, (float(ends[-1]), face.size_px[1] / face.pixels_a_metre), posts, beams)


def beams_m(face: Face, bay: int) -> tuple[tuple[float, float], ...]:
    """y of bottom and top edges of a bay's beams, m above the floor."""
    height = face.size_px[1]
    return tuple(
        ((height - beam[0]) / face.pixels_a_metre, (height - beam[1]) / face.pixels_a_metre)
        for beam in face.bays[bay].beams
    )


def _post(face: Face, number: int, photo: Picture) -> Picture:
    rows: Floats = np.arange(face.size_px[1]) + np.float64(0.5)
    return _seen(face, photo, _columns(face.posts[number]), rows)


def _bay(face: Face, number: int, photo: Picture) -> Picture:
    bay = face.bays[number]
    seen = _seen(face, photo, _columns(bay.span), squeezed(bay, face.size_px[1]))
    if not bay.mirrored:
        return seen
    return np.hstack([seen, seen[:, ::-1]] if bay.mirrored == "right" else [seen[:, ::-1], seen])


def _columns(span: tuple[float, float]) -> Floats:
    """Middles of the columns (n,) of a strip, px of the rectified picture: a whole number of them fills the span."""
    count = round(span[1] - span[0])
    columns: Floats = span[0] + (np.arange(count) + 0.5) * (span[1] - span[0]) / count
    return columns


def squeezed(bay: BayPicture, height: int) -> Floats:
    """Rows (height,) of the rectified picture that a bay's rows show: what lies between two fronts is stretched over what is
    left out between them."""
    kept, ends = np.ones(height * _FINE), [0, height * _FINE]
    for bottom, top, below, above in bay.beams:
        ends += [round(top * _FINE), round(bottom * _FINE)]
        kept[round(above * _FINE) : ends[-2]] = kept[ends[-1] : round(below * _FINE)] = 0
    for first, last in bay.without:
        kept[round(first * _FINE) : round(last * _FINE)] = 0
    ends.sort()
    shown = np.zeros(height * _FINE + 1)
    for first, last in pairwise(ends):
        part = np.cumsum(kept[first:last])
        shown[first + 1 : last + 1] = first + part * ((last - first) / max(part[-1], 1) if len(part) else 1)
    places = np.arange(height * _FINE + 1) / _FINE
    rows: Floats = np.interp(np.arange(height) + 0.5, shown / _FINE, places)
    return rows


def _seen(face: Face, photo: Picture, columns: Floats, rows: Floats) -> Picture:
    """The picture (m, n, 3) at columns (n,) and rows (m,) of the rectified picture."""
    width, height = face.size_px
    target = np.array([[0, 0], [width, 0], [width, height], [0, height]], np.float32)
    size = np.array(photo.shape[1::-1])
    straight = undistorted(np.array(face.corners), size, face.radial)
    from_rectified = cv2.getPerspectiveTransform(target, straight.astype(np.float32))
    u, v = np.meshgrid(columns, rows)
    places = np.stack([u, v, np.ones_like(u)], axis=-1).reshape(-1, 3) @ from_rectified.T
    bent = distorted(places[:, :2] / places[:, 2:], size, face.radial) - 0.5
    at = bent.astype(np.float32).reshape(*u.shape, 2)
    seen = cv2.remap(photo, at[..., 0], at[..., 1], cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(seen, np.uint8)


def undistorted(points: Floats, size: NDArray[np.int64], radial: float) -> Floats:
    """Points (n, 2) of a photograph of `size` (width, height), px, as a lens without distortion would show them."""
    middle, half = size / 2, size[0] / 2
    offset = (points - middle) / half
    straight: Floats = middle + half * offset * (1 + radial * (offset**2).sum(axis=1, keepdims=True))
    return straight


def distorted(points: Floats, size: NDArray[np.int64], radial: float) -> Floats:
    """The inverse of `undistorted`."""
    middle, half = size / 2, size[0] / 2
    straight = (points - middle) / half
    offset = straight
    for _ in range(_ROUNDS):
        offset = straight / (1 + radial * (offset**2).sum(axis=1, keepdims=True))
    bent: Floats = middle + half * offset
    return bent
