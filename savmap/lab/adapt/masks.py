"""Labels for nothing: a map's outlines, projected into a view, where the evidence of all frames supports them.

A pixel is of a class where an outline of it is, most frames see it there, and this one does not contradict. It is
background where it shows the mapped part of a plane and hardly any frame sees anything. All others are not judged: what
lies beyond the map, what the evidence is unsure of, what stands in front in this frame alone, and edges that are not
measured well.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.lab.adapt.faces import Face, Outline, outline_in
from savmap.lab.label.polygons import filled
from savmap.types import Bools, Floats, PlaneEvidence, ViewSpec
from savmap.vision.evidence import PackedView

IGNORE = 255
BEHIND = -9.0
Bytes = NDArray[np.uint8]
Singles = NDArray[np.float32]


@dataclass(frozen=True)
class MaskSettings:
    """When a pixel is labelled.

    `supported`: the evidence there must be such a share of what is usual within outlines of the class; `empty`:
    background has less than this share of it; `faintest`: evidence below this is none. `contradicted`: a frame whose
    probability is below this share of the evidence sees something else, unless its grey level is within `alike` of the
    plane's, or of half the view's own spread where that is less. `aslant`: what lies further to the side than this
    multiple of the camera's distance is not judged. Edges that are not sure to `sharp_px` are left out, by at most
    `widest_px` on either side; beside all others `spill_px` are background.
    """

    supported: float = 0.4
    empty: float = 0.35
    faintest: float = 0.05
    contradicted: float = 0.3
    alike: float = 20.0
    aslant: float = 3.0
    sharp_px: float = 0.75
    widest_px: float = 12.0
    spill_px: int = 2


@dataclass(frozen=True, eq=False)
class KnownFace:
    """A face, its evidence, and, by class, what is usual within outlines."""

    face: Face
    evidence: PlaneEvidence
    usual: Mapping[str, float]

    @classmethod
    def of(cls, face: Face, evidence: PlaneEvidence) -> "KnownFace":
        """A face with what its evidence says of its outlines."""
        return cls(face, evidence, {label: face.usual(evidence, label) for label in evidence.classes})


def mask_of(
    packed_view: PackedView,
    view: ViewSpec,
    world_from_rig: Floats,
    faces: Sequence[KnownFace],
    classes: Sequence[str],
    settings: MaskSettings,
) -> Bytes:
    """The labels (height, width) of a view: 0 background, k for classes[k - 1], 255 not to be judged."""
    labels = np.full((view.height, view.width), IGNORE, np.uint8)
    shown_faces = [ShownFace(mapped, packed_view, view, world_from_rig, settings) for mapped in faces]
    places = [(shown, outline, shown.pixels_of(outline)) for shown in shown_faces for outline in shown.outlines]
    for shown in shown_faces:
        labels[shown.empty] = 0
    for shown in shown_faces:
        labels[shown.inside & ~shown.empty] = IGNORE
    for shown in shown_faces:
        labels[shown.inside & _beside([core for face, _, core in places if face is shown], settings.spill_px)] = 0
    for shown, outline, core in places:
        labels[core] = np.where(shown.agrees(outline.label)[core], classes.index(outline.label) + 1, IGNORE)
    for _, outline, _ in places:
        _blur_edges(labels, outline, view, world_from_rig, settings)
    return labels


def _beside(cores: Sequence[Bools], reach: int) -> Bools:
    """The pixels right beside outlines: the evidence spills over there, and their sides say where they end."""
    whole = np.any(cores, axis=0).astype(np.uint8)
    return np.asarray(cv2.dilate(whole, np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)) > whole)


class ShownFace:
    """A face as a view shows it: for each pixel, what the evidence says of the plane's point behind it."""

    def __init__(
        self, mapped: KnownFace, packed_view: PackedView, view: ViewSpec, world_from_rig: Floats, settings: MaskSettings
    ) -> None:
        self.mapped, self.settings, self.view, self.world_from_rig = mapped, settings, view, world_from_rig
        self.cells, self.inside = _cells(mapped.face, view, world_from_rig, settings.aslant)
        size = (view.width, view.height)
        classes = mapped.evidence.classes
        self.seen = {
            label: cv2.resize(probability, size, interpolation=cv2.INTER_LINEAR)
            for label, probability in zip(classes, packed_view.probabilities(), strict=True)
        }
        self.mean = {label: self._warped(mapped.evidence.of(label)) for label in classes}
        self.alike = self._alike(packed_view.image())

    @property
    def outlines(self) -> Sequence[Outline]:
        """What was mapped in the face."""
        return self.mapped.face.outlines

    def pixels_of(self, outline: Outline) -> Bools:
        """The pixels within an outline."""
        place = outline_in(self.view, self.world_from_rig, outline.corners)  # a pixel's middle is at whole numbers
        shape = (self.view.height, self.view.width)
        return filled(place + 0.5, *shape) if place is not None else np.zeros(shape, np.bool_)

    @property
    def empty(self) -> Bools:
        """Where the mapped part of the plane shows hardly any evidence of any class."""
        nothing = self.inside.copy()
        for label, mean in self.mean.items():
            nothing &= mean < max(self.settings.empty * self.mapped.usual[label], self.settings.faintest)
        return nothing

    def agrees(self, label: str) -> Bools:
        """Where the evidence of a class is strong and the frame does not contradict it."""
        mean, seen = self.mean[label], self.seen[label]
        supported = mean >= max(self.settings.supported * self.mapped.usual[label], self.settings.faintest)
        return np.asarray(self.inside & supported & ((seen >= self.settings.contradicted * mean) | self.alike))

    def _alike(self, image: Bytes) -> Bools:
        """Where the view looks like the plane in all frames together."""
        grey = cv2.blur(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY).astype(np.float32), (3, 3))
        usual = self._warped(cv2.cvtColor(self.mapped.evidence.picture, cv2.COLOR_RGB2GRAY).astype(np.float32))
        spread = float(grey[self.inside].std()) if self.inside.any() else 0.0
        return np.asarray(np.abs(grey - usual) < min(self.settings.alike, spread / 2), np.bool_)

    def _warped(self, values: Singles) -> Singles:
        """What a patch (rows, columns) holds at each pixel (height, width)."""
        columns, rows = cv2.split(self.cells)
        warped = cv2.remap(values, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(warped, np.float32)


def _cells(face: Face, view: ViewSpec, world_from_rig: Floats, aslant: float) -> tuple[Singles, Bools]:
    """The patch's cells (height, width, 2) behind a view's pixels, and where there are any and they are not seen too
    much aslant."""
    patch, centre = face.patch, world_from_rig[:3, 3]
    pixels = np.stack(np.meshgrid(np.arange(view.width), np.arange(view.height)), axis=-1).astype(np.float64)
    rays = view.rig_rays(pixels) @ world_from_rig[:3, :3].T
    normal = np.cross(patch.right, patch.up)
    away, towards = float((patch.origin - centre) @ normal), rays @ normal
    ahead = away * towards > abs(away) / np.sqrt(1 + aslant**2)
    distance = np.where(ahead, away / np.where(ahead, towards, 1.0), 0.0)
    cells = face.cells(centre + distance[..., None] * rays)
    rows, columns = patch.shape
    within = (cells >= -0.5) & (cells <= np.array([columns, rows]) - 0.5)
    inside = np.asarray(ahead & within[..., 0] & within[..., 1])
    return np.where(inside[..., None], cells, BEHIND).astype(np.float32), inside


def _blur_edges(
    labels: Bytes, outline: Outline, view: ViewSpec, world_from_rig: Floats, settings: MaskSettings
) -> None:
    """Leave out what is near to the sides of an outline that are not measured well."""
    corners = outline.corners
    for first, second, unsure in zip(corners, np.roll(corners, -1, axis=0), outline.unsure_m, strict=True):
        side = outline_in(view, world_from_rig, np.array([first, (first + second) / 2, second]))
        near = float(np.linalg.norm((first + second) / 2 - world_from_rig[:3, 3]))
        width = min(unsure * view.camera[0, 0] / max(near, 1e-3), settings.widest_px)
        if side is not None and width >= settings.sharp_px:
            start, end = side[0], side[-1]
            along = (end - start) / max(float(np.linalg.norm(end - start)), 1e-6)
            across = width * np.array([-along[1], along[0]])
            band = np.array([start - across, end - across, end + across, start + across])
            labels[filled(band + 0.5, *labels.shape)] = IGNORE
