"""The shape of map.json, from which its JSON Schema is made (`savmap schema map > docs/map.schema.json`), and how the
records of a map that stand otherwise in the file are read and written; for the others see `savmap.types`."""

import base64
import json
import math
import re
from dataclasses import replace
from operator import not_
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, PlainSerializer
from scipy.spatial.transform import Rotation

from savmap.errors import OutputError
from savmap.files.kinds import kind_of
from savmap.types import (
    Alignment,
    CrossRowMatch,
    Floats,
    FrameTable,
    JointCovariance,
    MapWarning,
    Measured,
    Placement,
    ReferenceUse,
    RowMap,
    SiteMap,
    Solid,
    Structure,
    Trajectory,
    Verdict,
    ViewSpec,
)
from savmap.types.verdicts import WarningCode
from savmap.types.written import (
    FIGURE,
    LARGEST,
    QUATERNION,
    UPPER,
    Degrees,
    Deviation,
    Figure,
    Number,
    UpperTriangle,
    Vector,
    Written,
    array,
    coordinates,
    rounded,
    symmetric,
    upper_triangle,
)

FORMAT = "savmap-map"
VERSION = 1
LEAST_SIGMA = 10.0**-FIGURE
"""Of a reference: readers divide by it."""
JOINT_NUMBERS = "<f4"


def _quaternion(rotation: Floats) -> list[float]:
    """x, y, z, w of a rotation (3, 3). Rounded numbers are no unit quaternion: they are taken as a reader takes them,
    so that a map that is read and written again has the same bytes."""
    first = rounded(Rotation.from_matrix(rotation).as_quat(canonical=True), QUATERNION)
    read = Rotation.from_quat(first).as_matrix()
    turn: list[float] = rounded(Rotation.from_matrix(read).as_quat(canonical=True), QUATERNION)
    return turn


def _unit(turn: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    if abs(math.hypot(*turn) - 1) > 1e-3:
        raise ValueError("it is no unit quaternion")
    return turn


Pixels = Annotated[int, Field(ge=1, le=1 << 16), PlainSerializer(int)]
Sigma = Annotated[
    tuple[Deviation, Deviation, Deviation],
    Field(description="standard deviation of x, y, z, m"),
    PlainSerializer(rounded),
]
Quaternion = Annotated[
    tuple[float, float, float, float],
    Field(description="x, y, z, w of world_from_rig, w >= 0"),
    AfterValidator(_unit),
    PlainSerializer(_quaternion),
]
Slot = Annotated[int, Field(ge=-1)]
Numbers = PlainSerializer(np.ndarray.tolist)


class _Part(BaseModel):
    """A part of the file. One that is no record of a map has `of`, which makes it of a record, not checked, and `made`,
    which makes the record and raises ValueError where the parts do not go together."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


def as_part(kind: Any) -> Written:
    """How a record stands in the file: as a part of this kind."""
    return Written(kind, kind.made, kind.of)


class VertexEntry(_Part):
    """A labelled corner, edge end or centre of a structure."""

    label: str
    position_m: Vector
    sigma_m: Sigma
    covariance_m2: UpperTriangle

    @classmethod
    def of(cls, label: str, position: Floats, covariance: Floats) -> Self:
        sigma = np.sqrt(np.diag(symmetric(upper_triangle(covariance))))
        return cls.model_construct(label=label, position_m=position, sigma_m=sigma, covariance_m2=covariance)


class StructureEntry(_Part):
    """One mapped structure. Edges join vertices by their number in `vertices`, from 0."""

    id: str
    label: str
    vertices: Annotated[list[VertexEntry], Field(min_length=1)]
    edges: Annotated[list[tuple[int, int]], Numbers]
    attributes: dict[str, Measured | Figure]
    solid: Annotated[Solid | None, Field(exclude_if=not_)] = None

    @classmethod
    def of(cls, given: Structure) -> Self:
        vertices = map(VertexEntry.of, given.vertex_labels, given.vertices, given.covariances)
        return cls.model_construct(**{**vars(given), "vertices": list(vertices), "attributes": dict(given.attributes)})

    def made(self) -> Structure:
        if any(not 0 <= end < len(self.vertices) for edge in self.edges for end in edge):
            raise ValueError(f"{self.id}: an edge joins a vertex that is not there")
        covariances = np.zeros((len(self.vertices), 3, 3))
        covariances[:, UPPER[0], UPPER[1]] = [vertex.covariance_m2 for vertex in self.vertices]
        covariances[:, UPPER[1], UPPER[0]] = covariances[:, UPPER[0], UPPER[1]]
        vertices = array([vertex.position_m for vertex in self.vertices])
        labels, edges = tuple(vertex.label for vertex in self.vertices), np.array(self.edges, np.int64).reshape(-1, 2)
        return Structure(self.id, self.label, vertices, covariances, labels, edges, self.attributes, self.solid)


class FrameEntry(_Part):
    """A frame of the row in order of its number; pose null where it is not known."""

    frame: int = Field(ge=0)
    stamp_s: Number = Field(description="time in its own video")
    pass_name: str = Field(alias="pass")
    position_m: Vector | None
    orientation_xyzw: Quaternion | None
    sigma_m: Sigma | None

    @classmethod
    def all_of(cls, table: FrameTable, path: Trajectory) -> list[Self]:
        """The frames of a row."""
        frames = enumerate(zip(table.stamps_s, table.passes, strict=True))
        nowhere = {"position_m": None, "orientation_xyzw": None, "sigma_m": None}
        entries = [
            {"frame": frame, "stamp_s": stamp_s, "pass_name": name, **nowhere} for frame, (stamp_s, name) in frames
        ]
        for index, (frame, pose) in enumerate(zip(path.frames, path.world_from_rig, strict=True)):
            sigma = None if path.sigma_m is None else path.sigma_m[index]
            entries[frame] |= {"position_m": pose[:3, 3], "orientation_xyzw": pose[:3, :3], "sigma_m": sigma}
        return [cls.model_construct(**entry) for entry in entries]


class ViewEntry(_Part):
    """A rectilinear view: its direction in the panorama, and its size."""

    yaw_deg: Degrees
    pitch_deg: Degrees
    roll_deg: Degrees
    hfov_deg: Annotated[float, PlainSerializer(rounded)] = Field(gt=0, lt=180)
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

    @classmethod
    def of(cls, given: ReferenceUse) -> Self:
        """Residual and state are those of the rounded numbers, which a reader has."""
        value, sigma, solved = rounded((given.value, given.sigma, given.solved))
        sigma = max(sigma, LEAST_SIGMA)
        used = None if given.sigma_used is None else max(rounded(given.sigma_used), sigma)
        softened = used if used and used > sigma else None
        use = ReferenceUse(given.name, value, sigma, solved, given.unit, softened, given.left_out)
        return cls.model_construct(**vars(use), sigma_used=used, residual=rounded(solved - value), state=use.state)

    def made(self) -> ReferenceUse:
        """An older map has one standard deviation, that which was used."""
        softened = self.sigma_used if self.sigma_used is not None and self.sigma_used > self.sigma else None
        left_out = self.state == "left out"
        return ReferenceUse(self.name, self.value, self.sigma, self.solved, self.unit, softened, left_out)


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

    @classmethod
    def of(cls, given: MapWarning) -> Self:
        """With its headline and its action, for those who read the file without savmap."""
        lists = {"details": list(given.details), "subjects": list(given.subjects)}
        texts = {"headline": given.headline, "action": given.action}
        return cls.model_construct(**{**vars(given), **lists, **texts}, place_m=given.place)

    def made(self) -> MapWarning:
        subjects, details = tuple(self.subjects), tuple(self.details)
        return MapWarning(self.code, subjects, self.figure, self.place_m, self.frame, details)


class VerdictEntry(_Part):
    """Whether a row's map may be used as it is, and what that rests on that nothing checks."""

    grade: Literal["trusted", "check"]
    warnings: list[Annotated[MapWarning, as_part(WarningEntry)]]
    notes: list[str] = []

    @classmethod
    def of(cls, given: Verdict) -> Self:
        return cls.model_construct(grade=given.grade, warnings=list(given.warnings), notes=list(given.notes))

    def made(self) -> Verdict:
        return Verdict(tuple(self.warnings), tuple(self.notes))


class JointEntry(_Part):
    """How the errors of a row's vertices go together. `coordinates` by plugin and structure id: for each vertex, x y z,
    the number of its coordinate from 0; -1: its error is independent of all others', and `covariance_m2` of the vertex
    has its variance. `covariance_m2`: the upper triangle of the covariance of these `size` coordinates, row by row,
    32-bit floats, the least significant byte first, in base64. `unchecked_m`: how far each coordinate is off, with its
    sign, with each error of a reference that no second one would show."""

    size: Annotated[int, Field(ge=1, le=20000)]
    coordinates: dict[str, dict[str, Annotated[list[tuple[Slot, Slot, Slot]], Numbers]]]
    covariance_m2: str
    unchecked_m: Annotated[list[list[float]], PlainSerializer(coordinates), Field(exclude_if=not_)] = []

    @classmethod
    def of(cls, given: JointCovariance) -> Self:
        size = len(given.covariance)
        triangle = given.covariance[np.triu_indices(size)].astype(JOINT_NUMBERS)
        slots = {plugin: dict(group) for plugin, group in given.coordinates.items()}
        text = base64.b64encode(triangle.tobytes()).decode("ascii")
        return cls.model_construct(size=size, coordinates=slots, covariance_m2=text, unchecked_m=list(given.hidden))

    def made(self) -> JointCovariance:
        try:
            content = base64.b64decode(self.covariance_m2, validate=True)
        except ValueError as error:
            raise ValueError(f"covariance_m2 is not base64 ({error})") from error
        triangle = np.frombuffer(content[: len(content) // 4 * 4], JOINT_NUMBERS).astype(np.float64)
        if len(triangle) != self.size * (self.size + 1) // 2 or not np.isfinite(triangle).all():
            raise ValueError(f"covariance_m2 is not the finite upper triangle of {self.size} lines")
        if any(len(line) != self.size for line in self.unchecked_m):
            raise ValueError(f"unchecked_m should be lines of {self.size} numbers")
        for name, slots in ((name, slots) for group in self.coordinates.values() for name, slots in group.items()):
            if any(number >= self.size for vertex in slots for number in vertex):
                raise ValueError(f"{name}: a coordinate is not among the {self.size}")
        numbers = {
            plugin: {name: np.array(slots, np.int64).reshape(-1, 3) for name, slots in group.items()}
            for plugin, group in self.coordinates.items()
        }
        hidden = {"hidden": np.array(self.unchecked_m)} if self.unchecked_m else {}
        return JointCovariance(numbers, symmetric(triangle, self.size), **hidden)


class RowEntry(_Part):
    """One row in its own frame: x along the aisle from the first element's outer edge, y up from the floor, z towards
    the camera, face at z = 0. Structures by plugin."""

    trajectory: list[FrameEntry]
    views: dict[str, ViewEntry]
    structures: dict[str, list[Annotated[Structure, as_part(StructureEntry)]]]
    references: list[Annotated[ReferenceUse, as_part(ReferenceEntry)]]
    report: dict[str, Figure]
    verdict: Annotated[Verdict, as_part(VerdictEntry)] | None = Field(default=None, exclude_if=not_)
    joint: Annotated[JointCovariance, as_part(JointEntry)] | None = Field(default=None, exclude_if=not_)

    @classmethod
    def of(cls, given: RowMap) -> Self:
        return cls.model_construct(
            trajectory=FrameEntry.all_of(given.frames, given.trajectory),
            views={name: ViewEntry.model_construct(**vars(view)) for name, view in given.views.items()},
            structures={plugin: list(group) for plugin, group in given.structures.items()},
            references=list(given.references),
            report=dict(given.report),
            verdict=given.verdict,
            joint=given.joint,
        )

    def made(self) -> RowMap:
        """The row, whose name is its key in the file."""
        frames, passes = array([frame.stamp_s for frame in self.trajectory]), [f.pass_name for f in self.trajectory]
        if [entry.frame for entry in self.trajectory] != list(range(len(frames))):
            raise ValueError("trajectory: frames should be numbered 0, 1, 2 ... in order")
        sizes = {(plugin, s.id): len(s.vertices) for plugin, group in self.structures.items() for s in group}
        for plugin, group in self.joint.coordinates.items() if self.joint else ():
            for name, numbers in group.items():
                if (count := sizes.get((plugin, name))) is None:
                    raise ValueError(
                        f"joint: {plugin}: {name} is none of the structures; whoever edits a map takes it out of "
                        "`joint`, too, or leaves `joint` out"
                    )
                if len(numbers) != count:
                    raise ValueError(f"joint: {plugin}: {name} has {count} vertices, not {len(numbers)}")
        views = {name: ViewSpec(name, **dict(view)) for name, view in self.views.items()}
        structures = {plugin: tuple(group) for plugin, group in self.structures.items()}
        table, references = FrameTable(frames, tuple(passes)), tuple(self.references)
        rest: dict[str, Any] = {"report": self.report, "verdict": self.verdict, "joint": self.joint}
        return RowMap("", table, views, self._path(), structures, references, **rest)

    def _path(self) -> Trajectory:
        located = [entry for entry in self.trajectory if entry.position_m and entry.orientation_xyzw]
        poses = np.tile(np.eye(4), (len(located), 1, 1))
        if located:
            poses[:, :3, :3] = Rotation.from_quat([entry.orientation_xyzw for entry in located]).as_matrix()
            poses[:, :3, 3] = [entry.position_m for entry in located]
        sigmas = [entry.sigma_m for entry in located if entry.sigma_m is not None]
        sigma = np.array(sigmas).reshape(-1, 3) if len(sigmas) == len(located) else None
        return Trajectory(np.array([entry.frame for entry in located], dtype=np.int64), poses, sigma)


class MapFile(_Part):
    """A savmap map: metres and seconds."""

    format: Literal["savmap-map"]
    version: Literal[1]
    units: Literal["m"]
    made_by: dict[str, str] = Field(description="software and model versions, SHA-256 of models")
    rows: dict[str, Annotated[RowMap, as_part(RowEntry)]]
    failed: dict[str, str] = Field(default={}, description="rows that could not be mapped, and why", exclude_if=not_)
    placed: dict[str, Placement] = Field(
        default={}, description="placements of rows in the site's frame", exclude_if=not_
    )
    ties: list[CrossRowMatch] = Field(default=[], description="what neighbouring rows have in common", exclude_if=not_)
    aligned: Alignment | None = Field(
        default=None, description="where the site stands in the user's world", exclude_if=not_
    )

    @classmethod
    def of(cls, given: SiteMap) -> Self:
        head: dict[str, Any] = {"format": FORMAT, "version": VERSION, "units": "m", "made_by": dict(given.made_by)}
        rows: dict[str, Any] = {"rows": dict(given.rows), "failed": dict(given.failed)}
        rest: dict[str, Any] = {
            "placed": dict(given.placements),
            "ties": list(given.matches),
            "aligned": given.alignment,
        }
        return cls.model_construct(**head, **rows, **rest)

    def made(self) -> SiteMap:
        rows = {name: replace(row, name=name) for name, row in self.rows.items()}
        return SiteMap(rows, self.made_by, self.failed, self.placed, tuple(self.ties), self.aligned)


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
    return re.sub(r"(\\n)+", " ", text) + "\n"
