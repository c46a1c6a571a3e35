"""Sections of a site file: what is known without mapping, views aimed by hand, the camera, where rows stand."""

import math
import re
from collections.abc import Mapping
from dataclasses import fields, replace
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    PlainSerializer,
    PlainValidator,
    ValidationInfo,
    WithJsonSchema,
    field_validator,
    model_validator,
)
from pydantic_core import PydanticKnownError

from savmap.errors import SiteError
from savmap.files.texts import fault_of_path
from savmap.files.urls import where
from savmap.files.validation import SHORT
from savmap.geometry.cameras import Camera, Fisheye, FisheyePair, Pinhole
from savmap.types.calibration import LensDistance, Shutter, Stitching, VerticalScale
from savmap.types.written import FARTHEST_WORLD_M
from savmap.video.calibration import camera_from

Metres = Annotated[float, Field(gt=-1000, lt=1000)]
Sigma = Annotated[float, Field(gt=0, le=10)]
HeightOfCamera = Annotated[float, Field(gt=0.1, lt=50)]
Span = Annotated[float, Field(gt=0, lt=1000)]
Angle = Annotated[float, Field(ge=-360, le=360)]


def _where(value: Any) -> Path:
    if not isinstance(value, str) and not hasattr(value, "read_bytes"):
        raise ValueError("a path or a URL is expected")
    if fault := fault_of_path(str(value)):
        raise ValueError(f"a path {fault}")
    try:
        return where(value)
    except SiteError as error:
        raise ValueError(str(error)) from None


Where = Annotated[
    Path,
    PlainValidator(_where),
    PlainSerializer(str),
    WithJsonSchema({"type": "string", "description": "a path, from the site file's folder, or a URL of fsspec"}),
]
"""A path or URL in a site file."""


def _several(value: object) -> object:
    return [part.strip() for part in value.split(",")] if isinstance(value, str) else value


Provider = Literal["cpu", "cuda", "tensorrt", "openvino", "coreml"]
Providers = Annotated[
    tuple[Provider, ...], BeforeValidator(_several, json_schema_input_type=Provider | tuple[Provider, ...])
]
"""Execution providers of onnxruntime, one or more; as text with commas between."""


class Strict(BaseModel):
    """A section of a site file: unknown keys are refused. Known ones without a value are as good as left out."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True, allow_inf_nan=False)

    @model_validator(mode="before")
    @classmethod
    def _left_out(cls, value: object) -> object:
        if not isinstance(value, Mapping):
            return value
        of_none = {key for key, field in cls.model_fields.items() if NoneType not in get_args(field.annotation)}
        return {key: given for key, given in value.items() if given is not None or key not in of_none}

    @field_validator("*", mode="before")
    @classmethod
    def _no_word_for_a_number(cls, value: object, field: ValidationInfo) -> object:
        """YAML's yes and no, which pydantic takes for 1 and 0."""
        if not isinstance(value, bool):
            return value
        annotation = cls.model_fields[str(field.field_name)].annotation
        choices = get_args(annotation) if get_origin(annotation) in (Union, UnionType) else (annotation,)
        if float in choices or any(get_args(choice)[:1] == (float,) for choice in choices):
            raise PydanticKnownError("float_type")
        return value


class GivenNumber(Strict):
    """A number the user knows, with its standard deviation, both in metres."""

    value: Metres
    """Metres."""
    sigma: Sigma
    """Its standard deviation."""


class CameraHeight(Strict):
    """Height of the camera above the floor, in metres (a value above 50 is taken for a wrong unit)."""

    value: HeightOfCamera
    """Metres."""
    sigma: Sigma = 0.02
    """Its standard deviation."""


def _height_alone(value: object) -> object:
    return {"value": value} if isinstance(value, int | float | str) and not isinstance(value, bool) else value


HIGHER = {"x": {"left": 0, "right": 1}, "y": {"lower": 0, "bottom": 0, "upper": 1, "top": 1}}
"""Words in an edge's name that say which of two it is along an axis."""


def _rank(name: str, axis: str) -> tuple[str, tuple[int, int]]:
    """What edges have in common that their names put in order along an axis, and the place of this one: numbers rise
    from left to right, and within a section from the floor up."""
    parts = [part.strip() for part in name.split("/")]
    numbers = [int(number) for number in re.findall(r"\d{1,9}", name)]
    side = max((HIGHER[axis].get(word, 0) for word in name.replace("/", " ").split()), default=0)
    if axis == "x":
        return re.sub(r"\d+", "#", parts[0]), (numbers[0] if numbers else 0, side)
    return parts[0], (numbers[1] if len(numbers) > 1 else 0, side)


class Length(GivenNumber):
    """A measured distance along one axis between two labelled edges of the map, such as "upright 1 / left"."""

    between: tuple[str, str]
    """Labels of the two edges, such as "upright 1 / left", in either order."""
    value: Span
    """Metres."""
    axis: Literal["x", "y"] = "x"
    """Along the aisle, or upwards."""

    @field_validator("between")
    @classmethod
    def _differ(cls, value: tuple[str, str]) -> tuple[str, str]:
        if value[0] == value[1]:
            raise ValueError(f"two different edges are expected, not twice {value[0]}")
        return value

    @property
    def in_order(self) -> tuple[str, str]:
        """The two edges in the order of their coordinates, as far as their names tell: numbers rise from left to right
        and from the floor up."""
        (alike, first), (also, second) = (_rank(name, self.axis) for name in self.between)
        return (self.between[1], self.between[0]) if alike == also and first > second else self.between


class SurveyedPoint(Strict):
    """A labelled vertex whose coordinate along one axis is known."""

    vertex: str
    """Its label, such as "bay 1 / beam 1 / lower left"."""
    axis: Literal["x", "y", "z"]
    """Along the aisle, upwards, or out of the face."""
    value: Metres
    """Metres."""
    sigma: Sigma
    """Its standard deviation."""


DICTIONARY = r"^(tag(16h5|25h9|36h10|36h11)|(4x4|5x5|6x6|7x7)_(50|100|250|1000))$"


def _dictionary(name: str) -> str:
    if not re.fullmatch(DICTIONARY, name):
        names = "tag16h5, tag25h9, tag36h10, tag36h11, or 4x4_50 to 7x7_1000"
        raise ValueError(f"{names} is expected (it is {SHORT.repr(name)})")
    return name


class Marker(Strict):
    """An AprilTag or ArUco marker somewhere in the footage; its size is the side of its black square."""

    dictionary: Annotated[str, AfterValidator(_dictionary), WithJsonSchema({"type": "string", "pattern": DICTIONARY})]
    """AprilTag: tag16h5, tag25h9, tag36h10, tag36h11; ArUco: 4x4_50 to 7x7_1000."""
    id: Annotated[int, Field(ge=0)]
    """Its number in the dictionary."""
    size_m: Annotated[float, Field(gt=0.01, lt=5)]
    """The side of its black square as measured on the print."""
    sigma_m: Annotated[float, Field(gt=0, le=0.1)] = 0.0005
    """Standard deviation of size_m."""


class ReferenceSection(Strict):
    """What is known without mapping. Scale comes from the camera's height, a length, a marker or surveyed points."""

    camera_height_m: Annotated[
        CameraHeight | None,
        BeforeValidator(_height_alone, json_schema_input_type=HeightOfCamera | CameraHeight | None),
    ] = None
    """Height of the camera above the floor; the value may stand alone, without a sigma."""
    travel_m: Annotated[float, Field(gt=0.5, lt=1000)] | None = None
    """Roughly how far the camera goes: a first guess, not a reference."""
    lengths: tuple[Length, ...] = ()
    """Distances measured between labelled edges of the map."""
    points: tuple[SurveyedPoint, ...] = ()
    """Coordinates of labelled vertices."""
    markers: tuple[Marker, ...] = ()
    """Fiducial markers somewhere in the footage."""
    on_contradiction: Literal["check", "refuse", "leave_out"] = "check"
    """What becomes of a row where the pictures and the other references contradict one: `check`, it is mapped without
    the one that is wrong and its verdict is `check`; `refuse`, it is not mapped; `leave_out`, as `check`, but without a
    warning where it is clear which one is wrong. Where that is not clear and much is at stake, the row is refused."""

    @field_validator("markers")
    @classmethod
    def _each_once(cls, value: tuple[Marker, ...]) -> tuple[Marker, ...]:
        if len({(marker.dictionary, marker.id) for marker in value}) < len(value):
            raise ValueError("a marker is given twice")
        return value


class ViewSection(Strict):
    """A view aimed by hand, degrees and pixels. It wins over the automatic aim."""

    yaw_deg: float
    """To the right of the panorama's centre column."""
    pitch_deg: float = 0.0
    """Upwards."""
    roll_deg: float = 0.0
    """Clockwise."""
    hfov_deg: Annotated[float, Field(gt=20, lt=170)] = 120.0
    """From the left border of the picture to the right one."""
    width: Annotated[int, Field(ge=64, le=8192)] = 640
    """Pixels."""
    height: Annotated[int, Field(ge=64, le=8192)] = 480
    """Pixels."""


Model = Literal["panorama", "pinhole", "fisheye", "fisheye-pair"]
MODELS: tuple[str, ...] = get_args(Model)
USUAL_HFOV_DEG = {"pinhole": 65.0, "fisheye": 180.0, "fisheye-pair": 190.0}
"""Of a phone's main lens filming upright video is about 65 degrees across."""


class CameraSection(Strict):
    """The camera that took the pictures, where they are no whole panoramas: `hfov_deg` or a calibration says which
    directions they show."""

    model: Model
    """A whole panorama a picture; an ordinary lens; a fisheye lens; two of them, back to back, their circles side by
    side."""
    hfov_deg: Annotated[float, Field(gt=10, lt=300)] | None = None
    """From the left border of the picture (of a pair: of the left half) to the right one. Default: 65 for an ordinary
    lens, 180 for a fisheye, 190 for a pair."""
    radial: Annotated[float, Field(gt=-1, lt=1)] = 0.0
    """The first radial term (OpenCV's k1) of an ordinary lens, beside `hfov_deg`."""
    calibration: Where | None = None
    """A calibration file of OpenCV, ROS (`camera_info`) or Kalibr, in place of `hfov_deg`."""

    @model_validator(mode="after")
    def _fits(self) -> "CameraSection":
        if self.calibration is not None and self.hfov_deg is not None:
            raise ValueError("`calibration` says what `hfov_deg` says: give one of them")
        if self.model == "panorama" and (self.calibration is not None or self.hfov_deg is not None):
            raise ValueError("a whole panorama needs neither `hfov_deg` nor `calibration`")
        if self.model == "pinhole" and self.hfov_deg is not None and self.hfov_deg > WIDEST_PINHOLE_DEG:
            raise ValueError(f"no ordinary lens shows {self.hfov_deg:g} degrees: is it a fisheye?")
        return self

    def camera(self, width: int, height: int) -> Camera:
        """The camera of pictures of this size. Raises SiteError where its calibration is not of such pictures, or of
        another model."""
        if self.calibration is not None:
            camera = camera_from(self.calibration, width, height)
            if not isinstance(camera, KINDS[self.model]):
                raise SiteError(f"{self.calibration}: the calibration is of another model than `{self.model}`")
            return camera
        hfov = self.hfov_deg or USUAL_HFOV_DEG[self.model]
        if self.model == "pinhole":
            return replace(Pinhole.of_hfov(width, height, hfov), distortion=(self.radial,) if self.radial else ())
        if self.model == "fisheye":
            return Fisheye.of_hfov(width, height, hfov)
        lens = Fisheye.of_hfov(width // 2, height, hfov)
        return FisheyePair(lens, lens, np.eye(3), np.diag([-1.0, 1.0, -1.0]))


WIDEST_PINHOLE_DEG = 150.0
KINDS: Mapping[str, type[Camera]] = {"pinhole": Pinhole, "fisheye": Fisheye, "fisheye-pair": FisheyePair}


def _switch(kind: Any) -> BeforeValidator:
    """For a section that `true` may stand for. Known keys without a value are as good as left out."""
    known_keys = {field.name for field in fields(kind)}

    def switched(value: object) -> object:
        if isinstance(value, Mapping):
            return {key: given for key, given in value.items() if given is not None or key not in known_keys}
        return ({} if value else None) if isinstance(value, bool) else value

    return BeforeValidator(switched, json_schema_input_type=bool | kind | None)


class CalibrationSection(Strict):
    """What of the camera is estimated with the map; `true` takes the usual figures."""

    panorama: Annotated[Stitching | None, _switch(Stitching)] = None
    """The fit of the panorama's two halves."""
    vertical_scale: Annotated[VerticalScale | None, _switch(VerticalScale)] = None
    """A factor of all elevations: panoramas that were cropped and stretched to 2:1 again."""
    lens_distance: Annotated[LensDistance | None, _switch(LensDistance)] = None
    """The distance between the lenses: pictures that are bent at a seam that crosses the face."""
    rolling_shutter: Annotated[Shutter | None, _switch(Shutter)] = None
    """The time from the first row of the panorama to the last one."""
    front_deg: Annotated[float, Field(ge=-180, le=180)] = 0.0
    """Longitude of the panorama at which the front lens looks, degrees to the right of its centre column."""


class PlaceSection(Strict):
    """Where a row stands on the site's floor: the left end of the row, as one faces it, and which way its x axis
    runs."""

    x_m: Annotated[float, Field(gt=-1e5, lt=1e5)]
    """The row's origin in the site's frame: the outer edge of its first element, on the left as one faces it."""
    z_m: Annotated[float, Field(gt=-1e5, lt=1e5)]
    """The row's origin in the site's frame; on a plan with x to the right, z runs down the sheet."""
    heading_deg: Angle
    """Which way the row runs to the right as one faces it: 0 along the site's x, counter-clockwise as seen from
    above."""
    sigma_m: Sigma = 0.3
    """Standard deviation of x_m and of z_m."""
    sigma_deg: Annotated[float, Field(gt=0, le=90)] = 2.0
    """Standard deviation of heading_deg."""


class LayoutSection(Strict):
    """Rows at regular spacing, one behind the other: faces look at one another across aisles, and stand back to back
    with the next ones. The layout's corner is at x_m, z_m; all rows begin on the line through it, at right angles to
    them."""

    aisle_m: Span
    """From a face to the one across the aisle."""
    rack_m: Span
    """From a face to the one behind its back."""
    length_m: Span | None = None
    """Length of the rows, from the outer edge of the first element to the outer edge of the last."""
    lengths_m: Mapping[str, Span] = {}
    """Lengths of single rows, where they differ from length_m."""
    rows: tuple[str | None, ...] | None = None
    """The rows in order; null for a face that is not mapped. Default: all rows, as they stand in the file."""
    begins_with: Literal["aisle", "rack"] = "aisle"
    """What is between the first row and the second: an aisle, or the racks' backs."""
    x_m: Annotated[float, Field(gt=-1e5, lt=1e5)] = 0.0
    """Where the layout's corner stands in the site's frame."""
    z_m: Annotated[float, Field(gt=-1e5, lt=1e5)] = 0.0
    """Where the layout's corner stands in the site's frame; on a plan with x to the right, z runs down the sheet."""
    heading_deg: Angle = 0.0
    """Turn of the whole layout, counter-clockwise as seen from above."""
    sigma_m: Sigma = 0.3
    """Standard deviation of where a row's origin stands, along x and z each."""
    sigma_deg: Annotated[float, Field(gt=0, le=90)] = 2.0
    """Standard deviation of a row's heading."""


Easting = Annotated[float, Field(ge=-FARTHEST_WORLD_M, le=FARTHEST_WORLD_M)]
KnownSigma = Annotated[float, Field(ge=1e-4, le=10)]
MOST_PLACES = 500
"""Points, or lines, at most: their joint covariance is a matrix."""


class AlignPoint(Strict):
    """A place of the map that the user knows in their own world."""

    row: str | None = None
    """The row that it is in; not needed where there is one row alone."""
    at: str
    """A vertex, "upright 1 / left / bottom", what begins so, "upright 1 / left", or the id of a whole structure: the
    mean of its vertices."""
    world_m: tuple[Easting, Easting] | tuple[Easting, Easting, Metres]
    """x, y, and z (up) where it is known, in the user's world."""
    sigma_m: KnownSigma = 0.01
    """Standard deviation of each."""


LEAST_LINE_M = 0.001
"""Two points that are nearer give no line a direction."""


class AlignLine(Strict):
    """A straight line of the user's world on which places of the map lie, seen from above."""

    row: str | None = None
    """The row that the places are in; not needed where there is one row alone."""
    through: Annotated[tuple[str, ...], Field(min_length=1, max_length=MOST_PLACES)]
    """Places as in points, in the order in which the line runs past them."""
    world_m: tuple[tuple[Easting, Easting], tuple[Easting, Easting]]
    """Two points x, y of the line, which runs from the first to the second and beyond either."""
    sigma_m: KnownSigma = 0.01
    """Standard deviation of the line, across it."""

    @field_validator("world_m")
    @classmethod
    def _apart(cls, value: tuple[tuple[float, float], tuple[float, float]]) -> tuple[tuple[float, float], ...]:
        if math.dist(*value) < LEAST_LINE_M:
            raise ValueError(f"the two points of the line are the same, to {LEAST_LINE_M:g} m")
        return value


class Anchor(Strict):
    """Where the origin of the user's world is on the Earth (WGS 84); its x axis points east there, its y axis north."""

    latitude_deg: Annotated[float, Field(ge=-85, le=85)]
    """Positive to the north."""
    longitude_deg: Annotated[float, Field(ge=-180, le=180)]
    """Positive to the east."""


class AlignSection(Strict):
    """Where the site stands in the user's world (z up, metres), such as a robot's map or a building's plan: by places
    known in both, or by x, y and heading. The map's scale is never changed."""

    points: Annotated[tuple[AlignPoint, ...], Field(max_length=MOST_PLACES)] = ()
    """Places known in both, two or more."""
    lines: Annotated[tuple[AlignLine, ...], Field(max_length=MOST_PLACES)] = ()
    """Lines of the user's world on which places of the map lie."""
    x_m: Easting | None = None
    """Where the site's origin stands in the user's world."""
    y_m: Easting | None = None
    """Where the site's origin stands in the user's world."""
    z_m: Metres = 0.0
    """Height of the site's floor in the user's world; points with a z say it themselves."""
    heading_deg: Angle | None = None
    """Which way the site's x axis runs there: 0 along x, counter-clockwise as seen from above."""
    sigma_m: Sigma = 0.05
    """Standard deviation of x_m and of y_m."""
    sigma_deg: Annotated[float, Field(gt=0, le=90)] = 0.5
    """Standard deviation of heading_deg."""
    anchor: Anchor | None = None
    """Where the user's world is on the Earth, for GeoJSON."""

    @model_validator(mode="after")
    def _one_way(self) -> "AlignSection":
        pose = [value is not None for value in (self.x_m, self.y_m, self.heading_deg)]
        if any(pose) and (self.points or self.lines):
            raise ValueError("give points or lines, or x_m, y_m and heading_deg, not both")
        if any(pose) and not all(pose):
            raise ValueError("x_m, y_m and heading_deg go together")
        if len(self.points) == 1 and not self.lines:
            raise ValueError("one point does not say how the site is turned: give another one far from it")
        if not (any(pose) or self.points or self.lines):
            raise ValueError("give two or more points, or lines, or x_m, y_m and heading_deg")
        return self
