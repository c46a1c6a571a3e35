"""From the site file's references to the factor graph's."""

from savmap.graph import CameraHeight, KnownLength, KnownMarker, References, SurveyedPoint
from savmap.site import ReferenceSection


def references_of(section: ReferenceSection) -> References:
    """The references of one row as the graph takes them."""
    height = section.camera_height_m
    return References(
        camera_heights=(CameraHeight(height.value, height.sigma),) if height else (),
        lengths=tuple(KnownLength(*one.between, one.value, one.sigma, one.axis) for one in section.lengths),
        points=tuple(SurveyedPoint(one.vertex, _position(one.axis, one.value), one.sigma) for one in section.points),
        markers=tuple(KnownMarker(one.dictionary, one.id, one.size_m, one.sigma_m) for one in section.markers),
    )


def _position(axis: str, value: float) -> tuple[float | None, float | None, float | None]:
    x, y, z = (value if axis == own else None for own in "xyz")
    return x, y, z
