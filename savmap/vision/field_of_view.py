"""The smallest fields of view (paper, "Rendering views") that show the whole height of a structure, or enough
objects."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from savmap.errors import StructureError
from savmap.geometry import pinhole
from savmap.types import View, ViewSpec
from savmap.vision.view_planning import Face, Manual, PassPreview, tilted

AUTOMATIC = Manual()
Extent = Callable[[View], tuple[float, float] | None]
Count = Callable[[View], int]
SMALLEST_HFOV_DEG, LARGEST_HFOV_DEG = 60.0, 155.0
FIRST_HFOV_DEG = 110.0
BORDER_PX = 2.0
CUT_SHARE = 0.12
BEYOND_CUT_DEG = 8.0
SETTLED_DEG = 1.0
MOST_ROUNDS = 12
HFOV_STEP_DEG = 5.0


@dataclass(frozen=True)
class Fitted:
    """A view, and a line for the user about what is wrong with it, if anything is."""

    spec: ViewSpec
    warning: str | None = None


@dataclass(frozen=True)
class _Elevations:
    """Lowest and highest elevation of the structure over the key frames, degrees in the building, and whether the
    frame cuts it below and above."""

    low_deg: float
    high_deg: float
    cut_low: bool
    cut_high: bool


UNKNOWN = _Elevations(-80.0, 80.0, False, False)


def fit_height(
    pass_preview: PassPreview,
    face: Face,
    extent: Extent,
    manual: Manual = AUTOMATIC,
    name: str = "face",
    margin: float = 0.05,
) -> Fitted:
    """The view at the face that shows its whole height in all key frames at the smallest field of view.

    `extent(view)` gives the top and bottom row of the structure in a view, at the frame's border where that cuts it, or
    None where there is no structure. `margin` is the share of the view's height kept free above and below. Values of
    `manual` are kept. Raises StructureError where the structure is in no view.
    """
    if manual.complete:
        return Fitted(manual.over(ViewSpec(name, 0.0)))
    spec = manual.over(tilted(face, 0.0, FIRST_HFOV_DEG, name))
    whole: list[tuple[bool, float, ViewSpec]] = []
    for _ in range(MOST_ROUNDS):
        extremes = _elevations(pass_preview, face, spec, extent)
        following = manual.over(_covering(face, extremes or UNKNOWN, spec, margin))
        settled = _change(following, spec) < SETTLED_DEG
        if extremes and not (extremes.cut_low or extremes.cut_high):
            whole.append((following.hfov_deg > spec.hfov_deg + SETTLED_DEG, spec.hfov_deg, spec))
        if settled:
            break
        spec = following
    if extremes is None:
        raise StructureError(f"view {name}: no structure is seen in its direction; give its angles in the site file")
    if not whole:
        return Fitted(
            spec, f"view {name}: the whole height of the structure is not seen at {spec.hfov_deg:.0f} degrees"
        )
    return Fitted(min(whole, key=lambda tried: tried[:2])[2])


def _elevations(pass_preview: PassPreview, face: Face, spec: ViewSpec, extent: Extent) -> _Elevations | None:
    extents = [rows for view in pass_preview.views(spec) if (rows := extent(view)) is not None]
    if not extents:
        return None
    top, bottom = np.array(extents, dtype=np.float64).T
    pitch = pinhole.angles_from_rotation(face.spec.rig_from_view.T @ spec.rig_from_view)[1]
    elevations = pitch + np.degrees(np.arctan((spec.camera[1, 2] - np.array([top, bottom])) / spec.camera[1, 1]))
    cut_high = float(np.mean(top <= BORDER_PX)) > CUT_SHARE
    cut_low = float(np.mean(bottom >= spec.height - 1 - BORDER_PX)) > CUT_SHARE
    return _Elevations(float(elevations[1].min()), float(elevations[0].max()), cut_low, cut_high)


def _covering(face: Face, extremes: _Elevations, spec: ViewSpec, margin: float) -> ViewSpec:
    """The view that covers these elevations with its margins, and a little more where the frame cut the structure."""
    low = max(extremes.low_deg - BEYOND_CUT_DEG * extremes.cut_low, -88.0)
    high = min(extremes.high_deg + BEYOND_CUT_DEG * extremes.cut_high, 88.0)
    half = np.radians(min(high - low, 170.0) / 2)
    tangent = np.tan(half) / (1 - 2 * margin) * spec.width / spec.height
    hfov = float(np.clip(np.degrees(2 * np.arctan(tangent)), SMALLEST_HFOV_DEG, LARGEST_HFOV_DEG))
    return tilted(face, (low + high) / 2, hfov, spec.name)


def _change(a: ViewSpec, b: ViewSpec) -> float:
    """How far two views differ, degrees."""
    turned = a.rig_from_view.T @ b.rig_from_view
    angle = np.degrees(np.arccos(np.clip((np.trace(turned) - 1) / 2, -1, 1)))
    return max(float(angle), abs(a.hfov_deg - b.hfov_deg))


def fit_count(
    pass_preview: PassPreview,
    spec: ViewSpec,
    count: Count,
    at_least: int = 2,
    share: float = 0.95,
    manual: Manual = AUTOMATIC,
    smallest_deg: float = SMALLEST_HFOV_DEG,
) -> Fitted:
    """The view along `spec` with the smallest field of view that shows `at_least` objects in this share of the key
    frames.

    `count(view)` gives how many a view shows. A step is added for the frames between. Values of `manual` are kept.
    """
    if manual.hfov_deg is not None:
        return Fitted(manual.over(spec))
    for hfov in np.arange(smallest_deg, LARGEST_HFOV_DEG + 1, HFOV_STEP_DEG):
        candidate = manual.over(replace(spec, hfov_deg=float(hfov)))
        if _enough(pass_preview, candidate, count, at_least, share):
            wider = min(float(hfov) + HFOV_STEP_DEG, LARGEST_HFOV_DEG)
            return Fitted(replace(candidate, hfov_deg=wider))
    return Fitted(
        candidate, f"view {spec.name}: fewer than {at_least} are in sight in some frames, however wide the view"
    )


def _enough(pass_preview: PassPreview, spec: ViewSpec, count: Count, at_least: int, share: float) -> bool:
    """Whether enough key frames show enough objects; stops at the frame that decides it."""
    may_fail = int(np.floor((1 - share) * len(pass_preview.keys) + 1e-9))
    for panorama in pass_preview.keys:
        may_fail -= count(pass_preview.renderer.render(panorama, spec)) < at_least
        if may_fail < 0:
            return False
    return True
