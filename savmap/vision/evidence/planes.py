"""Evidence in planes: a network's probabilities on a plane, averaged over all frames whose pose is known.

A threshold in a single frame discards what fifty frames show together. On the plane that an object lies in, its pixels have the same place
in every frame and add up. Objects in front of the plane or behind it are smeared by parallax.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.geometry import pinhole
from savmap.types import (
    Floats,
    PlaneEvidence,
    PlanePatch,
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
NEAR = 0.02
REACH, OUTSIDE = 3.0, -9.0


@dataclass(frozen=True, eq=False)
@array_record
class PackedView:
    """A view of a frame as it is kept in memory: the view's name, the classes' probabilities (`maps`, PNG, at half the view's resolution),
    and the picture (JPEG)."""

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


def gather(
    patch: PlanePatch,
    classes: Sequence[str],
    packed_views: Sequence[PackedView],
    views: Mapping[str, ViewSpec],
    path: Trajectory,
) -> PlaneEvidence:
    """The evidence of packed views of frames whose pose is known; at most `MOST_VIEWS` of them, evenly chosen.

    A view is weighted by the solid angle under which it shows a cell: near frontal views count more than far oblique ones.
    """
    poses = dict(zip(path.frames.tolist(), path.world_from_rig, strict=True))
    known = [packed_view for packed_view in packed_views if packed_view.frame in poses]
    chosen = (
        np.unique(np.linspace(0, len(known) - 1, min(len(known), MOST_VIEWS)).astype(int)).tolist() if known else []
    )
    sums = _Sums(patch, len(classes))
    for index in chosen:
        sums.add(known[index], views[known[index].view], poses[known[index].frame])
    return sums.evidence(tuple(classes))


class _Sums:
    """Weighted sums over views, cell by cell."""

    def __init__(self, patch: PlanePatch, classes: int) -> None:
        self.patch = patch
        self.total, self.weight = np.zeros((classes, *patch.shape), np.float32), np.zeros(patch.shape, np.float32)
        self.picture, self.sharpness = np.zeros((*patch.shape, 3), np.float32), np.zeros(patch.shape, np.float32)
        self.points = patch.points()

    def add(self, packed_view: PackedView, view: ViewSpec, world_from_rig: Floats) -> None:
        """Add a view from a camera at a known pose, where the patch is near."""
        columns = self._near(world_from_rig)
        if columns.start >= columns.stop:
            return
        pixels, weight = _pixels_and_weights(self.points[:, columns], self.patch, view, world_from_rig)
        self.weight[:, columns] += weight
        halved = ((pixels + 0.5) / HALVED - 0.5).astype(np.float32)
        for index, probability in enumerate(packed_view.probabilities()):
            self.total[index][:, columns] += weight * _sampled(probability, halved)
        sharpness = np.square(weight)
        self.sharpness[:, columns] += sharpness
        self.picture[:, columns] += sharpness[..., None] * _sampled(packed_view.image(), pixels)

    def _near(self, world_from_rig: Floats) -> slice:
        """The columns within `REACH` times the camera's distance from the plane."""
        from_corner = world_from_rig[:3, 3] - self.patch.origin
        away = abs(float(from_corner @ np.cross(self.patch.right, self.patch.up)))
        middle = float(from_corner @ self.patch.right)
        first, last = np.searchsorted(self.patch.across, [middle - REACH * away, middle + REACH * away]).tolist()
        return slice(int(first), int(last))

    def evidence(self, classes: tuple[str, ...]) -> PlaneEvidence:
        """The means."""
        mean = (self.total / np.maximum(self.weight, 1e-9)).astype(np.float32)
        shown = self.picture / np.maximum(self.sharpness, 1e-12)[..., None]
        return PlaneEvidence(self.patch, classes, mean, self.weight, np.clip(shown, 0, 255).astype(np.uint8))


def _pixels_and_weights(
    points: Floats, patch: PlanePatch, view: ViewSpec, world_from_rig: Floats
) -> tuple[Singles, Singles]:
    """The pixels (..., 2) of cells in a view, and the view's weights there (...), 0 outside of it."""
    rays = points - world_from_rig[:3, 3]
    pixels = pinhole.project(rays @ (world_from_rig[:3, :3] @ view.rig_from_view), view.camera)
    size = np.array([view.width, view.height])
    within = (pixels > BORDER_PX) & (pixels < size - 1 - BORDER_PX)
    inside = within[..., 0] & within[..., 1]
    away = np.abs(rays @ np.cross(patch.right, patch.up))
    weight = np.where(inside, away / np.maximum(np.linalg.norm(rays, axis=-1), 1e-9) ** 3, 0.0)
    return np.where(inside[..., None], pixels, OUTSIDE).astype(np.float32), weight.astype(np.float32)


def _sampled(values: Bytes | Singles, pixels: Singles) -> Singles:
    return np.asarray(cv2.remap(values, pixels, None, cv2.INTER_LINEAR), np.float32)  # type: ignore[call-overload]


def outline_in(view: ViewSpec, world_from_rig: Floats, outline: Floats) -> Floats | None:
    """The outline (m, 2) px in a view of an outline (n, 3) in the row's frame: the part in front of the camera. None where all is behind it."""
    points = (outline - world_from_rig[:3, 3]) @ (world_from_rig[:3, :3] @ view.rig_from_view)
    near = NEAR * float(np.abs(points).max())
    kept: list[Floats] = []
    for first, second in zip(points, np.roll(points, -1, axis=0), strict=True):
        if first[2] >= near:
            kept.append(first)
        if (first[2] >= near) != (second[2] >= near):
            kept.append(first + (near - first[2]) / (second[2] - first[2]) * (second - first))
    return pinhole.project(np.array(kept), view.camera) if len(kept) >= 3 else None
