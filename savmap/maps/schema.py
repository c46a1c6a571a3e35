"""The shape of map.json, from which its JSON Schema is made: `savmap schema map > docs/map.schema.json`."""

import json
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

FORMAT = "savmap-map"
VERSION = 1

Vector = Annotated[tuple[float, float, float], Field(description="x, y, z in the row's frame, m")]
Sigma = Annotated[tuple[float, float, float], Field(description="standard deviation of x, y, z, m")]
Quaternion = Annotated[tuple[float, float, float, float], Field(description="x, y, z, w of world_from_rig, w >= 0")]
UpperTriangle = Annotated[
    tuple[float, float, float, float, float, float], Field(description="covariance xx, xy, xz, yy, yz, zz, m^2")
]
Value = float | int | str


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class VertexEntry(_Part):
    """A labelled corner, edge end or centre of a structure."""

    label: str
    position_m: Vector
    sigma_m: Sigma
    covariance_m2: UpperTriangle


class MeasuredEntry(_Part):
    """A number with its standard deviation, in the unit that its name ends with."""

    value: float
    sigma: float = Field(ge=0)


class StructureEntry(_Part):
    """One mapped structure. Edges join vertices by their number in `vertices`, from 0."""

    id: str
    label: str
    vertices: list[VertexEntry]
    edges: list[tuple[int, int]]
    attributes: dict[str, Value | MeasuredEntry]


class FrameEntry(_Part):
    """A frame of the row in order of its number; pose null where it is not known."""

    frame: int = Field(ge=0)
    stamp_s: float = Field(description="time in its own video")
    pass_name: str = Field(alias="pass")
    position_m: Vector | None
    orientation_xyzw: Quaternion | None
    sigma_m: Sigma | None


class ViewEntry(_Part):
    """A rectilinear view: its direction in the panorama, and its size."""

    yaw_deg: float
    pitch_deg: float
    roll_deg: float
    hfov_deg: float
    width: int
    height: int


class ReferenceEntry(_Part):
    """A reference of the solve; residual = solved - value."""

    name: str
    unit: str
    value: float
    sigma: float
    solved: float
    residual: float


class DoubtEntry(_Part):
    """What speaks against a part of a row's map, in one line, and which structures, place (m) and frame it is about."""

    kind: Literal["reference", "repeatability", "support", "shape", "camera", "motion", "residuals"]
    what: str
    structures: list[str] = []
    place_m: Vector | None = None
    frame: int | None = None


class VerdictEntry(_Part):
    """Whether a row's map may be used as it is."""

    grade: Literal["trusted", "check"]
    doubts: list[DoubtEntry]


class RowEntry(_Part):
    """One row in its own frame: x along the aisle from the first element's outer edge, y up from the floor, z towards
    the camera, face at z = 0. Structures by plugin."""

    trajectory: list[FrameEntry]
    views: dict[str, ViewEntry]
    structures: dict[str, list[StructureEntry]]
    references: list[ReferenceEntry]
    report: dict[str, Value]
    verdict: VerdictEntry | None = None


class PlacementEntry(_Part):
    """Where a row's frame stands in the site's: origin at (x, 0, z), x axis turned by the heading about y, counter-clockwise as
    seen from above."""

    x_m: float
    z_m: float
    heading_deg: float
    covariance: UpperTriangle = Field(description="xx, xz, xh, zz, zh, hh of x m, z m, heading degrees")


class MatchEntry(_Part):
    """What two rows have in common; residual b - a in the site's frame, null along axes that the match does not measure."""

    row_a: str
    row_b: str
    id_a: str
    id_b: str
    residual_m: tuple[float | None, float | None, float | None]
    sigma_m: tuple[float | None, float | None, float | None]


class MapFile(_Part):
    """A savmap map: metres and seconds."""

    format: Literal["savmap-map"]
    version: Literal[1]
    units: Literal["m"]
    made_by: dict[str, str] = Field(description="software and model versions, SHA-256 of models")
    rows: dict[str, RowEntry]
    failed: dict[str, str] = Field(default={}, description="rows that could not be mapped, and why")
    placed: dict[str, PlacementEntry] = Field(default={}, description="placements of rows in the site's frame")
    ties: list[MatchEntry] = Field(default=[], description="what neighbouring rows have in common")


def schema_text() -> str:
    """The JSON Schema of a map file."""
    return json.dumps(MapFile.model_json_schema(by_alias=True), indent=2, sort_keys=True) + "\n"
