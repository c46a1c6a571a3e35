"""From the site file's references to the factor graph's."""

from savmap.graph import CameraHeight, KnownLength, References, SurveyedPoint
from savmap.site import ReferenceSection

AXES = ("x", "y", "z")


def references_of(section: ReferenceSection) -> References:
    """The references of one row as the graph takes them."""
    height = section.camera_height_m
    return References(
        camera_heights=(CameraHeight(height.value, height.sigma),) if height else (),
        lengths=tuple(KnownLength(*length.between, length.value, length.sigma) for length in section.lengths),
        points=tuple(
            SurveyedPoint(point.vertex, tuple(point.value if axis == point.axis else None for axis in AXES), point.sigma)
            for point in section.points
        ),
    )
