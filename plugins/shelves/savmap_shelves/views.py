"""Where to look: the view of a pass that faces the rack. Paper, section III.B.

A direction is face-like when beams run level and uprights plumb in a view along it. The view's height is right when the
uprights in its middle are shown from end to end. A low rack close by would show a single upright at a time that way.
Such a view is widened until it mostly shows two, which tracking needs.
"""

from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping, Sequence

import cv2
import numpy as np

from savmap.errors import StructureError
from savmap.types import Detection, Panorama, View, ViewPlan, ViewSpec
from savmap.vision.view_planning import (
    Face,
    Fitted,
    Manual,
    PassPreview,
    Side,
    choose_face,
    fit_count,
    fit_height,
    tilted,
)

Predict = Callable[[View], list[Detection]]
MAX_SLOPE = 0.2
LEAST_UPRIGHT, FITTED, LOWEST = 0.5, 0.9, 0.4
"""Uprights are this share of the rack's height in the picture (paper: 5/8 of the picture's; of thin dark ones a network
often sees less), which is as high as the longest fills so much of, but no lower than that share of the picture."""
LEAST_BEAM_PX, LEAST_ASPECT = 20.0, 1.5
"""Shorter masks, or those less elongated, are no beams."""
MOST_FRAMES = 0.6
CACHED_VIEWS = 20
SEEN_TOO = 0.3
"""A face on the other hand that scores so large a share of the best one's is a rack, too."""
HALF_HFOV_DEG, HALVES = 140.0, {"face low": -16.0, "face high": 16.0}


def aim_at_face(
    pass_preview: PassPreview,
    predict: Predict,
    side: Side | None,
    manual: Mapping[str, Manual],
) -> ViewPlan:
    """The view "face" of a pass, the attitude and the direction of travel that go with it."""
    predict = cached(predict)

    def score(spec: ViewSpec, panorama: Panorama) -> float:
        view = pass_preview.view(panorama, spec)
        return face_likeness(predict(view), view.spec)

    face: Face = choose_face(pass_preview, score, side)
    manual_face = manual.get("face", Manual())
    if not any(predict(view) for view in pass_preview.views(face.spec)):
        raise StructureError(
            f"view face: none of {len(pass_preview.keys)} pictures, evenly spaced over the pass, shows an upright or a "
            "beam; check the video and its `side`, or give the view's angles in the site file"
        )
    whole = fit_height(pass_preview, face, lambda view: extent(predict(view)), manual=manual_face, name="face")
    if whole.warning and manual_face == Manual():
        notes = (*which_hand(face, side), "view face: too high for one view, two are used")
        return ViewPlan(halves(face), face.world_from_rig, face.travel, notes)
    wide = widened(pass_preview, whole.spec, lambda view: len(uprights_in(predict(view), view.spec)), manual_face)
    notes = tuple(fitted.warning for fitted in (whole, wide) if fitted.warning)
    return ViewPlan((wide.spec,), face.world_from_rig, face.travel, (*which_hand(face, side), *notes))


def which_hand(face: Face, side: Side | None) -> tuple[str, ...]:
    """A note on which of two racks is mapped where either side of the way shows one and nobody said which is meant."""
    if side or face.hand is None or face.across_score < SEEN_TOO * face.score:
        return ()
    other = "right" if face.hand == "left" else "left"
    return (
        f"there are racks on both sides; the one on the {face.hand} of the way is mapped; "
        f"`--side {other}`, in a site file `side: {other}`, maps the other",
    )


def cached(predict: Predict) -> Predict:
    """`see` with a cache of the latest views, for the view that is chosen is asked for again."""
    cache: OrderedDict[tuple[ViewSpec, float], list[Detection]] = OrderedDict()

    def see_cached(view: View) -> list[Detection]:
        key = view.spec, view.stamp_s
        if key not in cache:
            cache[key] = predict(view)
        if len(cache) > CACHED_VIEWS:
            cache.popitem(last=False)
        return cache[key]

    return see_cached


def halves(face: Face) -> tuple[ViewSpec, ...]:
    """Two views from 80 degrees below the horizon to 80 above, for a face too high, or too near, for a single view.

    Neither shows the point that its verticals lead to: there, edges side by side look like askew edges.
    """
    return tuple(tilted(face, pitch, HALF_HFOV_DEG, name) for name, pitch in HALVES.items())


def widened(pass_preview: PassPreview, spec: ViewSpec, count: Callable[[View], int], manual: Manual) -> Fitted:
    """The view, or the narrowest wider one that shows two uprights in most key frames; as it is where no key frame
    shows two, however wide: all frames together may."""
    shown = [count(view) for view in pass_preview.views(spec)]
    if manual.hfov_deg is not None or np.mean(np.array(shown) >= 2) >= MOST_FRAMES:
        return Fitted(spec)
    fitted = fit_count(pass_preview, spec, count, share=MOST_FRAMES, smallest_deg=spec.hfov_deg)
    if fitted.warning and max(*shown, *(count(view) for view in pass_preview.views(fitted.spec))) < 2:
        return Fitted(spec, f"view {spec.name}: none of {len(shown)} pictures, evenly spaced, shows two uprights")
    return fitted


def face_likeness(detections: Sequence[Detection], spec: ViewSpec) -> float:
    """Length of level beams, in widths of the view, and of plumb uprights, in heights, each counted for both edges."""
    level = sum(_elongated([mask for mask in detections if mask.label == "beam"], stands=False))
    plumb = sum(uprights_in(detections, spec))
    return 2 * (level / spec.width + plumb / spec.height)


def uprights_in(detections: Sequence[Detection], spec: ViewSpec) -> list[float]:
    """The heights of the plumb uprights that a view shows, px."""
    heights = [*_elongated([mask for mask in detections if mask.label == "upright"], stands=True)]
    tall = np.clip(max(heights, default=0.0) / FITTED, LOWEST * spec.height, spec.height)
    return [height for height in heights if height >= LEAST_UPRIGHT * tall]


def _elongated(detections: Sequence[Detection], stands: bool) -> Iterator[float]:
    """The lengths, px, of masks that are long along the picture's columns, or its rows."""
    for detection in detections:
        mask = detection.mask.view(np.uint8)
        moments = cv2.moments(mask, binaryImage=True)
        length = float(cv2.boundingRect(mask)[3 if stands else 2])
        along, across = ("mu02", "mu20") if stands else ("mu20", "mu02")
        turn = 0.5 * np.arctan2(2 * moments["mu11"], moments[along] - moments[across])
        thickness = moments["m00"] / max(length, 1.0)
        is_long = length >= max(LEAST_BEAM_PX, LEAST_ASPECT * thickness)
        if is_long and abs(np.tan(turn)) < MAX_SLOPE:
            yield length


def extent(detections: Sequence[Detection]) -> tuple[float, float] | None:
    """First and last row of the uprights in the middle half of a view, or None when there is none."""
    tops, bottoms = [], []
    for detection in detections:
        if detection.label != "upright":
            continue
        rows, columns = np.nonzero(detection.mask)
        width = detection.mask.shape[1]
        if abs(float(np.median(columns)) - width / 2) < width / 4 and np.ptp(rows) > detection.mask.shape[0] / 4:
            tops.append(float(rows.min()))
            bottoms.append(float(rows.max()))
    return (min(tops), max(bottoms)) if tops else None
