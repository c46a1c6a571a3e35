"""The shape of map.json, from which its JSON Schema is made: `savmap schema map > docs/map.schema.json`."""

import json
import math
from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from savmap.errors import OutputError
from savmap.files.kinds import kind_of
from savmap.types.verdicts import WarningCode

FORMAT = "savmap-map"
VERSION = 1

FARTHEST_M = 1e6
"""No number of metres is larger: what is drawn, squared and summed stays within a float's bounds."""
FARTHEST_WORLD_M = 1e8
"""Of the site's origin in the user's world: eastings with the number of their zone before them have eight digits
(EPSG:4647)."""
LARGEST = 1e12


def _unit(turn: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    if abs(math.hypot(*turn) - 1) > 1e-3:
        raise ValueError("it is no unit quaternion")
    return turn


def _variances(upper: tuple[float, ...]) -> tuple[float, ...]:
    if min(upper[0], upper[3], upper[5]) < 0:
        raise ValueError("a variance is negative")
    return upper


Metres = Annotated[float, Field(ge=-FARTHEST_M, le=FARTHEST_M)]
WorldMetres = Annotated[float, Field(ge=-FARTHEST_WORLD_M, le=FARTHEST_WORLD_M)]
Deviation = Annotated[float, Field(ge=0, le=FARTHEST_M)]
Degrees = Annotated[float, Field(ge=-3600, le=3600)]
Number = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]
Pixels = Annotated[int, Field(ge=1, le=1 << 16)]
Vector = Annotated[tuple[Metres, Metres, Metres], Field(description="x, y, z in the row's frame, m")]
Sigma = Annotated[tuple[Deviation, Deviation, Deviation], Field(description="standard deviation of x, y, z, m")]
Quaternion = Annotated[
    tuple[float, float, float, float],
    Field(description="x, y, z, w of world_from_rig, w >= 0"),
    AfterValidator(_unit),
]
UpperTriangle = Annotated[
    tuple[Number, Number, Number, Number, Number, Number],
    Field(description="covariance xx, xy, xz, yy, yz, zz, m^2"),
    AfterValidator(_variances),
]
Slot = Annotated[int, Field(ge=-1)]
Value = Number | Annotated[int, Field(ge=-LARGEST, le=LARGEST)] | str


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class VertexEntry(_Part):
    """A labelled corner, edge end or centre of a structure."""

    label: str
    position_m: Vector
    sigma_m: Sigma
    covariance_m2: UpperTriangle


class MeasuredEntry(_Part):
    """A number with its standard deviation, in the unit that its name ends with."""

    value: Number
    sigma: float = Field(ge=0, le=LARGEST)


class SolidEntry(_Part):
    """The space that a structure fills: a flat outline, corners in order, pushed along `depth_m`. `assumed`: the depth
    was neither measured nor given."""

    outline_m: Annotated[list[Vector], Field(min_length=3, max_length=1000)]
    depth_m: Vector
    assumed: bool
    ifc_class: Annotated[
        str, Field(pattern="^Ifc[A-Za-z0-9]+$", max_length=80, description="its class in building models")
    ]


class StructureEntry(_Part):
    """One mapped structure. Edges join vertices by their number in `vertices`, from 0."""

    id: str
    label: str
    vertices: Annotated[list[VertexEntry], Field(min_length=1)]
    edges: list[tuple[int, int]]
    attributes: dict[str, Value | MeasuredEntry]
    solid: SolidEntry | None = None


class FrameEntry(_Part):
    """A frame of the row in order of its number; pose null where it is not known."""

    frame: int = Field(ge=0)
    stamp_s: Number = Field(description="time in its own video")
    pass_name: str = Field(alias="pass")
    position_m: Vector | None
    orientation_xyzw: Quaternion | None
    sigma_m: Sigma | None


class ViewEntry(_Part):
    """A rectilinear view: its direction in the panorama, and its size."""

    yaw_deg: Degrees
    pitch_deg: Degrees
    roll_deg: Degrees
    hfov_deg: float = Field(gt=0, lt=180)
    width: Pixels
    height: Pixels


class ReferenceEntry(_Part):
    """A reference of the solve; residual = solved - value. `sigma`: given; `sigma_used`: larger where references
    contradict one another, null where this one is not used. `state`: `contradicted` where it is used and the residual
    is more than three given sigmas."""

    name: str
    unit: str
    value: Number
    sigma: float = Field(gt=0, le=LARGEST)
    sigma_used: Annotated[float, Field(gt=0, le=LARGEST)] | None = None
    solved: Number
    residual: Number
    state: Literal["used", "softened", "contradicted", "left out"] = "used"


class WarningEntry(_Part):
    """What speaks against a part of a row's map: a code, and its headline; one figure, what to do, and further lines;
    the ids of what it is about (none: the whole row), place (m) and frame."""

    code: WarningCode
    headline: str
    figure: str = ""
    action: str = ""
    details: list[str] = []
    subjects: list[str] = []
    place_m: Vector | None = None
    frame: int | None = None


class VerdictEntry(_Part):
    """Whether a row's map may be used as it is, and what that rests on that nothing checks."""

    grade: Literal["trusted", "check"]
    warnings: list[WarningEntry]
    notes: list[str] = []


class JointEntry(_Part):
    """How the errors of a row's vertices go together. `coordinates` by plugin and structure id: for each vertex, x y z,
    the number of its coordinate from 0; -1: its error is independent of all others', and `covariance_m2` of the vertex
    has its variance. `covariance_m2`: the upper triangle of the covariance of these `size` coordinates, row by row,
    32-bit floats, the least significant byte first, in base64. `unchecked_m`: how far each coordinate is off, with its
    sign, with each error of a reference that no second one would show."""

    size: Annotated[int, Field(ge=1, le=20000)]
    coordinates: dict[str, dict[str, list[tuple[Slot, Slot, Slot]]]]
    covariance_m2: str
    unchecked_m: list[list[float]] = []


class RowEntry(_Part):
    """One row in its own frame: x along the aisle from the first element's outer edge, y up from the floor, z towards
    the camera, face at z = 0. Structures by plugin."""

    trajectory: list[FrameEntry]
    views: dict[str, ViewEntry]
    structures: dict[str, list[StructureEntry]]
    references: list[ReferenceEntry]
    report: dict[str, Value]
    verdict: VerdictEntry | None = None
    joint: JointEntry | None = None


class PlacementEntry(_Part):
    """Where a row's frame stands in the site's: origin at (x, 0, z), x axis turned by the heading about y,
    counter-clockwise as seen from above."""

    x_m: Metres
    z_m: Metres
    heading_deg: Degrees
    covariance: UpperTriangle = Field(description="xx, xz, xh, zz, zh, hh of x m, z m, heading degrees")


class MatchEntry(_Part):
    """What two rows have in common; residual b - a in the site's frame, null along axes that the match does not
    measure."""

    row_a: str
    row_b: str
    id_a: str
    id_b: str
    residual_m: tuple[Metres | None, Metres | None, Metres | None]
    sigma_m: tuple[Deviation | None, Deviation | None, Deviation | None]


class AlignmentResidualEntry(_Part):
    """A place of the map that the user knows: where it is given less where the map has it, null along axes that are not
    given; of a line, across it. `deviation`: in standard deviations."""

    row: str
    at: str
    residual_m: tuple[Number | None, Number | None, Number | None]
    sigma_m: tuple[Deviation | None, Deviation | None, Deviation | None]
    deviation: Annotated[float, Field(ge=0, le=LARGEST)]
    used: bool


class AlignmentEntry(_Part):
    """Where the site stands in the user's world (z up): the site's x axis points `heading_deg` counter-clockwise from
    the world's x axis."""

    x_m: WorldMetres
    y_m: WorldMetres
    z_m: Metres = 0.0
    heading_deg: Degrees
    covariance: UpperTriangle = Field(description="xx, xy, xh, yy, yh, hh of x m, y m, heading degrees")
    residuals: list[AlignmentResidualEntry] = Field(default=[], description="of the places that it was solved from")
    scale: MeasuredEntry | None = Field(
        default=None, description="user's distances over the map's, which stay as they are"
    )
    anchor_lat_lon_deg: (
        tuple[Annotated[float, Field(ge=-90, le=90)], Annotated[float, Field(ge=-180, le=180)]] | None
    ) = None


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
    aligned: AlignmentEntry | None = Field(default=None, description="where the site stands in the user's world")


def require_format(content: object, path: str, what: str, name: str, version: int) -> None:
    """Raise OutputError for what was read from a file and is no map, survey (`what`) of this format and version."""
    if not isinstance(content, dict) or content.get("format") != name:
        kind = kind_of(content)
        raise OutputError(f'{path}: is {kind and f"{kind}, "}not a {what} (it has no "format": "{name}")')
    if content.get("version") != version:
        raise OutputError(
            f"{path}: is a {what} of version {content.get('version')}; this program reads version {version}"
        )


def schema_text() -> str:
    """The JSON Schema of a map file; descriptions are on one line each."""
    text = json.dumps(MapFile.model_json_schema(by_alias=True), indent=2, sort_keys=True)
    return text.replace(r"\n", " ") + "\n"
