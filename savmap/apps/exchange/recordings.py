"""Recordings for viewers of robots: MCAP with JSON messages of Foxglove's published schemas (foxglove.SceneUpdate,
foxglove.PosesInFrame, foxglove.Log), MCAP with messages of ROS 2, which `ros2 bag play` and RViz read without any
program of savmap's, and rerun's recordings."""

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from scipy.spatial.transform import Rotation

from savmap.apps.exchange.trajectories import PassFrames, passes
from savmap.errors import OutputError, visible
from savmap.files.atomic import reason
from savmap.maps.exports import require_library
from savmap.maps.exports.frames import Element, elements
from savmap.maps.exports.marks import bytes_of, colours, remarks, sigmas
from savmap.types import Floats, Measured, SiteMap, Structure

FRAME = "map"
"""The frame's name in messages: that of ROS for a map."""
NANO = 1_000_000_000
LINE_M, TEXT_M = 0.02, 0.1
FOXGLOVE_LINE_LIST, FOXGLOVE_ALL, WARNING = 2, 1, 3
ROS_LINE_LIST, ROS_TEXT = 5, 9
NEVER = {"sec": 0, "nsec": 0}
NO_TURN = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
OBJECT = {"type": "object"}
SCHEMAS = {
    "foxglove.SceneUpdate": {
        "deletions": {"type": "array", "items": OBJECT},
        "entities": {"type": "array", "items": OBJECT},
    },
    "foxglove.PosesInFrame": {
        "timestamp": OBJECT,
        "frame_id": {"type": "string"},
        "poses": {"type": "array", "items": OBJECT},
    },
    "foxglove.Log": {
        "timestamp": OBJECT,
        "level": {"type": "integer"},
        **{name: {"type": "string"} for name in ("message", "name", "file")},
        "line": {"type": "integer"},
    },
}
BREAK = "\n" + 80 * "=" + "\n"
MARKER_ARRAY = BREAK.join(
    (
        "visualization_msgs/Marker[] markers",
        "MSG: visualization_msgs/Marker\n"
        "std_msgs/Header header\nstring ns\nint32 id\nint32 type\nint32 action\n"
        "geometry_msgs/Pose pose\ngeometry_msgs/Vector3 scale\n"
        "std_msgs/ColorRGBA color\nbuiltin_interfaces/Duration lifetime\nbool frame_locked\n"
        "geometry_msgs/Point[] points\nstd_msgs/ColorRGBA[] colors\n"
        "string texture_resource\nsensor_msgs/CompressedImage texture\n"
        "visualization_msgs/UVCoordinate[] uv_coordinates\nstring text\nstring mesh_resource\n"
        "visualization_msgs/MeshFile mesh_file\nbool mesh_use_embedded_materials",
        "MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id",
        "MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec",
        "MSG: builtin_interfaces/Duration\nint32 sec\nuint32 nanosec",
        "MSG: geometry_msgs/Pose\ngeometry_msgs/Point position\ngeometry_msgs/Quaternion orientation",
        "MSG: geometry_msgs/Point\nfloat64 x\nfloat64 y\nfloat64 z",
        "MSG: geometry_msgs/Quaternion\nfloat64 x\nfloat64 y\nfloat64 z\nfloat64 w",
        "MSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z",
        "MSG: std_msgs/ColorRGBA\nfloat32 r\nfloat32 g\nfloat32 b\nfloat32 a",
        "MSG: sensor_msgs/CompressedImage\nstd_msgs/Header header\nstring format\nuint8[] data",
        "MSG: visualization_msgs/UVCoordinate\nfloat32 u\nfloat32 v",
        "MSG: visualization_msgs/MeshFile\nstring filename\nuint8[] data",
    )
)

Colour = tuple[int, int, int]


def _coloured(site: SiteMap) -> Iterator[tuple[Element, Colour]]:
    """All elements, each with its label's colour."""
    everything = elements(site)
    palette = colours(element.structure.label for element in everything)
    for element in everything:
        yield element, bytes_of(palette[element.structure.label])


def _segments(structure: Structure) -> Floats:
    """The edges' ends (n, 2, 3) m."""
    ends: Floats = structure.vertices[structure.edges.reshape(-1, 2)]
    return ends


def _texts(element: Element) -> dict[str, str]:
    """Row, plugin, label, attributes and the vertices' standard deviations as texts, by name."""
    structure = element.structure
    attributes = {
        name: f"{value.value:g} +- {value.sigma:g}" if isinstance(value, Measured) else str(value)
        for name, value in structure.attributes.items()
    }
    vertices = {
        f"sigma of {label}, mm": " ".join(f"{1000 * value:.1f}" for value in sigma)
        for label, sigma in zip(structure.vertex_labels, sigmas(structure), strict=True)
    }
    lines = {"row": element.row, "plugin": element.plugin, "label": structure.label, **attributes, **vertices}
    return {visible(name): visible(value) for name, value in lines.items()}


def _title(element: Element) -> str:
    """The name that a structure is shown with: what is written on it, or its id."""
    structure = element.structure
    return visible(str(structure.attributes.get("text") or f"{element.row}: {structure.id}"))


def _point(place: Floats | Sequence[float]) -> dict[str, float]:
    return dict(zip("xyz", map(float, place), strict=True))


def _paint(colour: Colour) -> dict[str, float]:
    return dict(zip("rgb", (value / 255 for value in colour), strict=True)) | {"a": 1.0}


def write_mcap(site: SiteMap, path: Path) -> None:
    """MCAP with `/map` (an entity for each structure, its attributes and standard deviations as metadata), for each
    pass `/drive/ROW/PASS`, and on `/advice` what must be checked. Needs the extra `ros`."""
    with MapRecorder(path) as recorder:
        recorder.add(site)
        for line in remarks(site.rows.values()):
            recorder.say(line, WARNING, 0.0)


class MapRecorder:
    """An MCAP file that takes maps while they are made, each in place of the one before, and lines of text on `/advice`
    (foxglove.Log). `chunked`: compressed; else what was added is in the file at once, also where the program is killed.
    Needs the extra `ros`. Raises OutputError where it is missing, or the file cannot be written."""

    def __init__(self, path: Path, chunked: bool = True) -> None:
        require_library("mcap", "ros")
        from mcap.writer import Writer

        self.path, self._channels, self._has_map = path, dict[str, int](), False
        with self._writing():
            self._stream = path.open("wb")
            self._writer = Writer(self._stream, use_chunking=chunked)
            self._writer.start(profile="", library="savmap")

    def add(self, site: SiteMap, stamp_s: float = 0.0) -> None:
        """Add a map, of which this is the time."""
        entities = [_entity(element, colour) for element, colour in _coloured(site)]
        deletions = [{"timestamp": _stamp(stamp_s), "type": FOXGLOVE_ALL, "id": ""}] if self._has_map else []
        self._has_map = True
        self._send("/map", "foxglove.SceneUpdate", {"deletions": deletions, "entities": entities}, stamp_s)
        for frames in passes(site):
            self._send(f"/drive/{frames.folder}", "foxglove.PosesInFrame", _poses(frames), stamp_s)

    def say(self, text: str, level: int, stamp_s: float) -> None:
        """Add a line of a level from 1, debug, to 5, fatal."""
        line = {"timestamp": _stamp(stamp_s), "level": level, "message": text, "name": "savmap", "file": "", "line": 0}
        self._send("/advice", "foxglove.Log", line, stamp_s)

    def __enter__(self) -> "MapRecorder":
        return self

    def __exit__(self, *_: object) -> None:
        with self._writing(), self._stream:
            self._writer.finish()

    def _send(self, topic: str, schema: str, message: object, stamp_s: float) -> None:
        with self._writing():
            if topic not in self._channels:
                shape = {"title": schema, "type": "object", "properties": SCHEMAS[schema]}
                number = self._writer.register_schema(schema, "jsonschema", json.dumps(shape).encode())
                self._channels[topic] = self._writer.register_channel(topic, "json", number)
            time_ns = round(NANO * stamp_s)
            self._writer.add_message(self._channels[topic], time_ns, json.dumps(message).encode(), time_ns)
            self._stream.flush()

    @contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise OutputError(f"{self.path}: cannot be written ({reason(error)})") from error


def _stamp(stamp_s: float) -> dict[str, int]:
    nanoseconds = round(NANO * stamp_s)
    return {"sec": nanoseconds // NANO, "nsec": nanoseconds % NANO}


def _entity(element: Element, colour: Colour) -> dict[str, Any]:
    ends = _segments(element.structure)
    line = {
        "type": FOXGLOVE_LINE_LIST,
        "pose": {"position": _point([0.0, 0, 0]), "orientation": NO_TURN},
        "thickness": LINE_M,
        "scale_invariant": False,
        "points": [_point(end) for end in ends.reshape(-1, 3)],
        "color": _paint(colour),
        "colors": [],
        "indices": [],
    }
    text = {
        "pose": {"position": _point(element.structure.vertices.mean(axis=0)), "orientation": NO_TURN},
        "billboard": True,
        "font_size": TEXT_M,
        "scale_invariant": False,
        "color": _paint(colour),
        "text": _title(element),
    }
    return {
        "timestamp": NEVER,
        "frame_id": FRAME,
        "id": f"{element.row}/{element.plugin}/{element.structure.id}",
        "lifetime": NEVER,
        "frame_locked": True,
        "metadata": [{"key": key, "value": value} for key, value in _texts(element).items()],
        **{kind: [] for kind in ("arrows", "cubes", "spheres", "cylinders", "triangles", "models")},
        "lines": [line],
        "texts": [text],
    }


def _poses(frames: PassFrames) -> dict[str, Any]:
    quaternions = Rotation.from_matrix(frames.world_from_rig[:, :3, :3]).as_quat(canonical=True)
    poses = [
        {"position": _point(place), "orientation": dict(zip("xyzw", turn, strict=True))}
        for place, turn in zip(frames.world_from_rig[:, :3, 3], quaternions.tolist(), strict=True)
    ]
    return {"timestamp": _stamp(float(frames.stamps_s[0])), "frame_id": FRAME, "poses": poses}


def write_rosbag2(site: SiteMap, path: Path) -> None:
    """MCAP with one visualization_msgs/MarkerArray on `/savmap/map`: a LINE_LIST and a text for each structure. Needs
    the extra `ros`."""
    require_library("mcap_ros2", "ros")
    from mcap_ros2.writer import Writer

    markers = [
        marker
        for number, (element, colour) in enumerate(_coloured(site))
        for marker in _markers(element, colour, 2 * number)
    ]
    if said := remarks(site.rows.values()):
        text = {"type": ROS_TEXT, "scale": {"z": TEXT_M}, "text": "\n".join(said), "color": _paint((255, 255, 255))}
        markers.append(
            {"header": {"frame_id": FRAME}, "ns": "remarks", "id": len(markers), "pose": _pose([0.0, 0, 0]), **text}
        )
    with path.open("wb") as stream:
        writer = Writer(stream)
        schema = writer.register_msgdef("visualization_msgs/msg/MarkerArray", MARKER_ARRAY)
        writer.write_message("/savmap/map", schema, {"markers": markers}, log_time=0, publish_time=0)
        writer.finish()


def _markers(element: Element, colour: Colour, number: int) -> tuple[dict[str, Any], dict[str, Any]]:
    """A marker of a structure's lines and one of its text; fields that are left out are zero or empty."""
    structure = element.structure
    header = {"frame_id": FRAME}
    marker = {
        "header": header,
        "ns": visible(f"{element.row}/{element.plugin}/{structure.label}"),
        "color": _paint(colour),
        "texture": {"header": header},
    }
    points = [_point(end) for end in _segments(structure).reshape(-1, 3)]
    lines = {"type": ROS_LINE_LIST, "scale": {"x": LINE_M}, "points": points, "pose": _pose([0.0, 0.0, 0.0])}
    title = {"type": ROS_TEXT, "scale": {"z": TEXT_M}, "text": _title(element)}
    middle = _pose(structure.vertices.mean(axis=0))
    return {**marker, **lines, "id": number}, {**marker, **title, "id": number + 1, "pose": middle}


def _pose(place: Floats | Sequence[float]) -> dict[str, Any]:
    return {"position": _point(place), "orientation": NO_TURN}


def write_rerun(site: SiteMap, path: Path) -> None:
    """`map/ROW/PLUGIN/ID` as line strips with a label, attributes and standard deviations; `drive/ROW/PASS` with its
    path, and its pose over the video's time. Needs the extra `rerun`."""
    require_library("rerun", "rerun")
    import rerun

    recording = rerun.RecordingStream("savmap", recording_id="savmap")
    recording.save(str(path))
    recording.log("/", rerun.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    recording.log("remarks", rerun.TextDocument("\n".join(remarks(site.rows.values()))), static=True)
    for element, colour in _coloured(site):
        place = ["map", visible(element.row), visible(element.plugin), visible(element.structure.id)]
        ends = _segments(element.structure)
        strips = rerun.LineStrips3D(
            ends, colors=[colour] * len(ends), radii=LINE_M / 2, labels=[_title(element)] * len(ends), show_labels=False
        )
        recording.log(place, strips, rerun.AnyValues(**_texts(element)), static=True)
    for frames in passes(site):
        place = ["drive", visible(frames.row), visible(frames.name)]
        track = rerun.LineStrips3D([frames.world_from_rig[:, :3, 3]], colors=[(120, 120, 120)])
        recording.log([*place, "path"], track, static=True)
        for stamp, pose in zip(frames.stamps_s.tolist(), frames.world_from_rig, strict=True):
            recording.set_time("video", duration=stamp)
            recording.log([*place, "rig"], rerun.Transform3D(translation=pose[:3, 3], mat3x3=pose[:3, :3]))
    recording.disconnect()
