"""The site file: which videos show which rows, what is known of them, and which plugins look at them. Strict YAML."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from pydantic import ConfigDict, Field, field_validator, model_validator

from savmap.files.atomic import file_name
from savmap.files.texts import fault_of_path
from savmap.files.validation import SHORT
from savmap.site.locations import INHERITED
from savmap.site.sections import (
    AlignSection,
    CalibrationSection,
    CameraSection,
    LayoutSection,
    PlaceSection,
    Providers,
    ReferenceSection,
    Strict,
    ViewSection,
    Where,
)
from savmap.video.clip import IMAGES_FPS, USUAL_FPS, Clip, is_folder

Footage = tuple[Path, float, float | None, float, CameraSection | None]
Side = Literal["left", "right"]
SIDES: tuple[Side, ...] = ("left", "right")
Rate = Annotated[float, Field(gt=0, le=120)]
Settings = Mapping[str, Any]
Section = TypeVar("Section", bound=Strict)
MOST_NAME = 100
"""Letters of a row's name, which becomes part of files' names."""
MOST_CONFIRMED = 200
MIN_FRAMES = 3
"""Fewer frames of a pass cannot be mapped from."""
DIRECTIONS = {"left": "+x", "right": "-x"}


def _completed(site: object) -> object:
    """A site's content with its passes' video, rate and views filled in from their row or the site. What is not as it
    should be is left as it is, for the checks that follow."""
    if not isinstance(site, Mapping) or not isinstance(site.get("rows"), Mapping):
        return site
    rows = dict(site["rows"])
    for name, row in rows.items():
        if isinstance(row, Mapping) and isinstance(row.get("passes"), list | tuple):
            rows[name] = {**row, "passes": [_completed_pass(section, row, site) for section in row["passes"]]}
    return {**site, "rows": rows}


def _completed_pass(section: object, row: Mapping[Any, Any], site: Mapping[Any, Any]) -> object:
    if not isinstance(section, Mapping):
        return section
    levels = (site, row, section)
    inherited = {key: level[key] for level in levels for key in INHERITED if level.get(key) is not None}
    views = [level["views"] for level in levels if isinstance(level.get("views"), Mapping)]
    named = {name: view for level in views for name, view in level.items()}
    return {**section, **inherited, **({"views": named} if named else {})}


def _without_video(schema: dict[str, Any]) -> None:
    """A pass's JSON Schema for files, in which the video may stand with the row or the site."""
    schema["required"] = [key for key in schema.get("required", []) if key != "video"]
    if not schema["required"]:
        del schema["required"]


class Confirmed(Strict):
    """What a person looked at and found right although a warning names it."""

    code: Literal["uncertain-element", "incomplete-map"]
    """The warning's code: of those that a look at the pictures can settle."""
    subjects: Annotated[tuple[Annotated[str, Field(min_length=1, max_length=200)], ...], Field(min_length=1)]
    """What it is about, as the warning names it."""
    reason: str = ""
    """Why it is right, for those who read the site file."""


class Pass(Strict):
    """One drive past a row's face: a video (or a folder of pictures), a time range, and the hand the face is on."""

    model_config = ConfigDict(json_schema_extra=_without_video)

    video: Where
    """A panoramic video or a folder of pictures: a path, from the site file's folder, or a URL. Default: the row's, or
    the site's."""
    start_s: Annotated[float, Field(ge=0)] = 0.0
    """Where in the video the pass begins."""
    end_s: float | None = None
    """Where in the video the pass ends. Default: with the video."""
    fps: Rate | None = None
    """Sampling rate; every frame where the video has fewer. Default: the row's, the site's, or 15; every picture of a
    folder, which count as 30 a second."""
    camera: CameraSection | None = None
    """The camera. Default: the row's, the site's, or one of whole panoramas."""
    side: Side | None = None
    """The hand the face is on as one drives along."""
    direction: Literal["+x", "-x"] | None = None
    """Which way the camera goes along the row's x axis, to the right as one faces the row. A face on the left is passed
    towards +x, one on the right towards -x: it says the same as `side`."""
    views: Mapping[str, ViewSection] = {}
    """Views aimed by hand, by name, laid over those of the row and of the site."""

    @model_validator(mode="before")
    @classmethod
    def _side(cls, value: object) -> object:
        """With the side, where only the direction is given."""
        if not isinstance(value, Mapping) or value.get("direction") not in DIRECTIONS.values():
            return value
        direction = value["direction"]
        side = next(side for side in DIRECTIONS if DIRECTIONS[side] == direction)
        if value.get("side") is None:
            return {**value, "side": side}
        if value["side"] in DIRECTIONS and value["side"] != side:
            raise ValueError(
                f"a face on the {value['side']} is passed towards {DIRECTIONS[value['side']]}, not {direction}; "
                "correct `side` or `direction`"
            )
        return value

    @property
    def rate(self) -> float:
        """How many frames a second are sampled."""
        if self.fps is not None:
            return self.fps
        return IMAGES_FPS if is_folder(self.video) else USUAL_FPS

    @property
    def footage(self) -> Footage:
        """What passes have in common that are the same frames, whichever face they look at."""
        return self.video, self.start_s, self.end_s, self.rate, self.camera

    @property
    def clip(self) -> Clip:
        """The part of the video that the pass means."""
        camera = None if self.camera is None or self.camera.model == "panorama" else self.camera
        return Clip(self.video, self.start_s or None, self.end_s, self.rate, camera=camera)


class Row(Strict):
    """One structure face along one aisle. What it does not say is as the site says."""

    passes: Annotated[tuple[Pass, ...], Field(min_length=1)]
    """One or more drives past the face."""
    video: Where | None = None
    """The video of passes that name none."""
    fps: Rate | None = None
    """Sampling rate of passes that name none."""
    camera: CameraSection | None = None
    """The camera of passes that name none."""
    views: Mapping[str, ViewSection] = {}
    """Views aimed by hand, for all passes."""
    references: ReferenceSection = ReferenceSection()
    """What is known of this row; each key wins over the site's."""
    plugins: Mapping[str, Settings] = {}
    """Plugins' settings for this row; each key wins over the site's."""
    calibration: CalibrationSection | None = None
    """What of the camera is estimated with this row; each key wins over the site's."""
    appearance: bool | None = None
    """Whether points of any kind help with the camera's motion."""
    place: PlaceSection | None = None
    """Where the row stands in the site's frame; wins over the site's `layout`."""
    confirmed: Annotated[tuple[Confirmed, ...], Field(max_length=MOST_CONFIRMED)] = ()
    """Warnings of this row that a person looked at and found wrong, by code and subject: they become notes."""

    @field_validator("plugins", mode="before")
    @classmethod
    def _empty_sections(cls, value: object) -> object:
        return _emptied(value)


class Site(Strict):
    """A deployment: rows, the plugins that look at them with their settings, references common to all rows."""

    format: Literal["savmap-site"] = "savmap-site"
    """What kind of file this is."""
    version: Literal[1] = 1
    """Of the format."""
    plugins: Mapping[str, Settings] = {}
    """Which plugins look at the rows, with their settings for all rows. Default: all that are installed with all the
    packages that they need."""
    references: ReferenceSection = ReferenceSection()
    """What is known without mapping, for all rows; rows may say otherwise."""
    calibration: CalibrationSection = CalibrationSection()
    """What of the camera is estimated with the map; nothing if not given."""
    appearance: bool = False
    """Whether points of any kind help with the camera's motion; edges alone if not."""
    video: Where | None = None
    """The video of passes that name none."""
    fps: Rate | None = None
    """Sampling rate of passes that name none (15)."""
    camera: CameraSection | None = None
    """The camera of passes that name none: of whole panoramas if not given."""
    views: Mapping[str, ViewSection] = {}
    """Views aimed by hand, for all passes."""
    providers: Providers = ()
    """Execution providers that networks run on, the first that there is. Default: CUDA or OpenVINO where onnxruntime
    has them, else the processor."""
    survey: Where | None = None
    """What a surveyor measured, a path or a URL: scores are printed, and drawn under the map."""
    on_plugin_error: Literal["fail", "skip"] = "fail"
    """What becomes of a row where a plugin fails: `fail`, it is not mapped; `skip`, it is mapped without that
    plugin."""
    plugin_timeout_s: Annotated[float, Field(gt=0)] = 600.0
    """How long one call of a plugin's hook may take; the process in which it takes longer is ended, and the plugin has
    failed."""
    orthophotos: bool = True
    """Whether a picture of each row's face, without perspective, is made of all frames."""
    panoramas: bool = True
    """Whether some of each row's panoramas are kept, 2048 pixels wide, to be looked at in the viewer."""
    joint: bool = True
    """Whether rows with the same pass (video, range, rate) are solved as one."""
    layout: LayoutSection | None = None
    """Where rows stand that are regularly spaced."""
    align: AlignSection | None = None
    """Where the site stands in the user's own world; exports for robots, CAD and buildings stand there."""
    rows: Annotated[Mapping[str, Row], Field(min_length=1)]
    """The rows by name."""

    @model_validator(mode="before")
    @classmethod
    def _defaults(cls, value: object) -> object:
        return _completed(value)

    @field_validator("plugins", mode="before")
    @classmethod
    def _empty_sections(cls, value: object) -> object:
        return _emptied(value)

    @field_validator("rows")
    @classmethod
    def _names(cls, value: Mapping[str, Row]) -> Mapping[str, Row]:
        """Files and folders are called by them."""
        for name in value:
            fault = "" if name.strip(". ") else "a row's name is more than dots and blanks"
            if fault_of_path(name.replace("/", "-")) or len(file_name(name)) > MOST_NAME:
                limits = f"no control characters and at most {MOST_NAME} letters, as a file's name counts them"
                fault = f"a row's name holds {limits}"
            if fault:
                raise ValueError(f"{fault} (it is {SHORT.repr(name)})")
        return value

    def joint_groups(self) -> list[list[str]]:
        """Names of the rows in groups: each shares a pass with another one of its group, unless `joint` is false."""
        groups = list[list[str]]()
        for name, row in self.rows.items():
            shared = {row_pass.footage for row_pass in row.passes} if self.joint else set()
            near = [group for group in groups if any(shared & {p.footage for p in self.rows[n].passes} for n in group)]
            groups = [group for group in groups if group not in near]
            groups.append([*(other for group in near for other in group), name])
        return groups

    def row_references(self, name: str) -> ReferenceSection:
        """The site's references with the row's own laid over them."""
        return _laid_over(self.references, self.rows[name].references)

    def row_calibration(self, name: str) -> CalibrationSection:
        """The site's calibration with the row's own laid over it."""
        return _laid_over(self.calibration, self.rows[name].calibration or CalibrationSection())

    def row_appearance(self, name: str) -> bool:
        """Whether points of any kind help with the camera's motion along a row."""
        appearance = self.rows[name].appearance
        return self.appearance if appearance is None else appearance

    def plugin_config(self, name: str, plugin: str) -> dict[str, Any]:
        """A plugin's settings for one row: the site's, overlaid by the row's."""
        return {**self.plugins.get(plugin, {}), **self.rows[name].plugins.get(plugin, {})}


def _laid_over(section: Section, row_section: Section) -> Section:
    """The site's section with the keys that the row's gives."""
    return section.model_copy(update={key: getattr(row_section, key) for key in row_section.model_fields_set})


def pass_names(passes: Sequence[Pass]) -> list[str]:
    """Names of a row's passes, in order."""
    return [f"pass {number}" for number in range(1, len(passes) + 1)]


def _emptied(value: object) -> object:
    return {k: {} if v is None else v for k, v in value.items()} if isinstance(value, Mapping) else value
