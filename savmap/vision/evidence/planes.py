"""Evidence in planes: a network's probabilities on a plane, averaged over all frames whose pose is known.

A threshold in a single frame discards what fifty frames show together. On the plane that an object lies in, its pixels
have the same place in every frame and add up. Objects in front of the plane or behind it are smeared by parallax.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.types import (
    Floats,
    PlaneEvidence,
    PlanePatch,
    RowFacts,
    Trajectory,
    View,
    ViewSpec,
    array_record,
)
from savmap.vision.networks.segmenter import Segmentation

Bytes = NDArray[np.uint8]
Singles = NDArray[np.float32]

HALVED = 2
MOST_VIEWS = 160
JPEG_QUALITY = 80
BORDER_PX = 2.0
REACH, TINY = 3.0, 1e-9
FACING, FARTHEST = 0.3, 9.0
BEYOND = 1.3
"""How far beyond both ends of the path an upright plane is looked at, in its distances."""
HALVED_FROM_PIXELS = np.array([[1 / HALVED, 0, 0.5 / HALVED - 0.5], [0, 1 / HALVED, 0.5 / HALVED - 0.5], [0, 0, 1]])


@dataclass(frozen=True, eq=False)
@array_record
class PackedView:
    """A view of a frame as it is kept in memory: the view's name, the classes' probabilities (`maps`, PNG, at half the
    view's resolution), and the picture (JPEG)."""

    frame: int
    view: str
    maps: tuple[bytes, ...]
    picture: bytes

    @classmethod
    def of(cls, view: View, segmentation: Segmentation) -> "PackedView":
        """A rendered view and the network's probabilities, packed."""
        size = (view.spec.width // HALVED, view.spec.height // HALVED)
        small = [cv2.resize(probability, size, interpolation=cv2.INTER_AREA) for probability in segmentation.maps[1:]]
        maps = tuple(_packed(np.round(255 * probability).astype(np.uint8), ".png") for probability in small)
        return cls(view.frame, view.spec.name, maps, _packed(view.image[..., ::-1], ".jpg"))

    def probabilities(self) -> Singles:
        """(classes, height / 2, width / 2), 0..1."""
        maps = np.stack([_unpacked(packed, cv2.IMREAD_GRAYSCALE) for packed in self.maps])
        return np.asarray(maps, np.float32) / np.float32(255)

    def image(self) -> Bytes:
        """The view's picture (height, width, 3), RGB."""
        return _unpacked(self.picture, cv2.IMREAD_COLOR)[..., ::-1]

    def grey(self) -> Bytes:
        """The view's picture (height, width), grey."""
        return _unpacked(self.picture, cv2.IMREAD_GRAYSCALE)


def _packed(image: Bytes, kind: str) -> bytes:
    options = [cv2.IMWRITE_PNG_COMPRESSION, 1] if kind == ".png" else [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
    return bytes(cv2.imencode(kind, image, options)[1])


def _unpacked(packed: bytes, flags: int) -> Bytes:
    return np.asarray(cv2.imdecode(np.frombuffer(packed, np.uint8), flags), np.uint8)


def placed(patch: PlanePatch, view: ViewSpec, world_from_rig: Floats) -> tuple[Floats, Floats]:
    """Where a camera is (3,), to the right of a patch's origin, up, and in front of it, and the homography (3, 3) to a
    view's pixels from (right, up, 1)."""
    place = (world_from_rig[:3, 3] - patch.origin) @ patch.axes
    plane = (world_from_rig[:3, :3] @ view.rig_from_view).T @ patch.axes
    plane[:, 2] = -plane @ place
    return place, view.camera @ plane


def gather(
    patch: PlanePatch,
    classes: Sequence[str],
    packed_views: Sequence[PackedView],
    views: Mapping[str, ViewSpec],
    path: Trajectory,
) -> PlaneEvidence:
    """The evidence of packed views of frames whose pose is known; at most `MOST_VIEWS` of them, evenly chosen.

    A view is weighted by the solid angle under which it shows a cell: near frontal views count more than far oblique
    ones.
    """
    poses = dict(zip(path.frames.tolist(), path.world_from_rig, strict=True))
    located = [packed_view for packed_view in packed_views if packed_view.frame in poses]
    chosen = (
        np.unique(np.linspace(0, len(located) - 1, min(len(located), MOST_VIEWS)).astype(int)).tolist()
        if located
        else []
    )
    sums = _Sums(patch, len(classes))
    for index in chosen:
        packed_view = located[index]
        seen = packed_view.probabilities(), packed_view.image()
        sums.add(*seen, views[packed_view.view], poses[packed_view.frame])
    return sums.evidence(tuple(classes))


def sharpness(
    patch: PlanePatch, maps: Mapping[tuple[int, str], Singles], views: Mapping[str, ViewSpec], path: Trajectory
) -> float:
    """How sharp the evidence of maps (classes, h, w), by frame and view, is on a plane: the mean of the scores in all
    cells, weighted by themselves. Greatest where the plane is that of what the network saw."""
    poses = dict(zip(path.frames.tolist(), path.world_from_rig, strict=True))
    sums = _Sums(patch, len(next(iter(maps.values()))))
    for (frame, name), probabilities in maps.items():
        sums.add(probabilities, None, views[name], poses[frame])
    mean = sums.total / np.maximum(sums.weight, 1e-9)
    return float(np.square(mean).sum() / max(float(mean.sum()), 1e-9))


class _Sums:
    """Weighted sums over views, cell by cell."""

    def __init__(self, patch: PlanePatch, classes: int) -> None:
        self.patch = patch
        self.total, self.weight = np.zeros((classes, *patch.shape), np.float32), np.zeros(patch.shape, np.float32)
        self.picture, self.sharpness = np.zeros((3, *patch.shape), np.float32), np.zeros(patch.shape, np.float32)

    def add(self, maps: Singles, image: Bytes | None, view: ViewSpec, world_from_rig: Floats) -> None:
        """Add a view from a camera at a known pose, where it shows the patch: maps (classes, height / 2, width / 2),
        and the picture (height, width, 3), if it is wanted."""
        place, pixels_from_patch = placed(self.patch, view, world_from_rig)
        low, high = _shown(pixels_from_patch, self.patch.heights, view)
        reach = REACH * abs(float(place[2]))
        low, high = np.maximum(low, place[0] - reach), np.minimum(high, place[0] + reach)
        shown = low < high
        limits = [low[shown].min(initial=np.inf), high[shown].max(initial=-np.inf)]
        first, last = np.searchsorted(self.patch.across, limits).tolist()
        if first >= last:
            return
        columns = slice(first, last)
        across = self.patch.across[columns]
        weight = _weights(across, self.patch.heights, place) * ((low[:, None] < across) & (across < high[:, None]))
        cells = self.patch.cell * np.array([[1, 0, first + 0.5], [0, -1, len(low) - 0.5], [0, 0, 1 / self.patch.cell]])
        self.weight[:, columns] += weight
        for total, probability in zip(self.total, maps, strict=True):
            laid = _laid(probability, HALVED_FROM_PIXELS @ pixels_from_patch @ cells, weight.shape)
            cv2.accumulateProduct(weight, laid, total[:, columns])
        if image is None:
            return
        sharpness = np.square(weight)
        self.sharpness[:, columns] += sharpness
        for total, colour in zip(self.picture, np.moveaxis(image, 2, 0), strict=True):
            laid = _laid(colour.astype(np.float32), pixels_from_patch @ cells, weight.shape)
            cv2.accumulateProduct(sharpness, laid, total[:, columns])

    def evidence(self, classes: tuple[str, ...]) -> PlaneEvidence:
        """The means."""
        mean = (self.total / np.maximum(self.weight, 1e-9)).astype(np.float32)
        shown = np.clip(self.picture / np.maximum(self.sharpness, 1e-12), 0, 255).astype(np.uint8)
        return PlaneEvidence(self.patch, classes, mean, self.weight, np.ascontiguousarray(np.moveaxis(shown, 0, 2)))


def _shown(pixels_from_patch: Floats, heights: Floats, view: ViewSpec) -> tuple[Floats, Floats]:
    """Between which distances (rows,) from a patch's left side a view shows it, for each height (rows,): the first is
    the greater one where it does not."""
    u, v, depth = pixels_from_patch
    right, bottom = view.width - 1 - BORDER_PX, view.height - 1 - BORDER_PX
    limits = np.array([u - BORDER_PX * depth, right * depth - u, v - BORDER_PX * depth, bottom * depth - v])
    slopes = np.where(np.abs(limits[:, :1]) < TINY, TINY, limits[:, :1])
    bounds = -(limits[:, 1:2] * heights + limits[:, 2:]) / slopes
    low, high = (np.where(side * slopes > 0, bounds, -side * np.inf) for side in (1, -1))
    return low.max(axis=0), high.min(axis=0)


def _weights(across: Floats, heights: Floats, place: Floats) -> Singles:
    """The solid angle under which a camera at a place (3,) sees each cell, up to a factor."""
    x, y, away = place.tolist()
    squares = np.square(across - x).astype(np.float32) + (np.square(heights - y) + away**2).astype(np.float32)[:, None]
    return np.asarray(np.float32(abs(away)) / (squares * np.sqrt(squares)), np.float32)


def _laid(values: Singles, values_from_cells: Floats, shape: tuple[int, ...]) -> Singles:
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.asarray(cv2.warpPerspective(values, values_from_cells, shape[::-1], flags=flags), np.float32)


def heights_shown(path: Trajectory, facts: RowFacts) -> tuple[float, float]:
    """The lowest and the highest y of the plane z = 0 that the views which look at it show, before the camera; at most
    `FARTHEST` of its distance below or above it."""
    low, high = np.inf, -np.inf
    passes = facts.frames.passes
    for name, spec in facts.views.items():
        middle = (spec.width - 1) / 2
        rays = spec.rig_rays(np.array([[middle, 0.0], [middle, (spec.height - 1) / 2], [middle, spec.height - 1.0]]))
        of_pass = np.array([name.startswith(f"{passes[frame]} / ") for frame in path.frames.tolist()], np.bool_)
        poses = path.world_from_rig[of_pass]
        directions = np.einsum("nij,kj->nki", poses[:, :3, :3], rays)
        facing = directions[:, 1, 2] < -FACING
        for pose, (top, _, bottom) in zip(poses[facing], directions[facing], strict=True):
            reach = [FARTHEST if ray[2] > -1e-6 else min(abs(ray[1] / ray[2]), FARTHEST) for ray in (top, bottom)]
            edges = [
                pose[1, 3] + pose[2, 3] * far * np.sign(ray[1]) for far, ray in zip(reach, (top, bottom), strict=True)
            ]
            low, high = min(low, *edges), max(high, *edges)
    return float(low), float(high)


def upright_patch(path: Trajectory, facts: RowFacts, cell: float) -> PlanePatch:
    """All of the upright plane z = 0 that the views of a path show; its cells' side is that share of its distance."""
    places = path.world_from_rig[:, :3, 3]
    distance = float(np.median(places[:, 2]))
    low, high = heights_shown(path, facts)
    left, right = places[:, 0].min() - BEYOND * distance, places[:, 0].max() + BEYOND * distance
    size = np.array([right - left, high - low])
    return PlanePatch("face", np.array([left, low, 0.0]), np.eye(3)[0], np.eye(3)[1], size, cell * distance)
