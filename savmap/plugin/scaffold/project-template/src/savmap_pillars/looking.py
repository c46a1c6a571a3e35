"""Which way to look, and which points of a mask are points of a pillar."""

from collections.abc import Callable, Mapping, Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from savmap.errors import StructureError
from savmap.geometry.pinhole import angles_from_rotation
from savmap.types import Detection, Feature, Floats, Panorama, View, ViewPlan, ViewSpec
from savmap.vision.field_of_view import fit_height
from savmap.vision.view_planning import LEVEL, Face, Manual, PassPreview, choose_face

VIEW = "pillars"
HFOV_DEG = 110.0
SIGMA_PX = 1.0
BORDER_PX = 2


def aim(
    pass_preview: PassPreview,
    see: Callable[[View], list[Detection]],
    side: Literal["left", "right"] | None,
    manual: Mapping[str, Manual],
    attitude: Floats | None,
) -> ViewPlan:
    """The view at the face that shows pillars from foot to top, as narrow as may be.

    attitude: world_from_rig (3, 3) of the first key frame, where an earlier plugin found the face; else the level direction that
    shows most of pillars. The face itself is not claimed to be known. Without views, and with a note, where no pillar is seen.
    """
    try:
        face = face_at(attitude) if attitude is not None else _face_with_most(pass_preview, see, side)
        fitted = fit_height(pass_preview, face, lambda view: rows_of(see(view)), manual.get(VIEW, Manual()), VIEW)
    except StructureError as error:
        return ViewPlan((), notes=(f"pillars: {error}",))
    return ViewPlan((fitted.spec,), notes=(fitted.warning,) if fitted.warning else ())


def face_at(world_from_rig: Floats) -> Face:
    """The face as the attitude of the rig (3, 3) tells it: the row's frame looks out of it."""
    return Face(ViewSpec(VIEW, *angles_from_rotation(world_from_rig.T @ LEVEL), hfov_deg=HFOV_DEG), 0, 1.0)


def _face_with_most(
    pass_preview: PassPreview, see: Callable[[View], list[Detection]], side: Literal["left", "right"] | None
) -> Face:
    def share(spec: ViewSpec, panorama: Panorama) -> float:
        return float(sum(detection.mask.mean() for detection in see(pass_preview.renderer.render(panorama, spec))))

    return choose_face(pass_preview, share, side)


def rows_of(detections: Sequence[Detection]) -> tuple[float, float] | None:
    """The top and the bottom row of all masks in a view; None without any."""
    spans = [np.flatnonzero(detection.mask.any(axis=1))[[0, -1]] for detection in detections]
    return (float(min(top for top, _ in spans)), float(max(low for _, low in spans))) if spans else None


def features_of(view: View, detections: Sequence[Detection]) -> list[Feature]:
    """The middle of the lower end ("foot") and of the upper end ("top") of each mask that the view does not cut."""
    return [
        Feature(
            view.frame,
            view.spec.name,
            detection.label,
            part,
            instance,
            pixel[None],
            SIGMA_PX**2 * np.eye(2)[None],
            score=detection.score,
        )
        for instance, detection in enumerate(detections)
        if not cut(detection.mask)
        for part, pixel in zip(("foot", "top"), ends_of(detection.mask), strict=True)
    ]


def ends_of(mask: NDArray[np.bool_]) -> tuple[Floats, Floats]:
    """Where a mask's lower and upper border are in the middle of its width there: pixels (2,) each, x then y."""
    rows = np.flatnonzero(mask.any(axis=1))
    low, high = int(rows[-1]), int(rows[0])
    return (
        np.array([np.flatnonzero(mask[low]).mean(), low + 0.5]),
        np.array([np.flatnonzero(mask[high]).mean(), high - 0.5]),
    )


def cut(mask: NDArray[np.bool_]) -> bool:
    """Whether a mask comes to the view's border, so that an end may be missing."""
    inner = mask[BORDER_PX:-BORDER_PX, BORDER_PX:-BORDER_PX]
    return bool(mask.sum() > inner.sum())
