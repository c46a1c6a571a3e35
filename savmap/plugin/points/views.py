"""Which way a plugin of points looks, and which points of a mask are points of an object."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from savmap.errors import StructureError
from savmap.geometry.pinhole import angles_from_rotation
from savmap.types import Detection, Feature, Floats, Panorama, View, ViewPlan, ViewSpec
from savmap.vision.view_planning import Manual, PassPreview, choose_face, face_at, fit_count, fit_height

Mask = NDArray[np.bool_]
BORDER_PX = 2
BORDER_ROWS = 3
COUNT_HFOV_DEG = 110.0


def face_view_plan(
    pass_preview: PassPreview,
    predict: Callable[[View], list[Detection]],
    side: Literal["left", "right"] | None,
    manual: Mapping[str, Manual],
    attitude: Floats | None,
    name: str,
    finds_face: bool = False,
) -> ViewPlan:
    """One view at the face that shows all masks from their lowest to their highest row, as narrow as may be.

    attitude: world_from_rig (3, 3) where an earlier plugin or map gives it; else the level direction with the largest
    masks. Where nothing is detected, the plan has no view, and a note. finds_face: the objects make up the face, and
    the plugin locates the camera. The plan then has the face's attitude and the direction of travel, and StructureError
    is raised where nothing is detected.
    """

    def covered(spec: ViewSpec, panorama: Panorama) -> float:
        return float(sum(detection.mask.mean() for detection in predict(pass_preview.view(panorama, spec))))

    def rows(view: View) -> tuple[float, float] | None:
        masks = [detection.mask for detection in predict(view) if detection.mask.any()]
        spans = [np.flatnonzero(mask.any(axis=1))[[0, -1]] for mask in masks]
        return (float(min(top for top, _ in spans)), float(max(low for _, low in spans))) if spans else None

    try:
        face = face_at(attitude) if attitude is not None else choose_face(pass_preview, covered, side)
        fitted = fit_height(pass_preview, face, rows, manual.get(name, Manual()), name)
    except StructureError as error:
        if finds_face:
            raise
        return ViewPlan((), notes=(f"{name}: {error}",))
    notes = (fitted.warning,) if fitted.warning else ()
    if not finds_face:
        return ViewPlan((fitted.spec,), notes=notes)
    return ViewPlan((fitted.spec,), face.world_from_rig, face.travel, notes)


def count_view_plan(
    pass_preview: PassPreview,
    predict: Callable[[View], list[Detection]],
    manual: Mapping[str, Manual],
    attitude: Floats | None,
    name: str,
    world_from_view: Floats,
    at_least: int = 2,
    every: int = 1,
) -> ViewPlan:
    """One view in a fixed direction of the building, as narrow as shows `at_least` masks whole in nearly all key
    frames; where no width does, as of a line of light from end to end, as narrow as shows a part of one.

    world_from_view (3, 3): `UPWARDS` at the ceiling, `DOWNWARDS` at the floor; its x axis is the row's where the
    attitude is known, else one of the building's. every: it is cut from each so many of the frames.
    """
    rig_from_world = attitude.T if attitude is not None else pass_preview.rig_from_manhattan
    yaw, pitch, roll = angles_from_rotation(rig_from_world @ world_from_view)
    spec = ViewSpec(name, yaw, pitch, roll, COUNT_HFOV_DEG, every=every)

    def whole(view: View) -> int:
        return sum(not touches_border(detection.mask) for detection in predict(view))

    by_hand = manual.get(name, Manual())
    fitted = fit_count(pass_preview, spec, whole, at_least, manual=by_hand)
    if fitted.warning:
        part = fit_count(pass_preview, spec, lambda view: len(predict(view)), 1, manual=by_hand)
        fitted = fitted if part.warning else replace(fitted, spec=part.spec)
    return ViewPlan((fitted.spec,), notes=(fitted.warning,) if fitted.warning else ())


def touches_border(mask: Mask) -> bool:
    """Whether a mask (h, w) comes within two pixels of the view's border, so that an end may be missing."""
    inner = mask[BORDER_PX:-BORDER_PX, BORDER_PX:-BORDER_PX]
    return bool(mask.sum() > inner.sum())


def upright_ends(mask: Mask) -> tuple[Floats, Floats]:
    """Where the lower and the upper border of a mask (h, w) are in the middle of its width there: pixels (2,) each, x
    then y. Of a border that is aslant by a pixel the last row shows a corner only."""
    rows = np.flatnonzero(mask.any(axis=1))
    low, high = int(rows[-1]), int(rows[0])
    borders = mask[max(low + 1 - BORDER_ROWS, high) : low + 1], mask[high : high + BORDER_ROWS]
    foot, top = (float(np.flatnonzero(border.any(axis=0)).mean()) for border in borders)
    return np.array([foot, low + 0.5]), np.array([top, high - 0.5])


def point_feature(
    view: View, detection: Detection, instance: int, part: str, pixel: Floats, sigma_px: float
) -> Feature:
    """A point of the object that a detection shows: pixel (2,), x then y, with a round covariance."""
    covariance = np.eye(2)[None] * sigma_px**2
    return Feature(
        view.frame, view.spec.name, detection.label, part, instance, pixel[None], covariance, score=detection.score
    )
