"""Parts of orthophotos: what a finding is about, outlined, and what an inspector wants to see."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.types import Finding, Floats, Orthophoto, Structure

MARGIN_M = 0.5
"""Around what a finding is about."""
FACE_M = 0.5
"""The picture shows nothing that is further from the face."""
LEAST_PX = 8
"""Of the side of a part: a smaller one shows nothing."""
MOST_PX, QUALITY = 420, 80
OUTLINE = (24, 24, 214)
"""Red, as OpenCV has it."""
Image = NDArray[np.uint8]


@dataclass(frozen=True)
class PartPicture:
    """A part of an orthophoto as a JPEG, the side of its pixels, and the heights of its lower and upper edge, m."""

    content: bytes
    pixel_m: float
    low_m: float
    high_m: float


class FacePictures:
    """The orthophoto of a row, decoded once, and parts of it as JPEG."""

    def __init__(self, photo: Orthophoto) -> None:
        self.photo = photo
        self.image: Image = np.asarray(cv2.imdecode(photo.picture, cv2.IMREAD_COLOR), np.uint8)

    def part(self, corners: Floats, outlines: Sequence[Floats] = (), most_px: int = MOST_PX) -> PartPicture | None:
        """The part between the lowest and the highest of corners (n, 3) m, with outlines, each (m, 3) m, of at most so
        many pixels a side; None where the picture does not show it."""
        pixels = self.photo.on_picture(corners)
        size = np.array([self.photo.width, self.photo.height])
        low = np.clip(np.floor(pixels.min(axis=0)), 0, size).astype(int)
        high = np.clip(np.ceil(pixels.max(axis=0)), 0, size).astype(int)
        if (high - low < LEAST_PX).any():
            return None
        part = self.image[low[1] : high[1], low[0] : high[0]]
        scale = min(1.0, most_px / max(part.shape[:2]))
        width, height = (max(round(scale * side), 1) for side in (part.shape[1], part.shape[0]))
        small = np.ascontiguousarray(cv2.resize(part, (width, height), interpolation=cv2.INTER_AREA))
        for outline in outlines:
            drawn = np.round(scale * (self.photo.on_picture(outline) - low)).astype(np.int32)
            cv2.polylines(small, [drawn], True, OUTLINE, 2, cv2.LINE_AA)
        content = bytes(cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1].tobytes())
        heights = (self.photo.height - np.array([high[1], low[1]])) * self.photo.pixel_m * self.photo.up[1]
        bottom, top = (self.photo.origin[1] + heights).tolist()
        return PartPicture(content, self.photo.pixel_m / scale, bottom, top)

    def finding(self, finding: Finding, elements: Mapping[str, Structure]) -> PartPicture | None:
        """What a finding is about, outlined; of one that names no element, the surroundings of its place. `elements`:
        structures and places of the row by id."""
        subjects = [elements[name] for name in finding.subjects if name in elements]
        if finding.place is None and not subjects:
            return None
        if finding.place is not None and abs(finding.place[2]) > FACE_M:
            return None
        outlines = [_box(structure.vertices) for structure in subjects]
        corners = np.concatenate(outlines or [np.array([finding.place], np.float64)])
        margin = MARGIN_M * (self.photo.right + self.photo.up)
        return self.part(np.concatenate([corners - margin, corners + margin]), outlines)


def _box(vertices: Floats) -> Floats:
    """The corners (4, 3) m of the upright rectangle around vertices (n, 3), at their mean depth."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    z = float(vertices[:, 2].mean())
    return np.array([[low[0], low[1], z], [high[0], low[1], z], [high[0], high[1], z], [low[0], high[1], z]])
