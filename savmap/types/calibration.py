"""What of the camera may be estimated with the map, and how far each may be off."""

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field


@dataclass(frozen=True)
class Stitching:
    """How far the panorama's rear half may be turned against the front half about each of the front lens's axes, and by
    what part each lens's scale may be off."""

    turn_sigma_deg: Annotated[float, Field(gt=0, le=10, description="Standard deviation of each of the angles.")] = 1.0
    scale_sigma: Annotated[float, Field(gt=0, le=0.1, description="Standard deviation of each lens's scale.")] = 0.003
    blend_deg: Annotated[float, Field(gt=0, le=30, description="Over how many degrees the halves are blended.")] = 1.0


@dataclass(frozen=True)
class VerticalScale:
    """By what share the panorama may show elevations too large, or too small."""

    sigma: Annotated[float, Field(gt=0, le=0.2, description="Standard deviation of the share.")] = 0.02


@dataclass(frozen=True)
class LensDistance:
    """How far apart the camera's two lenses may stand, where its program bends the pictures at a seam that crosses the
    face. Where the seam is, the footage tells, not `front_deg`."""

    sigma_m: Annotated[
        float, Field(gt=0, le=0.2, description="Standard deviation of the distance, for each way to bend.")
    ] = 0.03


@dataclass(frozen=True)
class Shutter:
    """The panorama's read-out time over its rows (later lower down) or each half's columns (later to the right);
    negative where it runs the other way."""

    sigma_s: Annotated[float, Field(gt=0, le=0.2, description="Standard deviation of the read-out time.")] = 0.02
    axis: Annotated[
        Literal["rows", "columns"],
        Field(description="From the top of the panorama down, or across each half to the right."),
    ] = "rows"
