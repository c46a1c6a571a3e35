"""A sign straightened out: sampled from the panorama at its full resolution, as if seen from the front."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.geometry.sphere import panorama_pixels_from_rays
from savmap.types import FilmedPanorama, Floats, Panorama, ViewSpec

Grey = NDArray[np.uint8]


@dataclass(frozen=True)
class Patch:
    """A straightened picture (h, w), grey, of a quadrilateral of a view that fills `inner` of it (left, top, right, bottom, px);
    view_from_patch (3, 3), a homography; `fineness`: pixels of the patch to one of the panorama."""

    image: Grey
    inner: tuple[float, float, float, float]
    view_from_patch: Floats
    fineness: float

    def to_view(self, points: Floats) -> Floats:
        """Points (n, 2) of the patch in the view, px."""
        seen = np.column_stack([points, np.ones(len(points))]) @ self.view_from_patch.T
        flat: Floats = seen[:, :2] / seen[:, 2:]
        return flat


def source_size(quad: Floats, spec: ViewSpec, panorama_height: int) -> tuple[float, float]:
    """About how many pixels of the panorama a quadrilateral (4, 2) of a view is wide and high."""
    rays = spec.rig_rays(quad)
    sides = np.linalg.norm(np.roll(rays, -1, axis=0) - rays, axis=1) * panorama_height / np.pi
    return float(sides[[0, 2]].mean()), float(sides[[1, 3]].mean())


def patch_of(
    panorama: Panorama, spec: ViewSpec, quad: Floats, size: tuple[float, float], margin: float, fineness: float
) -> Patch:
    """A patch of a quadrilateral of `size` (width, height) panorama pixels, `fineness` times as fine, with a margin around it
    that is a share of its lesser side."""
    width, height = (max(round(fineness * side), 8) for side in size)
    edge = round(margin * min(width, height))
    inner = np.array([[0, 0], [width, 0], [width, height], [0, height]], np.float32) + edge - 0.5
    homography = cv2.getPerspectiveTransform(inner, quad.astype(np.float32))
    rows, columns = np.mgrid[: height + 2 * edge, : width + 2 * edge]
    grid = np.stack([columns.ravel(), rows.ravel(), np.ones(rows.size)], axis=1) @ homography.T
    pixels = np.asarray(grid[:, :2] / grid[:, 2:], np.float64)
    places = panorama_pixels_from_rays(spec.rig_rays(pixels), panorama.height)
    maps = places.reshape(*rows.shape, 2).astype(np.float32)
    u, v = np.ascontiguousarray(maps[..., 0]), np.ascontiguousarray(maps[..., 1])
    image = cv2.remap(_grey(panorama), u, v, cv2.INTER_CUBIC, borderMode=cv2.BORDER_WRAP)
    box = (edge - 0.5, edge - 0.5, edge + width - 0.5, edge + height - 0.5)
    return Patch(np.asarray(image, np.uint8), box, np.asarray(homography, np.float64), fineness)


def _grey(panorama: Panorama) -> Grey:
    if isinstance(panorama, FilmedPanorama):
        return panorama.planes.luma
    return np.asarray(panorama.image[..., 1], np.uint8)
