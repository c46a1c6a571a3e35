"""MCAP with messages of ROS 2, which `ros2 bag play` and RViz read without any program of savmap's."""

from pathlib import Path
from typing import Any

from savmap.errors import visible
from savmap.maps.exports import require_library
from savmap.maps.exports.frames import Element, elements
from savmap.maps.exports.trajectories.drawn import FRAME, LINE_M, Colour, coloured, segments, title
from savmap.types import Floats, SiteMap

LINE_LIST, TEXT = 5, 9
TEXT_M = 0.1
BREAK = "\n" + 80 * "=" + "\n"
MARKER_ARRAY = BREAK.join(
    (
        "visualization_msgs/Marker[] markers",
        "MSG: visualization_msgs/Marker\n"
        "std_msgs/Header header\nstring ns\nint32 id\nint32 type\nint32 action\ngeometry_msgs/Pose pose\ngeometry_msgs/Vector3 scale\n"
        "std_msgs/ColorRGBA color\nbuiltin_interfaces/Duration lifetime\nbool frame_locked\ngeometry_msgs/Point[] points\n"
        "std_msgs/ColorRGBA[] colors\nstring texture_resource\nsensor_msgs/CompressedImage texture\n"
        "visualization_msgs/UVCoordinate[] uv_coordinates\nstring text\nstring mesh_resource\nvisualization_msgs/MeshFile mesh_file\n"
        "bool mesh_use_embedded_materials",
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


def write_rosbag2(site: SiteMap, path: Path) -> None:
    """MCAP with one visualization_msgs/MarkerArray on `/savmap/map`: a LINE_LIST and a text for each structure. Needs
    the extra `ros`."""
    require_library("mcap_ros2", "ros")
    from mcap_ros2.writer import Writer

    markers = [
        marker
        for number, (element, colour) in enumerate(coloured(elements(site)))
        for marker in _markers(element, colour, 2 * number)
    ]
    with path.open("wb") as stream:
        writer = Writer(stream)
        schema = writer.register_msgdef("visualization_msgs/msg/MarkerArray", MARKER_ARRAY)
        writer.write_message("/savmap/map", schema, {"markers": markers}, log_time=0, publish_time=0)
        writer.finish()


def _markers(element: Element, colour: Colour, number: int) -> tuple[dict[str, Any], dict[str, Any]]:
    structure = element.structure
    lines = [_point(end) for end in segments(structure).reshape(-1, 3)]
    middle = _point(structure.vertices.mean(axis=0))
    shown = {"type": LINE_LIST, "scale": {"x": LINE_M, "y": 0.0, "z": 0.0}, "points": lines}
    written = {"type": TEXT, "scale": {"x": 0.0, "y": 0.0, "z": TEXT_M}, "text": title(element)}
    here = _marker(element, colour)
    return {**here, **shown, "id": number}, {**here, **written, "id": number + 1, "pose": _pose(middle)}


def _marker(element: Element, colour: Colour) -> dict[str, Any]:
    paint = dict(zip("rgb", (value / 255 for value in colour), strict=True)) | {"a": 1.0}
    never = {"sec": 0, "nanosec": 0}
    header = {"stamp": never, "frame_id": FRAME}
    picture = {"header": header, "format": "", "data": b""}
    return {
        "header": header,
        "ns": visible(f"{element.row}/{element.plugin}/{element.structure.label}"),
        "action": 0,
        "pose": _pose({"x": 0.0, "y": 0.0, "z": 0.0}),
        "color": paint,
        "lifetime": never,
        "frame_locked": False,
        "points": [],
        "colors": [],
        "texture_resource": "",
        "texture": picture,
        "uv_coordinates": [],
        "text": "",
        "mesh_resource": "",
        "mesh_file": {"filename": "", "data": b""},
        "mesh_use_embedded_materials": False,
    }


def _pose(position: dict[str, float]) -> dict[str, Any]:
    return {"position": position, "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}}


def _point(place: Floats) -> dict[str, float]:
    return dict(zip("xyz", map(float, place), strict=True))
