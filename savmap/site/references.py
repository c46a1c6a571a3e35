"""From the site file's references and calibration to the factor graph's."""

from savmap.graph import (
    Calibration,
    CameraHeight,
    KnownLength,
    KnownMarker,
    References,
    Shutter,
    Stitching,
    SurveyedPoint,
)
from savmap.site.sections import CalibrationSection, ReferenceSection


def references_of(section: ReferenceSection) -> References:
    """The references of one row as the graph takes them."""
    height = section.camera_height_m
    return References(
        camera_heights=(CameraHeight(height.value, height.sigma),) if height else (),
        lengths=tuple(KnownLength(*one.between, one.value, one.sigma, one.axis) for one in section.lengths),
        points=tuple(SurveyedPoint(one.vertex, _position(one.axis, one.value), one.sigma) for one in section.points),
        markers=tuple(KnownMarker(one.dictionary, one.id, one.size_m, one.sigma_m) for one in section.markers),
        on_contradiction=section.on_contradiction,
    )


def calibration_of(section: CalibrationSection) -> Calibration | None:
    """What of the camera is estimated; None if nothing is."""
    panorama, shutter = section.panorama, section.rolling_shutter
    if panorama is None and shutter is None:
        return None
    return Calibration(
        Stitching(panorama.turn_sigma_deg, panorama.scale_sigma, panorama.blend_deg) if panorama else None,
        Shutter(shutter.sigma_s, shutter.axis) if shutter else None,
        section.front_deg,
    )


def _position(axis: str, value: float) -> tuple[float | None, float | None, float | None]:
    x, y, z = (value if axis == own else None for own in "xyz")
    return x, y, z
