"""The site file: which videos show which rows, what is known of them, and which plugins look at them. Strict YAML."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, field_validator

Metres = Annotated[float, Field(gt=-1000, lt=1000)]
Footage = tuple[Path, float, float | None, float]
Sigma = Annotated[float, Field(gt=0, le=10)]


class Strict(BaseModel):
    """A section of a site file: unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Known(Strict):
    """A number the user knows, with its standard deviation, both in metres."""

    value: Metres
    sigma: Sigma


class CameraHeight(Strict):
    """Height of the camera above the floor, in metres (a value above 50 is taken for a wrong unit)."""

    value: Annotated[float, Field(gt=0.1, lt=50)]
    sigma: Sigma = 0.02


class Length(Known):
    """A measured distance along one axis between two labelled edges of the map, such as "upright 1 / left"."""

    between: tuple[str, str]
    axis: Literal["x", "y"] = "x"


class SurveyedPoint(Strict):
    """A labelled vertex whose coordinate along one axis is known."""

    vertex: str
    axis: Literal["x", "y", "z"]
    value: Metres
    sigma: Sigma


class Marker(Strict):
    """An AprilTag or ArUco marker somewhere in the footage; its size is the side of its black square."""

    dictionary: Annotated[str, Field(pattern=r"^(tag(16h5|25h9|36h10|36h11)|(4x4|5x5|6x6|7x7)_(50|100|250|1000))$")]
    id: Annotated[int, Field(ge=0)]
    size_m: Annotated[float, Field(gt=0.01, lt=5)]
    sigma_m: Annotated[float, Field(gt=0, le=0.1)] = 0.0005


class ReferenceSection(Strict):
    """What is known without mapping. Scale comes from the camera's height, a length, a marker or surveyed points."""

    camera_height_m: CameraHeight | None = None
    travel_m: Annotated[float, Field(gt=0.5, lt=1000)] | None = None
    lengths: tuple[Length, ...] = ()
    points: tuple[SurveyedPoint, ...] = ()
    markers: tuple[Marker, ...] = ()

    @field_validator("markers")
    @classmethod
    def _each_once(cls, value: tuple[Marker, ...]) -> tuple[Marker, ...]:
        if len({(one.dictionary, one.id) for one in value}) < len(value):
            raise ValueError("a marker is given twice")
        return value


class ViewSection(Strict):
    """A view aimed by hand, degrees and pixels. It wins over the automatic aim."""

    yaw_deg: float
    pitch_deg: float = 0.0
    roll_deg: float = 0.0
    hfov_deg: Annotated[float, Field(gt=20, lt=170)] = 120.0
    width: Annotated[int, Field(ge=64, le=8192)] = 640
    height: Annotated[int, Field(ge=64, le=8192)] = 480


class Pass(Strict):
    """One drive past a row's face: a video (or a folder of pictures), a time range, and the hand the face is on."""

    video: Path
    start_s: Annotated[float, Field(ge=0)] = 0.0
    end_s: float | None = None
    fps: Annotated[float, Field(gt=0, le=120)] = 15.0
    side: Literal["left", "right"] | None = None
    views: Mapping[str, ViewSection] = {}

    @property
    def footage(self) -> Footage:
        """What passes have in common that are the same frames, whichever face they look at."""
        return self.video, self.start_s, self.end_s, self.fps


class PanoramaSection(Strict):
    """How far the panorama's rear half may be turned against the front half about each axis, degrees, and by what part each
    lens's scale may be off: standard deviations. The halves are blended over `blend_deg`."""

    turn_sigma_deg: Annotated[float, Field(gt=0, le=10)] = 1.0
    scale_sigma: Annotated[float, Field(gt=0, le=0.1)] = 0.003
    blend_deg: Annotated[float, Field(gt=0, le=30)] = 1.0


class ShutterSection(Strict):
    """Standard deviation of the read-out time, seconds, and whether it runs over the panorama's rows or each half's columns."""

    sigma_s: Annotated[float, Field(gt=0, le=0.2)] = 0.02
    axis: Literal["rows", "columns"] = "rows"


class CalibrationSection(Strict):
    """What of the camera is estimated with the map; `true` takes the usual figures. The front lens looks at longitude
    `front_deg` of the panorama, degrees to the right of its centre column."""

    panorama: PanoramaSection | None = None
    rolling_shutter: ShutterSection | None = None
    front_deg: Annotated[float, Field(ge=-180, le=180)] = 0.0

    @field_validator("panorama", "rolling_shutter", mode="before")
    @classmethod
    def _switched(cls, value: object) -> object:
        return ({} if value else None) if isinstance(value, bool) else value


class Row(Strict):
    """One structure face along one aisle."""

    passes: Annotated[tuple[Pass, ...], Field(min_length=1)]
    references: ReferenceSection = ReferenceSection()
    plugins: Mapping[str, Mapping[str, Any]] = {}


class Site(Strict):
    """A deployment: rows, the plugins that look at them with their settings, references common to all rows."""

    format: Literal["savmap-site"] = "savmap-site"
    version: Literal[1] = 1
    plugins: Mapping[str, Mapping[str, Any]] = {}
    references: ReferenceSection = ReferenceSection()
    calibration: CalibrationSection = CalibrationSection()
    appearance: bool = False
    survey: Path | None = None
    joint: bool = True
    rows: Annotated[Mapping[str, Row], Field(min_length=1)]

    @field_validator("plugins", mode="before")
    @classmethod
    def _empty_sections(cls, value: object) -> object:
        return {k: v or {} for k, v in value.items()} if isinstance(value, Mapping) else value

    def drives(self) -> list[list[str]]:
        """Names of the rows in groups: each shares a pass with another one of its group, unless `joint` is false."""
        groups = list[list[str]]()
        for name, row in self.rows.items():
            own = {one.footage for one in row.passes} if self.joint else set()
            near = [group for group in groups if any(own & {p.footage for p in self.rows[n].passes} for n in group)]
            groups = [group for group in groups if group not in near]
            groups.append([*(other for group in near for other in group), name])
        return groups

    def row_references(self, name: str) -> ReferenceSection:
        """The site's references with the row's own laid over them."""
        own = self.rows[name].references
        return self.references.model_copy(update={key: getattr(own, key) for key in own.model_fields_set})

    def row_config(self, name: str, plugin: str) -> dict[str, Any]:
        """A plugin's settings for one row: the site's, overlaid by the row's."""
        return {**self.plugins.get(plugin, {}), **self.rows[name].plugins.get(plugin, {})}
